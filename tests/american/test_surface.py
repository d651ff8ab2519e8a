from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, PiecewiseConstant, exercise_boundary, price, value_surface
from pricing_core.american.book.prices import prices
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.errors import InvalidInputError, NumericalError
from tests.problems.needs_kernel import needs_kernel

MARKET = Market(100.0, rate=0.05, volatility=0.2)
SPOTS, TIMES = [70.0, 85.0, 100.0, 130.0], [0.0, 0.5, 0.9, 1.0]


@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("exercise", ["american", "european"])
def test_every_point_is_the_price_of_what_is_left(option_type, exercise):
    market = Market(100.0, rate=0.05, volatility=0.2, dividend_yield=0.08)
    surface = value_surface(Option(option_type, 100.0, 1.0, exercise), market, spots=SPOTS, times=TIMES)
    assert surface.value.shape == surface.delta.shape == surface.exercised.shape == (4, 4)
    for i, time in enumerate(TIMES):
        for j, spot in enumerate(SPOTS):
            left = Option(option_type, 100.0, 1.0 - time, exercise)
            alone = price(left, Market(spot, 0.05, 0.2, 0.08))
            assert surface.value[i, j] == pytest.approx(alone.price, abs=2e-4)
            assert surface.exercised[i, j] == alone.exercise_now
            if time < 1.0:
                assert surface.delta[i, j] == pytest.approx(alone.delta, abs=2e-5)


def test_value_falls_towards_expiry_and_with_the_spot():
    surface = value_surface(Option("put", 100.0, 1.0), MARKET, spots=SPOTS, times=TIMES)
    assert np.all(np.diff(surface.value, axis=0) <= surface.error_estimate[1:] + surface.error_estimate[:-1])
    assert np.all(np.diff(surface.value[:-1], axis=1) < 0.0)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"spots": [100.0, -1.0], "times": [0.0]}, r"^spots = -1.0: must be a number from 0 to 1e\+30$"),
        ({"spots": [100.0], "times": [1.5]}, r"^times = \[1.5\]: must be from 0 to the expiry$"),
        ({"spots": [100.0], "times": [-0.1]}, r"^times = \[-0.1\]: must be from 0 to the expiry$"),
        ({"spots": [[100.0]], "times": [0.0]}, r"^spots = "),
    ],
)
def test_points_outside_are_refused(points, message):
    with pytest.raises(InvalidInputError, match=message):
        value_surface(Option("put", 100.0, 1.0), MARKET, **points)


def test_an_argument_of_another_kind_is_named():
    with pytest.raises(InvalidInputError, match=r"^option = "):
        value_surface("put", MARKET, spots=[100.0], times=[0.0])
    with pytest.raises(InvalidInputError, match=r"^market = "):
        value_surface(Option("put", 100.0, 1.0), None, spots=[100.0], times=[0.0])


def test_a_refusal_that_names_no_range_is_passed_on_whole(monkeypatch):
    def refuse(book, request):
        return prices(1, status="out_of_domain", message="did not converge")

    monkeypatch.setattr("pricing_core.american.surface.solve", refuse)
    with pytest.raises(InvalidInputError, match="did not converge"):
        value_surface(Option("put", 100.0, 1.0), MARKET, spots=[100.0], times=[0.0])


@needs_kernel
@pytest.mark.parametrize("dividend_model", ["spot", "escrowed"])
def test_with_dividends_every_point_is_the_price_of_what_is_left(dividend_model):
    dividends = [{"time": 0.3, "amount": 2.0}, {"time": 0.8, "amount": 3.0}]
    market = Market(100.0, 0.05, 0.2, cash_dividends=dividends, dividend_model=dividend_model)
    option, spots, times = Option("put", 100.0, 1.0), [85.0, 100.0, 115.0], [0.0, 0.3, 0.5]
    surface = value_surface(option, market, spots=spots, times=times)
    for i, time in enumerate(times):
        later = [{**d, "time": d["time"] - time} for d in dividends if d["time"] > time]
        left = replace(market, cash_dividends=later)
        for j, spot in enumerate(spots):
            alone = price(Option("put", 100.0, 1.0 - time), replace(left, spot=spot))
            assert surface.value[i, j] == pytest.approx(alone.price, abs=2e-4)
            assert surface.delta[i, j] == pytest.approx(alone.delta, abs=2e-5)
            assert surface.exercised[i, j] == alone.exercise_now


def test_spots_that_the_escrow_exceeds_are_refused():
    dividends = [{"time": 0.5, "amount": 20.0}]
    market = Market(100.0, 0.05, 0.2, cash_dividends=dividends, dividend_model="escrowed")
    with pytest.raises(InvalidInputError, match=r"^spots = 15.0: must be above what the escrowed dividends"):
        value_surface(Option("put", 100.0, 1.0), market, spots=[100.0, 15.0], times=[0.0])


@pytest.mark.parametrize("answers", [1, 4])
def test_an_interrupt_ends_the_work(answers):
    asked = []

    def interrupt():
        asked.append(True)
        return len(asked) >= answers

    dividends = ({"time": 0.5, "amount": 1.0},)
    market = Market(100.0, 0.05, 0.2, cash_dividends=dividends)
    spots = np.linspace(50.0, 150.0, 400)
    with pytest.raises(NumericalError, match="interrupted"):
        value_surface(
            Option("put", 100.0, 1.0),
            market,
            spots=spots,
            times=[0.0, 0.2],
            tolerance=1e-8,
            interrupt=interrupt,
        )


def test_no_times_give_an_empty_surface():
    dividends = ({"time": 0.5, "amount": 1.0},)
    for market in (Market(100.0, 0.05, 0.2), Market(100.0, 0.05, 0.2, cash_dividends=dividends)):
        surface = value_surface(Option("put", 100.0, 1.0), market, spots=[90.0, 100.0], times=[])
        assert surface.value.shape == surface.exercised.shape == (0, 2)


def black_scholes_slack(surface, row, rate, dividend_yield, volatility):
    """Return what dV/dt + sigma^2 S^2/2 V_SS + (r - q) S V_S - r V lacks to 0, money per year."""
    spot = surface.spot
    drift = surface.theta[row] + (rate - dividend_yield) * spot * surface.delta[row]
    return rate * surface.value[row] - drift - 0.5 * (volatility * spot) ** 2 * surface.gamma[row]


@needs_kernel
@pytest.mark.parametrize("seed", range(6))
def test_the_multiplier_closes_the_equation_of_black_and_scholes(seed):
    rng = np.random.default_rng(seed)
    strike = 10.0 ** rng.uniform(-10.0, 10.0)
    rate, dividend_yield, volatility = rng.uniform(0.0, 0.12), rng.uniform(0.0, 0.08), rng.uniform(0.1, 0.5)
    option = Option(rng.choice(["put", "call"]), strike, rng.uniform(0.2, 3.0))
    market = Market(strike, rate, volatility, dividend_yield)
    spots, times = strike * np.linspace(0.4, 2.5, 60), option.expiry * np.array([0.0, 0.3, 0.7])
    surface = value_surface(option, market, spots=spots, times=times, tolerance=1e-8)
    for row in range(times.size):
        slack = black_scholes_slack(surface, row, rate, dividend_yield, volatility)
        assert slack == pytest.approx(surface.multiplier[row], abs=1e-4 * strike)
    sign = 1.0 if option.option_type == "put" else -1.0
    exact = sign * (rate * strike - dividend_yield * spots)
    assert surface.multiplier == pytest.approx(np.where(surface.exercised, exact, 0.0), abs=1e-13 * strike)
    assert np.all(surface.multiplier >= 0.0)


@pytest.mark.parametrize("dividend_model", ["spot", "escrowed"])
def test_the_multiplier_is_what_waiting_a_moment_costs(dividend_model):
    wait, spots = 1e-6, [40.0, 50.0]
    dividends = [{"time": 0.5, "amount": 0.5}] if dividend_model == "escrowed" else []
    rate = {"times": [0.25, 1.0], "values": [0.05, 0.09]}
    market = Market(
        100.0, PiecewiseConstant(**rate), 0.1, 0.02, cash_dividends=dividends, dividend_model=dividend_model
    )
    option = Option("put", 100.0, 1.0)
    surface = value_surface(option, market, spots=spots, times=[0.0, 0.6], tolerance=1e-4)
    assert surface.exercised.all()
    for row, now in enumerate((0.05, 0.09)):
        due = 0.5 * np.exp(-0.05 * 0.25 - 0.09 * 0.25) if dividends and row == 0 else 0.0
        for place, spot in enumerate(spots):
            forward = (spot - due) * np.exp((now - 0.02) * wait) + due * np.exp(now * wait)
            waited = np.exp(-now * wait) * (100.0 - forward)  # all paths are still exercised then
            assert surface.multiplier[row, place] == pytest.approx((100.0 - spot - waited) / wait, rel=1e-4)


@needs_kernel
@pytest.mark.parametrize(
    "market",
    [
        Market(100.0, 0.05, 0.2, 0.03),
        Market(100.0, 0.05, 0.2, cash_dividends=[{"time": 0.4, "amount": 2.0}]),
        Market(100.0, PiecewiseConstant((0.3, 1.0), (0.02, 0.06)), 0.3),
    ],
)
def test_the_greeks_at_every_point_are_those_of_what_is_left(market):
    option, spots, times = Option("put", 100.0, 1.0), [80.0, 97.0, 120.0], [0.0, 0.2, 0.5]
    surface = value_surface(option, market, spots=spots, times=times)
    for i, time in enumerate(times):
        for j, spot in enumerate(spots):
            alone = price(*seen_later(option, replace(market, spot=spot), time), tolerance=1e-7)
            for name in ("delta", "gamma", "theta", "vega"):
                found = getattr(surface, name)[i, j]
                assert found == pytest.approx(getattr(alone, name), abs=2e-3 if name == "vega" else 3e-4)


@pytest.mark.parametrize("exercise", ["european", "bermudan"])
def test_without_exercise_at_any_time_there_is_no_multiplier_and_no_perpetual_boundary(exercise):
    times = (0.5,) if exercise == "bermudan" else ()
    option = Option("put", 100.0, 1.0, exercise, exercise_times=times)
    surface = value_surface(option, MARKET, spots=[50.0, 100.0], times=[0.0, 0.7], tolerance=1e-3)
    assert not surface.multiplier.any()
    assert surface.perpetual_boundary is None


def test_without_greeks_there_are_the_values_alone():
    surface = value_surface(
        Option("put", 100.0, 1.0), MARKET, spots=SPOTS, times=TIMES, tolerance=1e-4, greeks="none"
    )
    assert surface.delta is surface.gamma is surface.theta is surface.vega is None
    assert surface.status == "ok"
    with pytest.raises(InvalidInputError, match=r"^greeks = 'extended': must be none or standard$"):
        value_surface(Option("put", 100.0, 1.0), MARKET, spots=SPOTS, times=TIMES, greeks="extended")


@needs_kernel
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_the_boundary_of_a_long_life_is_nearly_the_perpetual_one(option_type):
    market = Market(100.0, rate=0.06, volatility=0.3, dividend_yield=0.05)
    option = Option(option_type, 100.0, 200.0)
    surface = value_surface(option, market, spots=[100.0], times=[0.0], tolerance=1e-4)
    long = exercise_boundary(option, market, times=[0.0]).boundary[0]
    assert surface.perpetual_boundary == pytest.approx(long, rel=1e-3)


@pytest.mark.parametrize(
    "market",
    [
        Market(100.0, rate=0.0, volatility=0.2),
        Market(100.0, rate=-0.02, volatility=0.2),
        Market(100.0, PiecewiseConstant((0.5, 1.0), (0.02, 0.03)), 0.2),
        Market(100.0, 0.05, 0.2, proportional_dividends=[{"time": 0.5, "fraction": 0.01}]),
    ],
)
def test_where_there_is_no_perpetual_boundary_there_is_none(market):
    surface = value_surface(Option("put", 100.0, 1.0), market, spots=[100.0], times=[1.0], tolerance=1e-3)
    assert surface.perpetual_boundary is None
