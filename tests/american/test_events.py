"""Contracts with dividends, curves and exercise dates: what holds of their prices, Greeks, boundaries and tables."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtr

from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
    price,
    price_many,
    value_surface,
)
from pricing_core.errors import InvalidInputError
from tests.problems.interrupted import Deadline
from tests.problems.needs_kernel import needs_kernel
from tests.problems.schedules import CONTRACTS, cash, proportional

PUT, CALL = Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)
FLAT = Market(100.0, 0.05, 0.25, 0.01)
TIGHT = 1e-8


def value(option, market, tolerance=TIGHT):
    return price(option, market, tolerance=tolerance, greeks="none").price


# Dividends that change nothing, or what others change.


@needs_kernel
@pytest.mark.parametrize("option", [PUT, CALL])
@pytest.mark.parametrize(
    "dividends",
    [cash(0.0), cash(5.0, (0.0,)), cash(5.0, (1.5,))],
    ids=["of nothing", "that have gone", "after expiry"],
)
def test_dividends_that_do_not_count_change_nothing(option, dividends):
    assert value(option, replace(FLAT, cash_dividends=dividends)) == value(option, FLAT)


@needs_kernel
@pytest.mark.parametrize("option", [PUT, CALL])
def test_tiny_dividends_change_next_to_nothing(option):
    tiny = replace(FLAT, cash_dividends=cash(1e-9))
    assert value(option, tiny) == pytest.approx(value(option, FLAT), abs=1e-7)


@needs_kernel
@pytest.mark.parametrize("fraction", [0.74, 1.0])
@pytest.mark.parametrize(("rate", "dividend_yield"), [(0.0, 0.0), (0.0, -0.02), (0.03, 0.0)])
def test_a_call_ends_where_a_dividend_takes_nearly_everything(rate, dividend_yield, fraction):
    """Nothing is earned by exercising before; what is left after is next to nothing."""
    market = Market(99.0, rate, 0.2, dividend_yield)
    ended = value(Option("call", 100.0, 0.18, "european"), market)
    dividends = proportional(fraction, (0.18, 0.56))
    found = price(CALL, replace(market, proportional_dividends=dividends), greeks="none")
    assert found.status == "ok"
    assert abs(found.price - ended) <= found.error_estimate


def with_one_dividend(sign, spot, amount, paid_at, expiry, rate, volatility):
    """Return the value of a European option, strike 100, by quadrature over the spot when the dividend is paid."""

    def after(z):
        drift = (rate - 0.5 * volatility**2) * paid_at
        left = max(spot * math.exp(drift + volatility * math.sqrt(paid_at) * z) - amount, 1e-300)
        spread = volatility * math.sqrt(expiry - paid_at)
        discounted = 100.0 * math.exp(-rate * (expiry - paid_at))
        d = math.log(left / discounted) / spread + 0.5 * spread
        value = sign * (discounted * ndtr(-sign * (d - spread)) - left * ndtr(-sign * d))
        return value * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)

    pieces = np.linspace(-9.0, 9.0, 37)
    found = sum(quad(after, *piece, epsabs=1e-10)[0] for piece in itertools.pairwise(pieces))
    return math.exp(-rate * paid_at) * found


@needs_kernel
@pytest.mark.parametrize(("option_type", "sign"), [("put", 1.0), ("call", -1.0)])
@pytest.mark.parametrize(
    ("spot", "amount", "paid_at", "expiry", "volatility"),
    [
        (1000.0, 1000.0, 0.04, 1.0 / 12.0, 0.2),
        (1000.0, 900.0, 0.04, 1.0 / 12.0, 0.2),
        (500.0, 400.0, 0.04, 1.0 / 12.0, 0.1),
        (800.0, 700.0, 1.0 / 24.0, 1.0 / 12.0, 0.2),
        (2000.0, 1900.0, 0.125, 0.25, 0.2),
    ],
)
def test_a_dividend_may_bring_a_far_spot_to_the_strike(
    option_type, sign, spot, amount, paid_at, expiry, volatility
):
    true = with_one_dividend(sign, spot, amount, paid_at, expiry, 0.05, volatility)
    market = Market(spot, 0.05, volatility, cash_dividends=cash(amount, (paid_at,)))
    found = price(Option(option_type, 100.0, expiry, "european"), market)
    assert found.status == "ok"
    assert abs(found.price - true) <= found.error_estimate
    american = price(Option(option_type, 100.0, expiry), market)
    assert american.price >= true - american.error_estimate
    assert american.european_price == pytest.approx(true, abs=0.05)  # it has no estimate of its own


@needs_kernel
@pytest.mark.parametrize(
    ("dividends", "ruined_at"),
    [
        ({"cash_dividends": cash(5.0, (0.75,)), "proportional_dividends": proportional(1.0, (0.5,))}, 0.5),
        ({"cash_dividends": cash(5.0, (1.0,)), "proportional_dividends": proportional(1.0, (0.5,))}, 0.5),
        ({"cash_dividends": (*cash(1000.0, (0.1,)), *cash(5.0, (0.5,)))}, 0.1),
        ({"cash_dividends": (*cash(1000.0, (0.1,)), *cash(1000.0, (0.5,)))}, 0.1),
    ],
)
def test_a_put_is_exercised_as_soon_as_its_spot_is_used_up(dividends, ruined_at):
    """Whatever is still to be paid then; before that the spot is worth waiting for."""
    market = Market(80.0, 0.05, 0.1, **dividends)
    found = price(PUT, market)
    assert abs(found.price - 100.0 * math.exp(-0.05 * ruined_at)) <= found.error_estimate + 1e-7
    assert found.european_price == pytest.approx(100.0 * math.exp(-0.05), abs=1e-3)


@needs_kernel
@pytest.mark.parametrize("count", [99, 100, 101, 349])
def test_many_dividends_that_use_up_the_spot_leave_the_strike(count):
    dividends = cash(160.0 / count, tuple(0.5 * (k + 1) / count for k in range(count)))
    found = price(PUT, Market(100.0, 0.05, 0.05, cash_dividends=dividends))
    assert found.european_price == pytest.approx(100.0 * math.exp(-0.05), abs=1e-3)
    assert 95.1 < found.price < 100.0


@needs_kernel
@pytest.mark.parametrize(
    "dividends", [{"cash_dividends": cash(3.0)}, {"proportional_dividends": proportional(0.03)}]
)
def test_a_put_without_rate_and_yield_is_held_to_the_end(dividends):
    market = replace(FLAT, rate=0.0, dividend_yield=0.0, **dividends)
    found = price(PUT, market)
    held = price(Option("put", 100.0, 1.0, "european"), market)
    assert found.status == held.status == "ok"
    assert abs(found.price - held.price) <= found.error_estimate + held.error_estimate
    assert found.delta == pytest.approx(held.delta, abs=1e-5)


@needs_kernel
def test_two_dividends_on_one_date_are_one():
    one = replace(FLAT, cash_dividends=cash(3.0, (0.5,)))
    two = replace(FLAT, cash_dividends=({"time": 0.5, "amount": 1.0}, {"time": 0.5, "amount": 2.0}))
    assert value(PUT, two) == pytest.approx(value(PUT, one), abs=1e-12)


def test_dividends_may_come_in_any_order():
    backwards = replace(FLAT, cash_dividends=tuple(reversed(cash(1.0))))
    assert backwards.cash_dividends == replace(FLAT, cash_dividends=cash(1.0)).cash_dividends


def test_on_one_date_the_proportional_dividend_comes_first():
    both = replace(FLAT, cash_dividends=cash(3.0, (0.5,)), proportional_dividends=proportional(0.5, (0.5,)))
    european = replace(PUT, exercise="european")
    # S -> S/2 - 3: as if half the spot paid the 3 alone.
    halved = replace(FLAT, spot=50.0, cash_dividends=cash(3.0, (0.5,)))
    assert value(european, both) == pytest.approx(value(european, halved), abs=1e-6)


def test_a_dividend_above_the_spot_leaves_nothing():
    # The put is then worth its discounted strike, and is exercised once the dividend has gone.
    market = Market(1.0, 0.05, 0.05, cash_dividends=cash(50.0, (0.5,)))
    assert value(PUT, market) == pytest.approx(max(99.0, 100.0 * math.exp(-0.025)), abs=1e-5)
    assert value(CALL, market) == pytest.approx(0.0, abs=1e-6)


@needs_kernel
@pytest.mark.parametrize("option", [PUT, CALL])
def test_thin_proportional_dividends_converge_to_a_yield(option):
    gaps = []
    for count in (12, 24, 48):
        fraction = -math.expm1(-0.03 / count)
        thin = Market(
            100.0,
            0.05,
            0.25,
            proportional_dividends=proportional(fraction, tuple((np.arange(count) + 0.5) / count)),
        )
        gaps.append(value(option, thin, 1e-7) - value(option, Market(100.0, 0.05, 0.25, 0.03)))
    assert abs(gaps[2]) < 0.02
    assert abs(gaps[1] / gaps[0]) == pytest.approx(0.5, abs=0.25)
    assert abs(gaps[2] / gaps[1]) == pytest.approx(0.5, abs=0.25)


@needs_kernel
def test_puts_rise_and_calls_fall_with_every_dividend():
    for option, sign in ((PUT, 1.0), (CALL, -1.0)):
        values = [
            value(option, replace(FLAT, cash_dividends=cash(a)), 1e-6) for a in (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
        ]
        assert np.all(sign * np.diff(values) > 0.0)


@needs_kernel
def test_the_spot_model_is_worth_more_than_the_escrowed_one():
    # The escrowed spot is smaller and diffuses less: by about the volatility's share of the dividend.
    for option in (PUT, CALL):
        spot, escrowed = (
            value(option, Market(100.0, 0.05, 0.25, cash_dividends=cash(5.0, (0.5,)), dividend_model=model))
            for model in ("spot", "escrowed")
        )
        vega = price(option, Market(100.0, 0.05, 0.25, cash_dividends=cash(5.0, (0.5,)))).vega
        assert spot > escrowed
        assert spot - escrowed == pytest.approx(vega * 0.25 * 0.05 * 0.5, rel=0.4)


def test_escrowed_dividends_worth_the_spot_are_refused():
    with pytest.raises(
        InvalidInputError, match=r"cash_dividends = .*: must be worth less today than the spot"
    ):
        price(PUT, Market(100.0, 0.05, 0.25, cash_dividends=cash(120.0, (0.5,)), dividend_model="escrowed"))


@needs_kernel
def test_sixty_weekly_dividends_keep_the_tolerance():
    weeks = tuple((k + 1) / 52.0 for k in range(60))
    for option in (replace(PUT, expiry=1.2), replace(CALL, expiry=1.2)):
        market = Market(100.0, 0.05, 0.25, cash_dividends=cash(0.08, weeks))
        found = price(option, market, tolerance=1e-6, greeks="none")
        assert found.status == "ok"
        assert found.price == pytest.approx(value(option, market, 1e-7), abs=1e-4)


# Curves and exercise dates.


@needs_kernel
def test_curves_exchange_put_and_call():
    rates, yields = PiecewiseConstant([0.3, 1.0], [0.02, 0.05]), PiecewiseConstant([0.6, 1.0], [0.03, 0.01])
    volatilities = PiecewiseConstant([0.5, 1.0], [0.2, 0.35])
    put = value(Option("put", 90.0, 1.0), Market(100.0, rates, volatilities, yields))
    call = value(Option("call", 100.0, 1.0), Market(90.0, yields, volatilities, rates))
    assert put == pytest.approx(call, abs=2e-6)


@pytest.mark.parametrize("option", [PUT, CALL])
def test_european_values_under_curves_are_those_of_their_averages(option):
    european = replace(option, exercise="european")
    curved = Market(
        100.0,
        {"times": [0.25, 1.0], "values": [0.02, 0.06]},
        {"times": [0.5, 1.0], "values": [0.2, 0.4]},
        {"times": [0.75, 1.0], "values": [0.0, 0.04]},
    )
    flat = Market(100.0, 0.05, math.sqrt(0.1), 0.01)
    assert value(european, curved) == pytest.approx(value(european, flat), abs=1e-8)


@needs_kernel
def test_bermudan_values_rise_to_the_american_one():
    american = value(PUT, FLAT)
    gaps = []
    for count in (4, 16, 64):
        dates = tuple((k + 1) / count for k in range(count))
        gaps.append(american - value(Option("put", 100.0, 1.0, "bermudan", dates), FLAT, 1e-7))
    assert gaps[0] > gaps[1] > gaps[2] > 0.0
    assert gaps[1] / gaps[2] == pytest.approx(4.0, rel=0.15)  # first order


@needs_kernel
def test_a_window_that_opens_later_is_worth_less():
    values = [
        value(Option("put", 100.0, 1.0, exercise_start=start), FLAT, 1e-7) for start in (0.0, 0.25, 0.75, 1.0)
    ]
    assert np.all(np.diff(values) < 0.0)
    assert values[-1] == pytest.approx(value(Option("put", 100.0, 1.0, "european"), FLAT), abs=1e-9)


def test_a_bermudan_option_may_be_worth_less_than_exercise_now():
    deep = price(Option("put", 100.0, 1.0, "bermudan", (0.5,)), Market(50.0, 0.1, 0.2))
    assert deep.price < deep.intrinsic_value
    assert not deep.exercise_now
    assert deep.exercise_boundary is None


# Derivatives.


@needs_kernel
@pytest.mark.parametrize("name", CONTRACTS)
def test_greeks_are_differences_of_prices(name):
    option, market = CONTRACTS[name]
    found = price(option, market, tolerance=1e-7)
    step = 0.05
    up, down = (price(option, replace(market, spot=100.0 + by), tolerance=TIGHT) for by in (step, -step))
    assert found.delta == pytest.approx((up.price - down.price) / (2.0 * step), abs=2e-5)
    assert found.gamma == pytest.approx((up.delta - down.delta) / (2.0 * step), abs=2e-5)
    if not isinstance(market.volatility, PiecewiseConstant):
        step = 5e-3 * market.volatility
        bumped = [value(option, replace(market, volatility=market.volatility + by)) for by in (step, -step)]
        allowed = 2e-3 + found.greek_errors["vega"]
        assert found.vega == pytest.approx((bumped[0] - bumped[1]) / (2.0 * step), abs=allowed)
    if market.cash_dividends and market.cash_dividends[0].amount > 0.01:
        moved = [
            value(option, replace(market, cash_dividends=(CashDividend(d.time, d.amount + by), *rest)))
            for by in (0.01, -0.01)
            for d, *rest in [market.cash_dividends]
        ]
        assert found.dividend_sensitivities[0] == pytest.approx((moved[0] - moved[1]) / 0.02, abs=2e-4)


@needs_kernel
def test_theta_is_the_change_of_the_value_as_time_passes():
    for name in ("put, quarterly dividends", "call, escrowed", "put, curves"):
        option, market = CONTRACTS[name]
        surface = value_surface(option, market, spots=[100.0], times=[0.0, 1e-3, 2e-3], tolerance=1e-8)
        now, soon, later = surface.value[:, 0]
        slope = (-3.0 * now + 4.0 * soon - later) / 2e-3
        assert price(option, market, tolerance=1e-7).theta == pytest.approx(slope, abs=5e-3)


@needs_kernel
def test_extended_greeks_are_differences_of_the_others():
    market = Market(
        100.0, {"times": [0.5, 1.0], "values": [0.03, 0.05]}, {"times": [0.4, 1.0], "values": [0.2, 0.3]}
    )
    found = price(PUT, market, tolerance=1e-7, greeks="extended")
    assert sum(found.rate_buckets) == pytest.approx(found.rho, abs=1e-3)
    assert sum(found.volatility_buckets) == pytest.approx(found.vega, abs=1e-3)
    up, down = (
        price(
            PUT,
            replace(market, volatility=PiecewiseConstant([0.4, 1.0], [0.2 + by, 0.3 + by])),
            tolerance=1e-8,
        )
        for by in (2e-3, -2e-3)
    )
    assert found.vanna == pytest.approx((up.delta - down.delta) / 4e-3, abs=1e-3)
    allowed = 0.05 + found.greek_errors["volga"]
    assert found.volga == pytest.approx((up.vega - down.vega) / 4e-3, rel=2e-2, abs=allowed)


@needs_kernel
def test_extended_greeks_of_a_flat_market():
    found = price(PUT, FLAT, tolerance=1e-7, greeks="extended")
    up, down = (price(PUT, replace(FLAT, volatility=0.25 + by), tolerance=1e-8) for by in (1e-3, -1e-3))
    assert found.vanna == pytest.approx((up.delta - down.delta) / 2e-3, abs=1e-3)
    assert found.volga == pytest.approx((up.vega - down.vega) / 2e-3, abs=0.05)
    assert found.rate_buckets is None
    constant = replace(FLAT, rate={"times": [2.0, 3.0], "values": [0.05, 0.07]})
    assert price(PUT, constant, greeks="extended").rate_buckets == pytest.approx(
        (price(PUT, FLAT).rho, 0.0), abs=1e-3
    )


# Boundaries, surfaces, tables.


@needs_kernel
def test_the_boundary_of_a_put_falls_to_zero_before_a_dividend():
    market = Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0, (0.5,)))
    found = exercise_boundary(PUT, market, times=[0.0, 0.1, 0.25, 0.4, 0.499, 0.5, 0.501, 0.8, 1.0])
    held = np.isnan(found.boundary)  # or too far from the strike to matter
    assert held[[0, 5, 6, 7, 8]].tolist() == [False, True, False, False, False]
    seen = np.flatnonzero(~held[3:5]) + 3
    # More than the interest until then the dividend pays at larger spots.
    interest = 100.0 * np.expm1(0.05 * (0.5 - found.time[seen]))
    assert (found.boundary[seen] < 1.2 * interest).all()
    assert found.boundary[0] == pytest.approx(price(PUT, market).exercise_boundary, abs=1e-2)
    assert found.boundary[-1] == 100.0
    alone = exercise_boundary(PUT, Market(100.0, 0.05, 0.25), times=[0.501, 0.8])
    np.testing.assert_allclose(found.boundary[6:8], alone.boundary, rtol=1e-4)


def test_the_default_times_of_a_boundary_hold_every_event():
    market = Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0))
    assert set(exercise_boundary(CALL, market).time) >= {0.0, 0.125, 0.375, 0.625, 0.875, 1.0}
    dates = exercise_boundary(Option("put", 100.0, 1.0, "bermudan", (0.5, 0.75)), FLAT)
    np.testing.assert_array_equal(dates.time, [0.0, 0.5, 0.75, 1.0])
    assert np.isnan(dates.boundary[0])
    assert np.all(np.diff(dates.boundary[1:]) > 0.0)


def test_two_boundaries_with_a_dividend_come_from_the_general_path():
    market = Market(100.0, -0.005, 0.1, -0.03, cash_dividends=cash(0.5, (0.8,)))
    found = exercise_boundary(PUT, market, times=[0.85, 0.9], tolerance=1e-4)
    assert np.all(found.other_boundary < found.boundary)
    assert price(PUT, market, tolerance=1e-5).status == "ok"


@needs_kernel
def test_a_surface_is_made_of_prices():
    option, market = CONTRACTS["call, dividends and a yield"]
    surface = value_surface(option, market, spots=[90.0, 110.0], times=[0.0, 0.5, 1.0], tolerance=1e-6)
    for j, spot in enumerate((90.0, 110.0)):
        found = price(option, replace(market, spot=spot), tolerance=1e-6)
        off = abs(surface.value[0, j] - found.price)
        assert off <= surface.error_estimate[0, j] + found.error_estimate
        assert surface.delta[0, j] == pytest.approx(found.delta, abs=1e-5)
    later = Market(110.0, 0.05, 0.25, 0.02, cash_dividends=cash(1.0, (0.125, 0.375)))
    assert surface.value[1, 1] == pytest.approx(value(Option("call", 100.0, 0.5), later), abs=2e-4)
    assert surface.value[2].tolist() == [0.0, 10.0]


@needs_kernel
def test_a_table_holds_what_single_prices_are():
    names = ["put, quarterly dividends", "call, curves", "put, monthly dates"]
    rows = [CONTRACTS[name] for name in names]
    columns = {
        "option_type": [option.option_type for option, _ in rows],
        "exercise": [option.exercise for option, _ in rows],
        "exercise_times": [list(option.exercise_times) for option, _ in rows],
        "spot": 100.0,
        "strike": 100.0,
        "expiry": 1.0,
        "rate": [market.rate for _, market in rows],
        "dividend_yield": [market.dividend_yield for _, market in rows],
        "volatility": [market.volatility for _, market in rows],
        "cash_dividends": [list(market.cash_dividends) for _, market in rows],
    }
    table = price_many(columns, tolerance=1e-6, threads=2)
    for row, (option, market) in enumerate(rows):
        alone = price(option, market, tolerance=1e-6)
        assert table["price"][row] == alone.price
        assert table["vega"][row] == alone.vega
        assert table["dividend_sensitivities"][row] == (alone.dividend_sensitivities or ())


def test_a_deadline_among_the_greeks_leaves_the_price(monkeypatch):
    """Without the kernel a walk back is long enough for a deadline to come in between."""
    monkeypatch.setattr("pricing_core.kernel.march_segments", None)
    contract = PUT, Market(100.0, 0.05, LocalVolatility([0.0], [80.0, 125.0], [[0.3, 0.2]]))
    alone, whole = Deadline(), Deadline()
    wanted = price(*contract, tolerance=1e-3, greeks="none", interrupt=alone)
    assert price(*contract, tolerance=1e-3, greeks="extended", interrupt=whole).status == "ok"
    assert whole.asked > alone.asked
    # How often the kernel asks depends on how long it takes: the first deadline that leaves a price is looked for.
    ends = (Deadline(at) for at in itertools.count((alone.asked + whole.asked + 1) // 2))
    found = next(
        found
        for end in ends
        if (found := price(*contract, tolerance=1e-3, greeks="extended", interrupt=end)).price is not None
    )
    assert (found.status, found.price, found.method) == ("deadline", wanted.price, "obstacle-march")
    assert found.volga is None
    assert price(*contract, interrupt=lambda: True).price is None


@needs_kernel
def test_each_of_four_dividends_has_its_sensitivity():
    dividends = cash(1.0, (0.2, 0.45, 0.7, 0.95))
    found = price(PUT, Market(100.0, 0.05, 0.25, cash_dividends=dividends), tolerance=1e-7)
    for k, sensitivity in enumerate(found.dividend_sensitivities):

        def value(by, k=k):
            moved = [{**dividend, "amount": 1.0 + by * (j == k)} for j, dividend in enumerate(dividends)]
            market = Market(100.0, 0.05, 0.25, cash_dividends=moved)
            return price(PUT, market, tolerance=1e-8, greeks="none").price

        far, near = ((value(step) - value(-step)) / (2.0 * step) for step in (0.16, 0.08))
        error = found.greek_errors["dividend_sensitivities"][k]
        assert sensitivity == pytest.approx(near + (near - far) / 3.0, abs=error + 1e-5)
        assert error < 1e-2


def test_a_piece_without_interest_has_its_rho():
    curve = PiecewiseConstant((0.5, 1.0), (0.05, 0.0))
    found = price(Option("put", 100.0, 1.0), Market(100.0, curve, 0.2), greeks="extended")
    assert sum(found.rate_buckets) == pytest.approx(found.rho, rel=0.02)
