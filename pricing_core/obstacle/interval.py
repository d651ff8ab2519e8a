"""The interval and the map of its nodes: wide enough for the places asked for, kinks that hold V on nodes."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.march_settings import CELLS, LEAST_CELLS, MOST_COARSE_CELLS, WIDTH
from pricing_core.obstacle.ends import Held, measure
from pricing_core.obstacle.grid import GridMap, grid_map
from pricing_core.obstacle.moment import holding_jump
from pricing_core.obstacle.problem import ObstacleProblem

LARGEST_EXPONENT = 600.0  # Largest x of an end behind which V goes on as e^x, which overflows at 709; chosen.
PLACES = 65  # at which the volatility is looked at
TIMES = 16  # of each segment
# Standard deviations beyond an end at which the payoff is looked at, and what rounding may make of equal ones.
BEYOND = np.array([1e-3, *np.arange(1.0, 13.0) / 4.0])
EQUAL = 1e-9
# Where the volatility varies by more than `EVEN`, cells go with it, between these shares of its mean, smoothed over so
# many cells; it is looked at in `FINE` places of each.
EVEN, SLOWEST, FASTEST, SMOOTH, FINE = 1.25, 0.25, 4.0, 1.0, 8
# Standard deviations up to which a kink of the payoff is looked for beyond the places, and behind which an end lies.
KINKS_WITHIN, BEHIND_KINKS = 8.0, 2.5


def choose_map(problem: ObstacleProblem, at: Vector) -> GridMap:
    """Return the map of the coarsest grid for a problem that is asked at places, shape (m,).

    Raises
    ------
    InvalidInputError
        A place lies outside the interval that is given.
    """
    left, right, deviation = _reach(problem, at)
    if (
        problem.ends[1] == "exponential"
    ):  # what grows as e^x is worth most where its own measure lies, further right
        right = min(right + deviation * deviation, max(right, LARGEST_EXPONENT))
    for kink in problem.payoff.kinks_at(problem.horizon).tolist():
        if at.min() - KINKS_WITHIN * deviation < kink < at.max() + KINKS_WITHIN * deviation:
            behind = BEHIND_KINKS * deviation
            left, right = min(left, kink - behind), max(right, kink + behind)
    given_left, given_right = problem.interval
    left, right = left if given_left is None else given_left, right if given_right is None else given_right
    outside = (at < left) | (at > right)
    if outside.any() or not left < right:
        shown = Told(f"{float(at[outside][0]) if outside.any() else float(at[0]):g}")
        raise InvalidInputError("at", shown, f"inside the interval, {left:g} to {right:g}")
    cells = max(LEAST_CELLS, math.ceil((right - left) / (2.0 * WIDTH * deviation) * CELLS))
    kinks = _holding_kinks(problem, left, right)
    gaps = np.diff(np.unique([left, *kinks, right]))
    if kinks.size > 1:
        cells = max(cells, math.ceil((right - left) / float(gaps.min()) * 1.5))
    cells = min(cells, MOST_COARSE_CELLS)
    if kinks.size == 0 and problem.diffusion.functions[0].has_x:
        stretched = _with_the_volatility(problem, left, right, deviation)
        if stretched is not None:
            return stretched
    return grid_map(left, right, cells + cells % 2, kinks, (given_left is not None, given_right is not None))


def _with_the_volatility(
    problem: ObstacleProblem, left: float, right: float, deviation: float
) -> GridMap | None:
    """Return a map whose cells are as wide as the volatility is large; None where that varies little.

    The volatility is the root of its mean square over time, cut at shares of its mean and smoothed over a cell.
    """
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415  even grids do without it

    size = 2.0 * WIDTH * deviation / CELLS
    places = np.linspace(left, right, FINE * math.ceil((right - left) / size) + 1)
    function, variance = problem.diffusion.functions[0], np.zeros(places.size)
    for start, end in problem.segments:
        times = (
            start + (end - start) * (np.arange(TIMES) + 0.5) / TIMES if function.has_t else np.array([start])
        )
        squares = [function(places, t) ** 2 for t in times.tolist()]
        variance += (end - start) * np.mean(squares, axis=0)
    own = np.clip(np.sqrt(variance) / deviation, SLOWEST, FASTEST)
    if own.max() <= EVEN * own.min():
        return None
    reach = round(SMOOTH * FINE)
    weights = np.exp(-0.5 * (np.arange(-3 * reach, 3 * reach + 1) / reach) ** 2)
    padded = np.pad(1.0 / own, 3 * reach, mode="edge")
    density = np.convolve(padded, weights / weights.sum(), mode="valid")
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(places)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    cells = max(LEAST_CELLS, math.ceil(length[-1] / size))
    cells = min(cells + cells % 2, MOST_COARSE_CELLS)
    knots = np.linspace(0.0, 1.0, cells // 2 + 1) * length[-1]
    found = make_interp_spline(length, places, k=3)(knots)
    found[[0, -1]] = left, right
    return GridMap(left, right, cells, make_interp_spline(2.0 * np.arange(knots.size), found, k=5))


def left_out(problem: ObstacleProblem, chosen: GridMap, at: Vector) -> Vector:
    """Return an estimate of what a payoff beyond the ends that were chosen is worth at places, money, shape (m,).

    It is what the payoff is there beside the continuation that the end's rule makes of it, times the probability to get
    there.
    """
    left, right, deviation = _reach(problem, at)
    found = np.zeros(at.size)
    for end, given, rule, reach, outwards in (
        (chosen.left, problem.interval[0], problem.ends[0], left, -1.0),
        (chosen.right, problem.interval[1], problem.ends[1], right, 1.0),
    ):
        if given is not None or isinstance(rule, Held):
            continue
        places = np.concatenate([[end, end - outwards * chosen.size], end + outwards * deviation * BEYOND])
        share = measure(rule, places)  # type: ignore[arg-type]  # a number has become Held
        payoff = problem.payoff(places, problem.horizon)
        continued = payoff[0] + (payoff[1] - payoff[0]) * share[2:] / share[1]
        missed = np.abs(payoff[2:] - continued)
        missed[missed <= EQUAL * np.abs(payoff[2:])] = 0.0
        furthest = at.max() if outwards > 0.0 else at.min()
        away = np.abs(at - furthest)[:, None] + outwards * (places[2:] - reach)
        found = np.maximum(found, (missed * ndtr(-WIDTH - away / deviation)).max(axis=1))
    return found


def _reach(problem: ObstacleProblem, at: Vector) -> tuple[float, float, float]:
    """Return how far x comes, left and right, and its standard deviation at the horizon."""
    volatility, drift, _ = problem.diffusion.functions
    ends = [
        end if end is not None else sign * math.inf
        for end, sign in zip(problem.interval, (-1, 1), strict=True)
    ]
    low, high, variance = float(at.min()), float(at.max()), 0.0
    pieces = TIMES if callable(volatility.given) or callable(drift.given) else 1
    for start, end in reversed(problem.segments):
        duration = end - start
        for t in start + duration * (np.arange(pieces) + 0.5) / pieces:
            spread = 2.0 * math.sqrt(variance)
            places = np.linspace(max(low - spread, ends[0]), min(high + spread, ends[1]), PLACES)
            variance += duration / pieces * float(np.mean(volatility(places, t) ** 2))
            reached = np.clip(np.array([low, high]), ends[0], ends[1])
            low, high = (reached + duration / pieces * drift(reached, t)).tolist()
            low, high = min(low, float(at.min())), max(high, float(at.max()))
        for event in problem.at_event(end):
            move, _ = event.functions
            if move is not None:
                moved = move(np.clip(np.array([low, high]), ends[0], ends[1]), end)
                low, high = min(low, float(moved[0])), max(high, float(moved[1]))
    if not variance > 0.0:
        raise InvalidInputError("volatility", Told("0 at every x"), "above 0 at every x and t")
    deviation = math.sqrt(variance)
    return low - WIDTH * deviation, high + WIDTH * deviation, deviation


def _holding_kinks(problem: ObstacleProblem, left: float, right: float) -> Vector:
    """Return the kinks that may hold V in a point and do not move, in order, shape (k,)."""
    found = []
    width = (right - left) / CELLS
    for obstacle, sign in zip(problem.obstacles, (1.0, -1.0), strict=True):
        if obstacle is None or (obstacle.during is None and obstacle.at is not None):
            continue
        t = 0.5 * problem.horizon if obstacle.during is None else 0.5 * sum(obstacle.during)
        for kink, function in zip(obstacle.kinks_at(t), obstacle.kink_functions, strict=True):
            if (
                not function.has_t
                and left < kink < right
                and holding_jump(obstacle, sign, kink, width, t) > 0.0
            ):
                found.append(float(kink))
    return np.unique(found)
