"""The value between the nodes at one time: the obstacle in contact sets, polynomials that do not cross their ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.obstacle.ends import Held, measure
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.moment import ROUNDING, Moment
from pricing_core.obstacle.problem import ObstacleProblem

POINTS = 6  # of the polynomials
FEWEST_POINTS = 3  # between two contact sets; where there are fewer their ends are disregarded
DIFFERENCE = 0.01  # cells, of the differences that give the slope of an obstacle

Intervals = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """V at one time as a function of x.

    Parameters
    ----------
    problem : ObstacleProblem
    grid : Grid
    t : float
        The time; where something happens at it, just before.
    value : Vector, shape (n,)
        At the nodes.
    contacts : (intervals, intervals)
        Where V is the lower and the upper obstacle, in numbers of nodes; infinite where beyond an end as well.
    """

    problem: ObstacleProblem
    grid: Grid
    t: float
    value: Vector
    contacts: tuple[Intervals, Intervals]

    def __call__(self, x: Vector) -> Vector:
        """Return V at x, shape (m,)."""
        value: Vector = self.derivatives(x)[0]
        return value

    def derivatives(self, x: Vector) -> Matrix:
        """Return V, V_x and V_xx at x, shape (3, m)."""
        index = self.grid.index(x)
        found = self._free(x, index)
        for obstacle, intervals in zip(self.problem.obstacles, self.contacts, strict=True):
            for left, right in intervals:
                inside = (index >= left) & (index <= right)
                if obstacle is not None and inside.any():
                    width = DIFFERENCE * float(self.grid.slope.min())
                    found[:, inside] = obstacle.derivatives(x[inside], self.t, width)
        return found

    def side(self, x: Vector) -> NDArray[np.intp]:
        """Return 1 where V is the lower obstacle, -1 where it is the upper one, 0 elsewhere, shape (m,)."""
        index = self.grid.index(x)
        found = np.zeros(x.size, dtype=np.intp)
        for sign, intervals in zip((1, -1), self.contacts, strict=True):
            for left, right in intervals:
                found[(index >= left) & (index <= right)] = sign
        return found

    def nodal(self, x: Vector) -> Matrix:
        """Return how V at x depends on the values at the nodes, shape (m, n): not at all in a contact set."""
        n = self.grid.x.size
        weights = np.zeros((x.size, n))
        index = self.grid.index(x)
        inside = (index >= 0.0) & (index <= n - 1.0)
        for left, right in self.free_runs():
            chosen = inside & (index >= left) & (index <= right)
            if chosen.any():
                start, points, u = self._stencils(index[chosen], *self.free_nodes(left, right))
                powers = u[:, None] ** np.arange(points)
                weights[np.flatnonzero(chosen)[:, None], start[:, None] + np.arange(points)] = powers @ basis(
                    points
                )
        for outside, end, nodes in self._outsides(index):
            if outside.any() and not isinstance(end, Held):
                s = measure(end, np.concatenate([self.grid.x[nodes], x[outside]]))
                share = s[2:] / s[1]
                weights[outside, nodes[0]], weights[outside, nodes[1]] = 1.0 - share, share
        for intervals in self.contacts:
            for left, right in intervals:
                weights[(index >= left) & (index <= right)] = 0.0
        return weights

    def _free(self, x: Vector, index: Vector) -> Matrix:
        """Return the derivatives of what is between the contact sets and beyond the ends."""
        last = self.grid.x.size - 1
        found = np.empty((3, x.size))
        for left, right in self.free_runs():
            inside = (index >= max(left, 0.0)) & (index <= min(right, float(last)))
            if inside.any():
                found[:, inside] = self._polynomials(index[inside], *self.free_nodes(left, right))
        for outside, end, nodes in self._outsides(index):
            if outside.any():
                found[:, outside] = self._beyond(x[outside], end, nodes)
        return found

    def _outsides(self, index: Vector) -> list[tuple[BoolVector, Any, list[int]]]:
        """Return for both ends what lies beyond it, what holds there, and its last two nodes."""
        last = self.grid.x.size - 1
        left, right = self.problem.ends
        return [(index < 0.0, left, [0, 1]), (index > last, right, [last, last - 1])]

    def free_nodes(self, left: float, right: float) -> tuple[int, int]:
        """Return the first and the last node between two contact sets, or of all where there are too few."""
        last = self.grid.x.size - 1
        first = 0 if left < 0.0 else math.floor(left) + 1
        final = last if right > last else math.ceil(right) - 1
        return (0, last) if final - first + 1 < FEWEST_POINTS else (first, final)

    def free_runs(self) -> list[tuple[float, float]]:
        """Return what the contact sets leave, in numbers of nodes."""
        runs, edge = [], -math.inf
        for left, right in sorted(pair for intervals in self.contacts for pair in intervals):
            if left > edge:
                runs.append((edge, left))
            edge = max(edge, right)
        return [*runs, (edge, math.inf)] if edge < math.inf else runs

    def _stencils(self, index: Vector, first: int, final: int) -> tuple[NDArray[np.intp], int, Vector]:
        """Return the first nodes of the polynomials, the number of their nodes, and the places counted from there."""
        points = min(POINTS, final - first + 1)
        start = np.clip(np.floor(index).astype(np.intp) - (points // 2 - 1), first, final - points + 1)
        return start, points, index - start

    def _polynomials(self, index: Vector, first: int, final: int) -> Matrix:
        start, points, u = self._stencils(index, first, final)
        coefficients = basis(points) @ self.value[start + np.arange(points)[:, None]]  # (points, m)
        value, slope, bend = (np.zeros_like(u) for _ in range(3))
        for coefficient in coefficients[::-1]:
            bend = bend * u + 2.0 * slope
            slope = slope * u + value
            value = value * u + coefficient
        y = index / self.grid.refined
        first_derivative = self.grid.map.place(y, 1) / self.grid.refined
        second_derivative = self.grid.map.place(y, 2) / self.grid.refined**2
        by_x = slope / first_derivative
        return np.array([value, by_x, (bend - second_derivative * by_x) / first_derivative**2])

    def _beyond(self, x: Vector, end: object, nodes: list[int]) -> Matrix:
        if isinstance(end, Held):
            return np.array([np.full(x.size, end.beyond_at(self.t)), np.zeros(x.size), np.zeros(x.size)])
        ends = self.grid.x[nodes]
        s = measure(end, np.concatenate([ends, x]))  # type: ignore[arg-type]
        slope = (self.value[nodes[1]] - self.value[nodes[0]]) / s[1]
        growth = np.exp(x - ends[0]) if end == "exponential" else np.ones(x.size)
        bend = growth if end == "exponential" else np.zeros(x.size)
        return np.array([self.value[nodes[0]] + slope * s[2:], slope * growth, slope * bend])


@cache
def basis(points: int) -> Matrix:
    """Return the matrix from values at 0, ..., points - 1 to the coefficients of their polynomial, shape (p, p)."""
    return np.linalg.inv(np.vander(np.arange(float(points)), increasing=True))


def contact_sets(moment: Moment, value: Vector, mass: Vector) -> tuple[Intervals, Intervals]:
    """Return where V is the lower and the upper obstacle, in numbers of nodes, their ends inside cells.

    Parameters
    ----------
    value : Vector, shape (n,)
    mass : Vector, shape (n - 2,)
    """
    contact, V = moment.contact, value[1:-1]
    side = contact.side(V, np.ones(V.size))
    distance = np.minimum(side.parameter(V, mass), 1.0)
    found = []
    ends = value[[0, -1]]
    rounding = ROUNDING * np.maximum(
        1.0, np.abs(ends)
    )  # of the rule that makes an end's value from its neighbours'
    at_ends = ends <= moment.lower_ends + rounding, ends >= moment.upper_ends - rounding
    for touching, sign, end in zip(contact.touching(V), (1.0, -1.0), at_ends, strict=True):
        near = side.averaged & (sign * side.c > 0.0)
        found.append(_intervals(touching, np.where(near, np.maximum(distance, 0.0), 1.0), end))
    return found[0], found[1]


def _intervals(touching: BoolVector, distance: Vector, ends: BoolVector) -> Intervals:
    """Return the intervals of nodes that touch, and those inside a cell between two nodes near them."""
    n = touching.size  # the inner nodes 1, ..., n
    padded = np.concatenate([[False], touching, [False]])
    changes = np.flatnonzero(padded[1:] != padded[:-1])
    intervals = []
    for first, after in zip(changes[::2] + 1, changes[1::2] + 1, strict=True):
        left = first - 1 + distance[first - 2] if first > 1 else (-np.inf if ends[0] else first)
        right = after - distance[after - 1] if after <= n else (np.inf if ends[1] else after - 1)
        intervals.append((float(left), float(right)))
    inside = ~touching[:-1] & ~touching[1:] & (distance[:-1] + distance[1:] < 1.0)
    for i in np.flatnonzero(inside):
        intervals.append((float(i + 1 + distance[i]), float(i + 2 - distance[i + 1])))
    return tuple(sorted(intervals))
