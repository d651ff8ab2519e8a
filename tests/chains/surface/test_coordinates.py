"""Forwards, dividends due, and the martingale behind the spot, against the option engine."""

import math

import numpy as np
import pytest

from pricing_core.american import Market, PiecewiseConstant, price_many
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.errors import InvalidInputError

DIVIDENDS = tuple({"time": time, "amount": 1.5} for time in (0.2, 0.45, 0.7, 0.95))
MARKET = Market(
    100.0,
    rate=PiecewiseConstant([0.3, 1.0], [0.02, 0.05]),
    volatility=0.2,
    dividend_yield=0.01,
    borrow_rate=0.005,
    cash_dividends=DIVIDENDS,
    proportional_dividends=({"time": 0.45, "fraction": 0.02},),
)


@pytest.mark.parametrize("time", [0.1, 0.2, 0.44, 0.45, 0.8, 1.0])
def test_the_forward_is_that_of_european_parity(time):
    columns = {
        "option_type": ["call", "put"],
        "exercise": "european",
        "spot": 100.0,
        "strike": 95.0,
        "expiry": time,
        "rate": {"times": [0.3, 1.0], "values": [0.02, 0.05]},
        "dividend_yield": 0.01,
        "borrow_rate": 0.005,
        "volatility": 0.1,
        "cash_dividends": list(DIVIDENDS),
        "proportional_dividends": [{"time": 0.45, "fraction": 0.02}],
    }
    call, put = price_many(columns, tolerance=1e-8)["price"]
    coordinates = Coordinates(MARKET, 1.0)
    forward = 95.0 + (call - put) / coordinates.discount(time)
    assert coordinates.forward(time) == pytest.approx(forward, rel=1e-7)


def test_what_is_due_falls_by_each_dividend_and_the_rest_of_the_forward_does_not_jump():
    coordinates = Coordinates(MARKET, 1.0)
    for dividend in DIVIDENDS[:1] + DIVIDENDS[2:]:
        before, after = dividend["time"] - 1e-12, dividend["time"]
        assert coordinates.due(before) - coordinates.due(after) == pytest.approx(1.5, abs=1e-9)
        rest = [coordinates.forward(time) - coordinates.due(time) for time in (before, after)]
        assert rest[0] == pytest.approx(rest[1], rel=1e-10)
    assert coordinates.due(1.0) == 0.0
    assert Coordinates(MARKET, 0.5).due(0.45) == 0.0


@pytest.mark.parametrize("time", [0.1, 0.5, 1.0])
def test_variance_and_volatility_are_inverse_and_their_derivatives_those_of_differences(time):
    coordinates, h = Coordinates(MARKET, 1.0), 1e-6
    strike = np.linspace(70.0, 140.0, 15)
    volatility = 0.25 + 0.1 * np.log(strike / 100.0) ** 2
    variance, by_volatility = coordinates.variance(volatility, strike, time)
    back, by_variance = coordinates.volatility(variance, strike, time)
    assert back == pytest.approx(volatility, rel=1e-10)
    assert by_variance * by_volatility == pytest.approx(np.ones(15), rel=1e-7)
    up = coordinates.variance(volatility + h, strike, time)[0]
    down = coordinates.variance(volatility - h, strike, time)[0]
    assert by_volatility == pytest.approx((up - down) / (2 * h), rel=1e-5)


def test_strikes_up_to_what_is_due_have_no_coordinate():
    coordinates = Coordinates(MARKET, 1.0)
    due = coordinates.due(0.1)
    assert coordinates.x(due, 0.1) == -math.inf
    assert np.isnan(coordinates.variance(np.array([0.2]), np.array([due]), 0.1)[0][0])
    assert coordinates.strike(coordinates.x(90.0, 0.1), 0.1) == pytest.approx(90.0)


def test_escrowed_dividends_and_those_worth_the_spot_are_refused():
    escrowed = Market(100.0, rate=0.0, volatility=0.2, cash_dividends=DIVIDENDS, dividend_model="escrowed")
    with pytest.raises(InvalidInputError, match="dividend_model"):
        Coordinates(escrowed, 1.0)
    with pytest.raises(InvalidInputError, match="cash_dividends"):
        Coordinates(Market(5.0, rate=0.0, volatility=0.2, cash_dividends=DIVIDENDS), 1.0)
