"""From the value after an event to the values at the nodes before it, with what the hats see of its kinks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.obstacle.ends import Held
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.moment import ROUNDING, Moment
from pricing_core.obstacle.problem import ObstacleProblem, just_before

SECANTS = 6  # towards a crossing inside a cell: each gains half the digits again
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
ValueOf = Callable[[Vector], Vector]


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A value as a function of x, and the places where it is not smooth."""

    value: ValueOf
    kinks: Vector  # (k,)


def payoff_of(problem: ObstacleProblem) -> Known:
    """Return the value at the horizon."""
    payoff, horizon = problem.payoff, problem.horizon
    return Known(lambda x: payoff(x, horizon), payoff.kinks_at(horizon))


def before(problem: ObstacleProblem, grid: Grid, time: float, after: Known) -> Known:
    """Return the value just before a time, from that just after it.

    Raises
    ------
    InvalidInputError
        The payoff lies outside its obstacles.
    """
    events = problem.at_event(time)
    for event in reversed(events):
        move, cash = event.functions
        after = _moved(grid, time, after, move, cash)
    asked = just_before(time)
    kinks = list(after.kinks)
    value = after.value
    bounds: list[tuple[ValueOf, float]] = []
    for obstacle, sign in zip(problem.obstacles, (1.0, -1.0), strict=True):
        if obstacle is None or not obstacle.acts_at(time):
            continue

        def bound(x: Vector, obstacle: Callable[[Vector, float], Vector] = obstacle) -> Vector:
            return obstacle(x, asked)

        gap = sign * (value(grid.x) - bound(grid.x))
        if time == problem.horizon and not events:
            _check_payoff(grid, value(grid.x), gap, "lower" if sign > 0.0 else "upper")
        crossings = _crossings(grid, lambda x, bound=bound: value(x) - bound(x))  # type: ignore[misc]
        if crossings.size or (gap < 0.0).any():
            held = obstacle.kinks_at(asked)
            at_held = sign * (value(held) - bound(held)) <= 0.0 if held.size else np.zeros(0, dtype=bool)
            kinks = [*kinks, *crossings, *held[at_held]]
        bounds.append((bound, sign))

    def clipped(x: Vector) -> Vector:
        found = value(x)
        for bound, sign in bounds:
            found = np.maximum(found, bound(x)) if sign > 0.0 else np.minimum(found, bound(x))
        return found

    return Known(clipped, np.unique(kinks))


def start_values(
    problem: ObstacleProblem, moment: Moment, grid: Grid, known: Known, t: float
) -> tuple[Vector, Vector]:
    """Return the values at the nodes, and those that a first step starts from, both of shape (n,).

    At a kink the compact scheme's sum over three nodes is not the integral against the hat, which the second replaces.
    """
    value = known.value(grid.x).copy()
    seen = value.copy()
    kinks = list(grid.index(known.kinks)) if known.kinks.size else []
    for end, node in zip(problem.ends, (0, grid.x.size - 1), strict=True):
        if isinstance(end, Held):
            held = float(
                np.clip(end.at(t), *(side[min(node, 1)] for side in (moment.lower_ends, moment.upper_ends)))
            )
            if held != value[node]:
                kinks.append(float(node))
            value[node] = seen[node] = held
    last = grid.x.size - 2
    near = {i for y in kinks for i in (math.floor(y), math.floor(y) + 1, math.ceil(y) - 1)}
    nodes = sorted(i for i in near if 1 <= i <= last)
    if not nodes:
        return value, seen
    missing = np.zeros(grid.x.size - 2)
    peclet, inverse = moment.scheme.peclet, 1.0 / moment.scheme.diffusion
    for i in nodes:
        cuts = np.unique([-1.0, 0.0, 1.0, *(y - i for y in kinks if -1.0 < y - i < 1.0)])
        middle, half = (cuts[1:] + cuts[:-1]) / 2.0, (cuts[1:] - cuts[:-1]) / 2.0
        u = (middle[:, None] + half[:, None] * GAUSS_NODES).ravel()
        weights = (half[:, None] * GAUSS_WEIGHTS).ravel()
        away = np.abs(u)
        hat = 1.0 - away + 0.5 * peclet[i] * np.sign(u) * (away - away * away)
        integral = float(weights @ (hat * known.value(grid.place(i + u))))
        missing[i - 1] = (
            integral
            - (1.0 / 12.0 - peclet[i] / 24.0) * seen[i - 1]
            - 10.0 / 12.0 * seen[i]
            - (1.0 / 12.0 + peclet[i] / 24.0) * seen[i + 1]
        ) * inverse[i]
    weights = moment.scheme.weights[:, 1:-1]
    bands = np.zeros((3, missing.size))
    bands[0, 1:], bands[1], bands[2, :-1] = weights[2, :-1], weights[1], weights[0, 1:]
    seen[1:-1] += solve_banded((1, 1), bands, missing)
    return value, seen


def _moved(grid: Grid, time: float, after: Known, move: object, cash: object) -> Known:
    """Return V(move(x)) + cash(x) and its kinks."""

    def value(x: Vector) -> Vector:
        found = after.value(x if move is None else move(x, time))  # type: ignore[operator]
        return found if cash is None else found + cash(x, time)  # type: ignore[operator]

    if move is None:
        return Known(value, after.kinks)
    found = [_crossings(grid, lambda x, kink=kink: move(x, time) - kink) for kink in after.kinks]  # type: ignore[operator,misc]
    return Known(value, np.concatenate(found) if found else np.zeros(0))


def _crossings(grid: Grid, function: ValueOf) -> Vector:
    """Return the zeros of a function between nodes at which it has two signs, by secants, shape (k,)."""
    at_nodes = function(grid.x)
    positive = at_nodes > ROUNDING * max(1.0, float(np.abs(at_nodes).max()))
    cells = np.flatnonzero(positive[1:] != positive[:-1])
    if cells.size == 0:
        return np.zeros(0)
    left, right = grid.x[cells].copy(), grid.x[cells + 1].copy()
    low, high = at_nodes[cells].copy(), at_nodes[cells + 1].copy()
    found = left
    for _ in range(SECANTS):
        spread = high - low
        found = np.where(
            spread == 0.0, left, left - low * (right - left) / np.where(spread == 0.0, 1.0, spread)
        )
        found = np.clip(found, left, right)
        value = function(found)
        stays_left = (value > 0.0) == (low > 0.0)
        left, low = np.where(stays_left, found, left), np.where(stays_left, value, low)
        right, high = np.where(stays_left, right, found), np.where(stays_left, high, value)
    return found


def _check_payoff(grid: Grid, value: Vector, gap: Vector, name: str) -> None:
    scale = ROUNDING * max(1.0, float(np.abs(value).max()))
    if (gap < -scale).any():
        first = int(np.argmin(gap))
        place = Told(f"{value[first]:g} at x = {grid.x[first]:.6g}")
        side = "at least" if name == "lower" else "at most"
        raise InvalidInputError("payoff", place, f"{side} the {name} obstacle, which acts at the horizon")
