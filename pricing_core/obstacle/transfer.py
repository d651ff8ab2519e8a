"""From the value after an event to the values at the nodes before it, with what the hats see of its kinks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.obstacle.ends import Held
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.moment import ROUNDING, Moment, check_order
from pricing_core.obstacle.problem import ObstacleProblem, just_before

SECANTS = 6  # towards a crossing inside a cell: each gains half the digits again
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
ValueOf = Callable[[Vector], Vector]


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A value as a function of x.

    Parameters
    ----------
    value : callable
        The values at x, shape (m,).
    kinks : Vector, shape (k,)
        The places where it is not smooth.
    nodal : callable
        How the values at x depend on those at the nodes at the end of the segment before, shape (m, n).
    waiting : callable, optional
        The values that the obstacles have not touched yet, at a time at which they act.
    """

    value: ValueOf
    kinks: Vector
    nodal: Callable[[Vector], Matrix]
    waiting: ValueOf | None = None


def payoff_of(problem: ObstacleProblem, grid: Grid) -> Known:
    """Return the value at the horizon."""
    payoff, horizon, n = problem.payoff, problem.horizon, grid.x.size
    return Known(lambda x: payoff(x, horizon), payoff.kinks_at(horizon), lambda x: np.zeros((x.size, n)))


def before(problem: ObstacleProblem, grid: Grid, time: float, after: Known, *, checked: bool = True) -> Known:
    """Return the value just before a time, from that just after it.

    Parameters
    ----------
    checked : bool
        Whether a payoff outside its obstacles is refused.

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
        if checked and time == problem.horizon and not events:
            _check_payoff(grid, value(grid.x), gap, "lower" if sign > 0.0 else "upper")
        crossings = _crossings(grid, lambda x, bound=bound: value(x) - bound(x))  # type: ignore[misc]
        if crossings.size or (gap < 0.0).any():
            held = obstacle.kinks_at(asked)
            at_held = sign * (value(held) - bound(held)) <= 0.0 if held.size else np.zeros(0, dtype=bool)
            kinks = [*kinks, *crossings, *held[at_held]]
        bounds.append((bound, sign))
    if len(bounds) == len(problem.obstacles):
        check_order(grid.x, *(bound(grid.x) for bound, _ in bounds))

    def clipped(x: Vector) -> Vector:
        found = value(x)
        for bound, sign in bounds:
            found = np.maximum(found, bound(x)) if sign > 0.0 else np.minimum(found, bound(x))
        return found

    def nodal(x: Vector) -> Matrix:
        is_free = np.ones(x.size, dtype=bool)
        for bound, sign in bounds:
            is_free &= sign * (value(x) - bound(x)) >= 0.0
        found: Matrix = after.nodal(x) * is_free[:, None]
        return found

    return Known(clipped, np.unique(kinks), nodal, value)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What the first step of a segment starts from, as a linear function of the values at nodes and at further points.

    At a kink the compact scheme's sum over three nodes is not the integral against the hat: their difference, brought
    back by the scheme's weights, is added to the values at the nodes.

    Parameters
    ----------
    held : dict of int to float
        The values at ends where one is held.
    rows : Vector of int, shape (k,)
        The nodes with a kink under their hats.
    points, integral : Matrix, shape (k, q)
        Where the value is asked, and the weights of the integral there.
    sums : Matrix, shape (k, 3)
        Weights of the scheme's sum.
    inverse : Vector, shape (k,)
        1/D at these nodes.
    bands : Matrix, shape (3, n - 2)
        The matrix of the scheme's weights.
    """

    held: dict[int, float]
    rows: NDArray[np.intp]
    points: Matrix
    integral: Matrix
    sums: Matrix
    inverse: Vector
    bands: Matrix

    @classmethod
    def of(cls, problem: ObstacleProblem, moment: Moment, grid: Grid, known: Known, t: float) -> Start:
        """Prepare the start of a segment, at whose end the value is known."""
        kinks = grid.index(known.kinks).tolist() if known.kinks.size else []
        held = {}
        last = grid.x.size - 1
        for node, end in zip((0, last), problem.ends, strict=True):
            if isinstance(end, Held):
                side = min(node, 1)
                held[node] = float(np.clip(end.at(t), moment.lower_ends[side], moment.upper_ends[side]))
                kinks.append(float(node))
        near = {i for y in kinks for i in (math.floor(y), math.floor(y) + 1, math.ceil(y) - 1)}
        rows = np.array(sorted(i for i in near if 1 <= i < last), dtype=np.intp)
        pieces = max((len(_cuts(i, kinks)) - 1 for i in rows.tolist()), default=0)
        u, integral = (np.zeros((rows.size, pieces * GAUSS_NODES.size)) for _ in range(2))
        peclet = moment.scheme.peclet[rows]
        for k, i in enumerate(rows.tolist()):
            cuts = _cuts(i, kinks)
            middle, half = (cuts[1:] + cuts[:-1]) / 2.0, (cuts[1:] - cuts[:-1]) / 2.0
            places = (middle[:, None] + half[:, None] * GAUSS_NODES).ravel()
            away = np.abs(places)
            hat = 1.0 - away + 0.5 * peclet[k] * np.sign(places) * (away - away * away)
            u[k, : places.size] = places
            integral[k, : places.size] = (half[:, None] * GAUSS_WEIGHTS).ravel() * hat
        sums = np.column_stack(
            [1.0 / 12.0 - peclet / 24.0, np.full(rows.size, 10.0 / 12.0), 1.0 / 12.0 + peclet / 24.0]
        )
        weights = moment.scheme.weights[:, 1:-1]
        bands = np.zeros((3, last - 1))
        bands[0, 1:], bands[1], bands[2, :-1] = weights[2, :-1], weights[1], weights[0, 1:]
        return cls(
            held,
            rows,
            grid.place(rows[:, None] + u),
            integral,
            sums,
            1.0 / moment.scheme.diffusion[rows],
            bands,
        )

    def values(self, known: Known, grid: Grid) -> tuple[Vector, Vector]:
        """Return the values at the nodes, and those that a first step starts from, both of shape (n,)."""
        value = known.value(grid.x).copy()
        for node, held in self.held.items():
            value[node] = held
        return value, self.seen(value, known.value(self.points.ravel()).reshape(self.points.shape))

    def seen(self, value: Vector, at_points: Matrix) -> Vector:
        """Return what a first step starts from, shape (n,), given the values at the nodes (n,) and at the points."""
        seen = value.copy()
        if self.rows.size:
            missing = np.zeros(value.size - 2)
            around = value[self.rows[:, None] + np.arange(-1, 2)]
            missing[self.rows - 1] = self.inverse * (
                (self.integral * at_points).sum(axis=1) - (self.sums * around).sum(axis=1)
            )
            seen[1:-1] += solve_banded((1, 1), self.bands, missing)
        return seen

    def transposed(self, weights: Vector) -> tuple[Vector, Matrix]:
        """Return the weights of the values at the nodes (n,) and at the points (k, q) in a sum over `seen`."""
        at_nodes, at_points = weights.copy(), np.zeros_like(self.points)
        if self.rows.size:
            mirrored = np.zeros_like(self.bands)
            mirrored[0, 1:], mirrored[1], mirrored[2, :-1] = (
                self.bands[2, :-1],
                self.bands[1],
                self.bands[0, 1:],
            )
            missing = solve_banded((1, 1), mirrored, weights[1:-1])[self.rows - 1] * self.inverse
            at_points = missing[:, None] * self.integral
            np.add.at(at_nodes, self.rows[:, None] + np.arange(-1, 2), -missing[:, None] * self.sums)
        for node in self.held:
            at_nodes[node] = 0.0
        return at_nodes, at_points


def _cuts(node: int, kinks: list[float]) -> Vector:
    """Return where the hat of a node and what lies under it are not smooth, in cells from the node."""
    return np.unique([-1.0, 0.0, 1.0, *(y - node for y in kinks if -1.0 < y - node < 1.0)])


def _moved(grid: Grid, time: float, after: Known, move: object, cash: object) -> Known:
    """Return V(move(x)) + cash(x) and its kinks."""

    def value(x: Vector) -> Vector:
        found = after.value(x if move is None else move(x, time))  # type: ignore[operator]
        return found if cash is None else found + cash(x, time)  # type: ignore[operator]

    if move is None:
        return Known(value, after.kinks, after.nodal)
    found = [_crossings(grid, lambda x, kink=kink: move(x, time) - kink) for kink in after.kinks]  # type: ignore[operator,misc]
    kinks = np.concatenate(found) if found else np.zeros(0)
    return Known(value, kinks, lambda x: after.nodal(move(x, time)))  # type: ignore[operator]


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
