"""Orders of convergence of the march: rows of (problem, where, true value, expected order)."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import norm

from pricing_core.american import Market, Option, price
from pricing_core.obstacle import Diffusion, Event, Obstacle, ObstacleProblem
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.march import march, time_mesh
from pricing_core.obstacle.moment import Segment
from pricing_core.stepping import SDIRK3
from tests.obstacle.problems import (
    AMERICAN_CAPPED_CALL,
    CALL,
    CALLABLE_PUT,
    PRICES,
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
SPOTS = (0.9, 0.97, 1.05, 1.2)


@dataclass(frozen=True)
class Row:
    """A problem, the prices at which it is asked, its true values there, the order that is expected, and the digits.

    Beside a moving boundary the start of a segment leaves a small error of second order, which is what remains of the
    American puts on fine grids.
    """

    problem: ObstacleProblem
    true: dict[float, float]
    order: float = 3.0
    accuracy: float = 1e-9


def engine(kind, expiry, **choices):
    """The option engine's prices at SPOTS; of a market's terms where they are given, the contract's otherwise."""
    terms = {"rate": 0.05, "volatility": 0.25, "dividend_yield": 0.02}
    terms |= {name: choices.pop(name) for name in (*terms, "cash_dividends") if name in choices}
    return {
        spot: price(Option(kind, 1.0, expiry, **choices), Market(spot, **terms), tolerance=1e-8).price
        for spot in SPOTS
    }


def rows():
    cash = Event(0.3, lambda x: np.log(np.maximum(np.exp(x) - 0.04, 1e-9)))
    call = {spot: black_scholes(spot, call=True, **FLAT) for spot in SPOTS}
    earned = (
        0.07 * (1.0 - np.exp(-0.02 * 0.8)) / 0.02
    )  # of S paid at 7 % a year until the horizon, for each S
    two = {"rate": -0.02, "dividend_yield": -0.06, "volatility": 0.1}
    dates = {"exercise": "bermudan", "exercise_times": (0.2, 0.5)}
    on_dates = Obstacle(PUT.value, kinks=[0.0], at=[0.2, 0.5])
    barrier = {spot: up_and_out(spot, 1.4, **FLAT) for spot in SPOTS}
    return {
        "european put": Row(
            option(PUT, american=False, **FLAT),
            {spot: black_scholes(spot, call=False, **FLAT) for spot in SPOTS},
        ),
        "european call with a source": Row(
            option(CALL, american=False, source=lambda x: 0.07 * np.exp(x), **FLAT),
            {spot: value + earned * spot for spot, value in call.items()},
        ),
        "american put": Row(option(PUT, **FLAT), engine("put", 0.8), order=2.5),
        "american put with a cash dividend": Row(
            option(PUT, events=[cash], **FLAT), engine("put", 0.8, cash_dividends=[(0.3, 0.04)]), order=2.3
        ),
        "two boundaries": Row(option(PUT, **two), engine("put", 1.0, **two)),
        "callable put": Row(callable_put(), {0.9: CALLABLE_PUT[0.9], 1.1: CALLABLE_PUT[1.1]}, accuracy=1e-7),
        "american capped call": Row(capped_call(), {1.0: AMERICAN_CAPPED_CALL}, accuracy=1e-7),
        "up-and-out call": Row(up_and_out_call(1.4, **FLAT), barrier),
        "bermudan put": Row(option(PUT, american=False, lower=on_dates, **FLAT), engine("put", 0.8, **dates)),
    }


ROWS = rows()


@pytest.mark.parametrize("name", ROWS)
def test_the_order_is_that_which_is_expected(name):
    row = ROWS[name]
    at, true = np.log([*row.true]), np.array([*row.true.values()])
    chosen = choose_map(row.problem, at)
    sizes = (2, 4, 8, 16)
    errors = [
        float(np.sqrt(np.mean((march(row.problem, Grid.of(chosen, size)).now(at) - true) ** 2)))
        for size in sizes
    ]
    seen = [k for k, error in enumerate(errors) if error > row.accuracy]
    fitted = -np.polyfit(np.log2(sizes)[seen], np.log2(errors)[seen], 1)[0]
    # Where the contact set's end lies in its cell is another on each grid.
    assert errors[-1] < 2e-7
    assert fitted > row.order - 0.4, errors


def test_the_right_angle_is_one_switch_away_and_loses_an_order():
    """At the nodes it is of second order, with a factor that depends on where in its cell the boundary lies."""
    spots = np.array(SPOTS)
    true = np.array([*engine("put", 0.8).values()])
    problem = option(PUT, **FLAT)
    chosen = choose_map(problem, np.zeros(1))
    for size, gain in ((4, 5.0), (8, 10.0), (16, 15.0)):
        grid = Grid.of(chosen, size)
        averaged, nodal = (
            np.sqrt(np.mean((march(problem, grid, complementarity=kind).now(np.log(spots)) - true) ** 2))
            for kind in ("averaged", "right-angle")
        )
        assert nodal > gain * averaged, size


@pytest.mark.parametrize("refined", [1, 4, 8])
def test_first_steps_are_as_long_as_the_grid_resolves_in_segments_of_any_length(refined):
    """With half of that a put with a dividend shortly before expiry is off by ten times as much."""
    waves = (0.25, lambda x, t: 0.25 + 0.1 * np.sin(9.0 * t))
    for volatility in waves:
        for duration in (0.01, 0.05, 0.3, 2.0):
            problem = ObstacleProblem(Diffusion(volatility, 0.0, -0.03), PUT, 2.0, lower=PUT, ends=PRICES)
            grid = Grid.of(choose_map(problem, np.zeros(1)), refined)
            segment = Segment(problem, grid, 2.0 - duration, 2.0)
            steps = [late - early for early, late, _ in time_mesh(segment)]
            spread = 0.25**2 / 2.0 * steps[0] / (grid.x[1] - grid.x[0]) ** 2
            assert spread >= 0.9 / (12.0 * SDIRK3.a[0][0]) or steps[0] > 0.22 * duration
            assert len(steps) >= min(refined, 2)


def test_no_stage_of_a_step_lies_beyond_its_end():
    """Rounding would carry the last one across a time at which coefficients jump, to the other side's values."""
    rng = np.random.default_rng(3)
    for time in rng.uniform(0.1, 0.7, 60).tolist():
        diffusion = Diffusion(lambda x, t, time=time: 0.1 if t < time else 0.3, 0.0, 0.05, breaks=[time])
        problem = ObstacleProblem(diffusion, PUT, 0.8, ends=PRICES)
        (part,) = march(problem, Grid.of(choose_map(problem, np.zeros(1)), 1)).parts
        assert time in [instant.t for instant in part.instants]
        for step, end in zip(part.steps, part.instants[1:], strict=True):
            assert min(stage.t for stage in step.stages) >= end.t


def test_steps_between_breaks_are_halved_from_grid_to_grid():
    """Else the differences of grids, which tell the error, fall by chance where there are many breaks."""
    breaks = np.sort(np.random.default_rng(3).uniform(0.0, 1.0, 12))

    def volatility(x, t):
        return np.full(x.shape, np.interp(t, breaks, np.where(np.arange(12) % 2, 0.15, 0.35)))

    diffusion = Diffusion(volatility, 0.0, 0.05, breaks=breaks)
    problem = ObstacleProblem(diffusion, PUT, 1.0, lower=PUT, ends=("exponential", "exponential"))
    chosen = choose_map(problem, np.zeros(1))
    meshes = [
        np.array([early for early, _, _ in time_mesh(Segment(problem, Grid.of(chosen, refined), 0.0, 1.0))])
        for refined in (4, 8, 16)
    ]
    assert all(np.isin(breaks, mesh).all() for mesh in meshes)
    for coarse, fine in pairwise(meshes):
        assert np.abs(coarse[:, None] - fine).min(axis=1).max() < 1e-12
        assert coarse.size < fine.size <= 2 * coarse.size
