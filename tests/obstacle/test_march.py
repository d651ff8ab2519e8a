"""Orders of convergence of the march: rows of (problem, where, true value, expected order)."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import norm

from pricing_core.american import Market, Option, price
from pricing_core.obstacle import Event, Obstacle, ObstacleProblem
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.march import march
from tests.obstacle.problems import (
    AMERICAN_CAPPED_CALL,
    CALL,
    CALLABLE_PUT,
    PUT,
    callable_put,
    capped_call,
    option,
    up_and_out_call,
)


def black_scholes(spot, *, call, rate, dividend_yield, volatility, expiry):
    deviation = volatility * np.sqrt(expiry)
    d1 = (np.log(spot) + (rate - dividend_yield) * expiry) / deviation + deviation / 2.0
    sign = 1.0 if call else -1.0
    forward, bond = spot * np.exp(-dividend_yield * expiry), np.exp(-rate * expiry)
    return sign * (forward * norm.cdf(sign * d1) - bond * norm.cdf(sign * (d1 - deviation)))


def up_and_out(spot, barrier, *, rate, dividend_yield, volatility, expiry):
    """Reiner and Rubinstein 1991, for a strike of 1 below the barrier."""
    deviation = volatility * np.sqrt(expiry)
    mu = (rate - dividend_yield) / volatility**2 - 0.5
    forward, bond = spot * np.exp(-dividend_yield * expiry), np.exp(-rate * expiry)

    def part(sign, ratio, power):
        x = np.log(ratio) / deviation + (1.0 + mu) * deviation
        return forward * power ** (2.0 * (mu + 1.0)) * norm.cdf(sign * x) - bond * power ** (
            2.0 * mu
        ) * norm.cdf(sign * (x - deviation))

    a, b = part(1.0, spot, 1.0), part(1.0, spot / barrier, 1.0)
    c, d = part(-1.0, barrier**2 / spot, barrier / spot), part(-1.0, barrier / spot, barrier / spot)
    return a - b + c - d


FLAT = {"rate": 0.05, "dividend_yield": 0.02, "volatility": 0.25, "expiry": 0.8}
TERMS = Market(1.05, 0.05, 0.25, dividend_yield=0.02)


@dataclass(frozen=True)
class Row:
    """A problem, the place where it is asked, its true value, and the order that is expected."""

    problem: ObstacleProblem
    spot: float
    true: float
    order: float


def engine(kind, market, expiry, **choices):
    return price(Option(kind, 1.0, expiry, **choices), market, tolerance=1e-8).price


def rows():
    cash = Event(0.3, lambda x: np.log(np.maximum(np.exp(x) - 0.04, 1e-9)))
    with_cash = Market(1.05, 0.05, 0.25, dividend_yield=0.02, cash_dividends=[(0.3, 0.04)])
    two = Market(1.0, -0.02, 0.1, dividend_yield=-0.06)
    running = option(CALL, american=False, source=lambda x: 0.07 * np.exp(x), **FLAT)
    return {
        "european put": Row(
            option(PUT, american=False, **FLAT), 1.05, black_scholes(1.05, call=False, **FLAT), 3.0
        ),
        "european call with a source": Row(
            running,
            1.05,
            black_scholes(1.05, call=True, **FLAT) + 0.07 * 1.05 * (1.0 - np.exp(-0.02 * 0.8)) / 0.02,
            3.0,
        ),
        "american put": Row(option(PUT, **FLAT), 1.05, engine("put", TERMS, 0.8), 3.0),
        "american put with a cash dividend": Row(
            option(PUT, events=[cash], **FLAT), 1.05, engine("put", with_cash, 0.8), 3.0
        ),
        "two boundaries": Row(
            option(PUT, rate=-0.02, dividend_yield=-0.06, volatility=0.1), 1.0, engine("put", two, 1.0), 3.0
        ),
        "callable put, away from its kink": Row(callable_put(), 0.9, CALLABLE_PUT[0.9], 3.0),
        "american capped call": Row(capped_call(), 1.0, AMERICAN_CAPPED_CALL, 3.0),
        "up-and-out call": Row(up_and_out_call(1.4, **FLAT), 1.05, up_and_out(1.05, 1.4, **FLAT), 3.0),
        "bermudan put": Row(
            option(PUT, american=False, lower=Obstacle(PUT.value, kinks=[0.0], at=[0.2, 0.5]), **FLAT),
            1.05,
            engine("put", TERMS, 0.8, exercise="bermudan", exercise_times=(0.2, 0.5)),
            3.0,
        ),
    }


ROWS = rows()


@pytest.mark.parametrize("name", ROWS)
def test_the_order_is_that_which_is_claimed(name):
    row = ROWS[name]
    at = np.log([row.spot])
    chosen = choose_map(row.problem, at)
    sizes = (2, 4, 8, 16)
    errors = [abs(float(march(row.problem, Grid.of(chosen, size)).now(at)[0]) - row.true) for size in sizes]
    fitted = -np.polyfit(np.log2(sizes), np.log2(np.maximum(errors, 1e-10)), 1)[0]
    assert errors[-1] < 3e-7
    # Steps are even numbers, and where the contact set's end lies in its cell is another on each grid.
    assert fitted > row.order - 0.6 or errors[-1] < 1e-8, errors


def test_the_right_angle_is_one_switch_away_and_loses_an_order():
    """At the nodes it is of second order, with a factor that depends on where in its cell the boundary lies."""
    spots = np.array([0.85, 0.95, 1.05, 1.2])
    true = np.array([engine("put", Market(spot, 0.05, 0.25, dividend_yield=0.02), 0.8) for spot in spots])
    problem = option(PUT, **FLAT)
    chosen = choose_map(problem, np.zeros(1))
    for size, gain in ((4, 5.0), (8, 10.0), (16, 20.0)):
        grid = Grid.of(chosen, size)
        averaged, nodal = (
            np.sqrt(np.mean((march(problem, grid, complementarity=kind).now(np.log(spots)) - true) ** 2))
            for kind in ("averaged", "right-angle")
        )
        assert nodal > gain * averaged, size
