"""What a solved obstacle problem tells."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Matrix, as_number, as_vector
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.obstacle.adjoint import NAMES, Walk
from pricing_core.obstacle.march import Instant, March
from pricing_core.obstacle.problem import ObstacleProblem
from pricing_core.obstacle.profile import Intervals

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
    march, coarse : March or None
        The values on the finest grid and on the one before; None where they were not finished.
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
    _walks: list[Walk] = field(init=False, repr=False, default_factory=list)

    def contact(self, t: float) -> Intervals:
        """Return the intervals of x where V = lower at the time t, (left, right) each.

        They are infinite where they reach beyond the interval; at the time of an event as just before it.
        """
        return self._contact(t, 0)

    def upper_contact(self, t: float) -> Intervals:
        """Return the intervals of x where V = upper at the time t, as `contact` does."""
        return self._contact(t, 1)

    def values(self, t: ArrayLike, x: ArrayLike) -> Matrix:
        """Return V at times and places, shape (len(t), len(x)).

        Between the ends of two steps on the straight line through the values there: second order in the step.
        """
        times, places = as_vector("t", np.atleast_1d(t)), as_vector("x", np.atleast_1d(x))
        return np.array([self._values_at(time, places) for time in times.tolist()])

    def derivative(self, **direction: Any) -> ObstacleDerivative:
        """Return the derivative of the value in a direction, by the transposed march.

        The first call walks back from each place once, on the two finest grids; the others use what that has left.

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
            The estimate is the difference of the two grids: the derivative converges with at least the second order.

        Raises
        ------
        UnknownNameError, InvalidInputError
            A name is not known, or the problem has no such obstacle.
        """
        if not direction:
            raise InvalidInputError("direction", Told("nothing"), f"one or several of {', '.join(NAMES)}")
        places = np.atleast_1d(np.asarray(self.at, dtype=np.float64))
        if not self._walks:
            for march in (self._march, self.coarse):
                if march is not None:
                    self._walks.extend(Walk.of(march, float(x)) for x in places)
        found = np.array([walk.derivative(direction) for walk in self._walks]).reshape(-1, places.size)
        value, error = (
            found[0],
            np.abs(found[0] - found[-1]) if len(found) > 1 else np.full(places.size, np.nan),
        )
        if np.ndim(self.at) == 0:
            return ObstacleDerivative(float(value[0]), float(error[0]))
        return ObstacleDerivative(value, error)

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
        before, after, share = self._around(t)
        first, second = (self._places(instant, which) for instant in (before, after))
        if len(first) != len(second):
            return first if share < 0.5 else second
        return tuple(
            tuple(_between(a, b, share) for a, b in zip(one, two, strict=True))  # type: ignore[misc]
            for one, two in zip(first, second, strict=True)
        )

    def _places(self, instant: Instant, which: int) -> Intervals:
        profile = self._march.profile(instant)
        return tuple(
            tuple(
                edge if math.isinf(edge) else float(profile.grid.place(np.array([edge]))[0]) for edge in pair
            )  # type: ignore[misc]
            for pair in profile.contacts[which]
        )

    def _values_at(self, t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        before, after, share = self._around(t)
        early, late = (self._march.profile(instant)(x) for instant in (before, after))
        return np.asarray((1.0 - share) * early + share * late)


def _between(a: float, b: float, share: float) -> float:
    if math.isinf(a) or math.isinf(b):
        return a if share < 0.5 else b
    return (1.0 - share) * a + share * b
