from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, price, value_surface
from pricing_core.american.book.prices import prices
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
