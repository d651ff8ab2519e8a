"""What a solved obstacle problem tells."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Matrix, Vector, as_number, as_vector, check_type
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.obstacle.adjoint import Walk
from pricing_core.obstacle.direction import NAMES, neighbours
from pricing_core.obstacle.march import Instant, March, SegmentMarch, march
from pricing_core.obstacle.moment import ROUNDING
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.problem import ObstacleProblem, just_before
from pricing_core.obstacle.profile import Intervals
from pricing_core.obstacle.tangent import tangent

# By how much of a direction the problem is changed for a second derivative.
SECOND_DIFFERENCE = 1e-3
SECOND_ORDER = 4.0  # what the error of a derivative falls by at least from a grid to the next
Status: TypeAlias = Literal["ok", "tolerance_not_met", "deadline"]


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleDerivative:
    """The derivative of the value in a direction, in money for one unit of it.

    Parameters
    ----------
    value, error_estimate : float, or array of shape (m,)
    """

    value: Any
    error_estimate: Any


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleTangent:
    """The derivatives of the value, its slope and its curvature in a direction.

    Parameters
    ----------
    value, slope, curvature : float, or array of shape (m,)
        For one unit of the direction. In a contact set those of the obstacle.
    error_estimate, slope_error_estimate, curvature_error_estimate : float, or array of shape (m,)
    """

    value: Any
    slope: Any
    curvature: Any
    error_estimate: Any
    slope_error_estimate: Any
    curvature_error_estimate: Any


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleSolution:
    """The value now, and the contact sets and the values at all times.

    Parameters
    ----------
    problem : ObstacleProblem
    at : float, or array of shape (m,)
        The places that were asked for.
    value, error_estimate, slope, curvature : float, or array of shape (m,)
        V, the estimate of its error, V_x and V_xx: money, money, money per x, per x^2. One-sided where a place lies on
        the end of a contact set.
    status : {"ok", "tolerance_not_met", "deadline"}
    march, coarse, coarser : March or None
        The values on the finest grid, on the one before and on the one before that; None where they were not finished.
    """

    problem: ObstacleProblem
    at: Any
    value: Any
    error_estimate: Any
    slope: Any
    curvature: Any
    status: Status
    march: March | None
    coarse: March | None
    coarser: March | None
    _walks: list[Walk] = field(init=False, repr=False, default_factory=list)

    def contact(self, t: float) -> Intervals:
        """Return the intervals of x where V = lower at the time t, (left, right) each.

        They are infinite where they reach beyond the interval; at the time of an event, on a date and at the end of a
        window as just before it.
        """
        return self._contact(t, 0)

    def upper_contact(self, t: float) -> Intervals:
        """Return the intervals of x where V = upper at the time t, as `contact` does."""
        return self._contact(t, 1)

    def values(self, t: ArrayLike, x: ArrayLike) -> Matrix:
        """Return V at times and places, shape (len(t), len(x)).

        Between the ends of two steps on the straight line through the values there: second order in the step. At the
        horizon it is the payoff; where an obstacle acts V lies on its side.

        Raises
        ------
        InvalidInputError
            A place lies outside the interval of the solution; solve with it in `at`.
        """
        times, places = as_vector("t", np.atleast_1d(t)), as_vector("x", np.atleast_1d(x))
        left, right = self._march.grid.x[[0, -1]].tolist()
        outside = places[(places < left) | (places > right)]
        if outside.size:
            raise InvalidInputError("x", float(outside[0]), f"inside the interval, {left:g} to {right:g}")
        return np.array([self._values_at(time, places) for time in times.tolist()])

    def derivative(self, **direction: Any) -> ObstacleDerivative:
        """Return the derivative of the value in a direction, by the transposed march.

        The first call walks back from each place once, on the three finest grids; the others use what that has left.

        Parameters
        ----------
        volatility, drift, rate, source : float or callable
            The direction of a coefficient: a number or f(x, t), as it is given in the problem.
        payoff, lower, upper : float or callable
            The direction of an obstacle.
        cash : float, or array of shape (events,)
            The direction of what events pay, in their order in `problem.events`.

        Returns
        -------
        ObstacleDerivative
            The derivative converges with at least the second order, so that the estimate is the difference of the two
            finest grids, or a quarter of that before where the last one is small by chance; all of that before where V
            comes to a kink that holds it.

        Raises
        ------
        UnknownNameError, InvalidInputError
            A name is not known, or the problem has no such obstacle.
        """
        _check_direction(direction)
        places = self._places
        if not self._walks:
            self._walks.extend(Walk.of(march, float(x)) for march in self._marches for x in places)
        sides = neighbours(self.problem, direction)
        found = np.array([walk.derivative(sides) for walk in self._walks]).reshape(-1, places.size)
        return ObstacleDerivative(*self._with_errors(found))

    def tangent(self, **direction: Any) -> ObstacleTangent:
        """Return the derivatives of the value, its slope and its curvature in a direction, by a linear march forward.

        It costs less than the march itself, for all places together; the value's derivative is that of `derivative`.

        Parameters
        ----------
        volatility, drift, rate, source, payoff, lower, upper, cash
            The direction, as for `derivative`.

        Raises
        ------
        UnknownNameError, InvalidInputError
            As `derivative` does.
        """
        _check_direction(direction)
        sides = neighbours(self.problem, direction)
        found = np.array([tangent(march, sides, self._places) for march in self._marches])
        (value, error), (slope, slope_error), (curvature, curvature_error) = (
            self._with_errors(found[:, k]) for k in range(3)
        )
        return ObstacleTangent(value, slope, curvature, error, slope_error, curvature_error)

    def second_derivative(self, first: Mapping[str, Any], second: Mapping[str, Any]) -> ObstacleDerivative:
        """Return the second derivative of the value in two directions, each as the arguments of `derivative` by name.

        It is the central difference of tangents of two marches on each grid, changed by a thousandth of `second`, and
        by twice that on each coarser one, so that the estimate sees this as well. A node that enters a contact set is a
        kink of the first derivative, so that the second is a mean over some of them, and of lower order than the
        others.

        Raises
        ------
        UnknownNameError, InvalidInputError
            As `derivative` does.
        """
        for direction in (first, second):
            _check_direction(direction)
        found = []
        for k, own in enumerate(self._marches):
            size = 2.0**k * SECOND_DIFFERENCE
            high, low = (
                tangent(march_again(problem, own), neighbours(problem, first), self._places)[0]
                for problem in neighbours(self.problem, second, size).both
            )
            found.append((high - low) / (2.0 * size))
        return ObstacleDerivative(*self._with_errors(np.array(found)))

    @property
    def _places(self) -> Vector:
        """The places that were asked for, shape (m,)."""
        return np.atleast_1d(np.asarray(self.at, dtype=np.float64))

    @property
    def _marches(self) -> list[March]:
        """The marches on the finest grids, the finest first."""
        return [self._march, *(march for march in (self.coarse, self.coarser) if march is not None)]

    def _with_errors(self, found: Matrix) -> tuple[Any, Any]:
        """Return what the finest grid tells of (grids, m), and how the others differ; NaN where there is none."""
        # Where V comes to a kink that holds it, when it does is known to a step, and a derivative to first order.
        pins = any(part.pins_on_the_way for part in self._march.parts)
        error = apart(found, 1.0 if pins else SECOND_ORDER)
        return (found[0], error) if np.ndim(self.at) else (float(found[0, 0]), float(error[0]))

    @property
    def resolution(self) -> dict[str, Any]:
        """The number of nodes of the finest grid, and of its steps in each segment from now to the horizon."""
        march = self._march
        return {"nodes": march.grid.x.size, "steps": march.steps[::-1]}

    @property
    def _march(self) -> March:
        if self.march is None:
            raise NumericalError(f"no grid was finished, status {self.status!r}: there is nothing to tell")
        return self.march

    def _around(self, t: float) -> tuple[Instant, Instant, float]:
        """Return the instants before and after a time, and where it lies between them, 0 to 1."""
        time = as_number("t", t)
        horizon = self.problem.horizon
        if not 0.0 <= time <= horizon:
            raise InvalidInputError("t", time, f"from 0 to the horizon, {horizon:g}")
        instants = self._march.instants[::-1]
        times = [instant.t for instant in instants]
        later = min(max(bisect_right(times, time), 1), len(times) - 1)
        before, after = instants[later - 1], instants[later]
        share = (time - before.t) / (after.t - before.t)
        return before, after, min(max(share, 0.0), 1.0)

    def _contact(self, t: float, which: int) -> Intervals:
        obstacle = self.problem.obstacles[which]
        for part in self._march.parts:
            if t == part.segment.end < self.problem.horizon:
                return () if obstacle is None else held_before(part, obstacle, (1.0, -1.0)[which])
        before, after, share = self._around(t)
        first, second = (self._intervals(instant, which) for instant in (before, after))
        if len(first) != len(second):
            return first if share < 0.5 else second
        return tuple(
            tuple(_between(a, b, share) for a, b in zip(one, two, strict=True))  # type: ignore[misc]
            for one, two in zip(first, second, strict=True)
        )

    def _intervals(self, instant: Instant, which: int) -> Intervals:
        profile = self._march.profile(instant)
        return tuple(
            tuple(
                edge if math.isinf(edge) else float(profile.grid.place(np.array([edge]))[0]) for edge in pair
            )  # type: ignore[misc]
            for pair in profile.contacts[which]
        )

    def _values_at(self, t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        if t == self.problem.horizon:
            return self.problem.payoff(x, t)
        before, after, share = self._around(t)
        early, late = (self._march.profile(instant)(x) for instant in (before, after))
        found: Vector = (1.0 - share) * early + share * late
        for obstacle, side in zip(self.problem.obstacles, (np.maximum, np.minimum), strict=True):
            if obstacle is not None and obstacle.acts_at(t):
                found = side(found, obstacle(x, t))
        return found


def apart(found: Sequence[Any] | Matrix, fall: float) -> Any:
    """Return the difference of the two finest grids, given what each grid tells, the finest first; NaN of one alone.

    It may vanish by chance: it is at least what is left of those before it, which fall at most by so much a grid.
    """
    changes = [np.abs(a - b) / fall**k for k, (a, b) in enumerate(pairwise(found))]
    return np.maximum.reduce(changes) if changes else np.full(np.shape(found[0]), np.nan)


def held_before(part: SegmentMarch, obstacle: Obstacle, sign: float) -> Intervals:
    """Return where V is an obstacle just before the end of a segment, as intervals of x."""
    end, x = part.segment.end, part.segment.grid.x
    if not obstacle.acts_at(end):
        return ()
    kinks = part.known.kinks[(part.known.kinks > x[0]) & (part.known.kinks < x[-1])]
    edges = np.array([x[0], *kinks, x[-1]])
    middles = 0.5 * (edges[1:] + edges[:-1])
    bound = obstacle(middles, just_before(end))
    assert part.known.waiting is not None
    is_held = sign * (bound - part.known.waiting(middles)) > ROUNDING * np.maximum(1.0, np.abs(bound))
    edges[0], edges[-1] = -math.inf, math.inf
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(is_held).tolist():
        left, right = float(edges[k]), float(edges[k + 1])
        if found and found[-1][1] == left:
            left = found.pop()[0]
        found.append((left, right))
    return tuple(found)


def _check_direction(direction: Mapping[str, Any]) -> None:
    check_type("direction", direction, Mapping)
    if not direction:
        raise InvalidInputError("direction", Told("nothing"), f"one or several of {', '.join(NAMES)}")


def march_again(problem: ObstacleProblem, own: March) -> March:
    """Return the march of a changed problem on the same grid, in the same steps."""
    found = march(problem, own.grid, checked=False, steps_of=own)
    assert found is not None  # nothing interrupts it
    return found


def _between(a: float, b: float, share: float) -> float:
    if math.isinf(a) or math.isinf(b):
        return a if share < 0.5 else b
    return (1.0 - share) * a + share * b
