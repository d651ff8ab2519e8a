"""Solve an obstacle problem to a tolerance, on one grid after another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Matrix, Vector, as_number, as_real_array, check_type
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.march_settings import MOST_CELLS
from pricing_core.obstacle.grid import Grid, GridMap
from pricing_core.obstacle.interval import choose_map, left_out
from pricing_core.obstacle.march import March, march
from pricing_core.obstacle.problem import ObstacleProblem
from pricing_core.obstacle.profile import DIFFERENCE
from pricing_core.obstacle.solution import ObstacleSolution, Status

GAIN = 8.0  # of a grid of half the cell: the order is three
# Places around one that is asked at, in coarse cells, over which the difference of two grids is looked at: at one place
# alone it may vanish by chance.
AROUND = np.arange(-3.0, 4.0)
SLOWEST = 0.9  # of a difference to the one before it that still lets the rest be summed
MARGIN = 1.5  # on what the extrapolation leaves where the differences fall less than the third order says
STEEP = 0.25  # up to which the differences fall as the third order says, and one is extrapolated; it says 1/8
FIRST_LEVELS = 3
# By what the estimate is multiplied where coefficients jump: the contact sets' ends may move fast behind such a time,
# in steps that do not begin anew as small as at the horizon. Calibrated.
AT_BREAKS = 3.0
AT_PINS = 2.0  # of the last difference that may be left where V comes to a kink that holds it within a step
MUCH_WORSE = (
    10.0  # by which a finer grid's estimate may be larger before the one that was found before it stays
)
PESSIMISM = (
    22.0  # by which the difference before the last falls at least on the way to the error; 56 at third order
)


def solve(
    problem: ObstacleProblem,
    at: ArrayLike,
    tolerance: float = 1e-6,
    deadline: float | None = None,
    *,
    interrupt: Callable[[], bool] | None = None,
) -> ObstacleSolution:
    """Solve an obstacle problem at one or several places, now.

    Parameters
    ----------
    problem : ObstacleProblem
    at : array_like, shape (m,), or a number
        Places inside the interval.
    tolerance : float
        Money, above 0: the error estimate at which it is enough.
    deadline : float, optional
        Seconds.
    interrupt : callable, optional
        Asked before every step; True ends the work as a deadline does.

    Returns
    -------
    ObstacleSolution
        With status "tolerance_not_met" where no resolution reaches the tolerance, and "deadline" where the time was
        over: then with the best value and its estimate, which are NaN where there is none.

    Raises
    ------
    InvalidInputError
        A place lies outside the interval; a function of the problem has a value that is not finite; a lower obstacle
        lies above an upper one, or the payoff outside them; the diffusion vanishes.

    Examples
    --------
    An American put with strike and spot 1 over x = ln S:

    >>> from pricing_core.obstacle import Diffusion, Obstacle, ObstacleProblem
    >>> payoff = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
    >>> put = ObstacleProblem(
    ...     Diffusion(0.2, drift=0.05 - 0.2**2 / 2, rate=0.05), payoff, 1.0,
    ...     lower=payoff, ends=("exponential", "exponential"),
    ... )
    >>> solution = solve(put, 0.0, tolerance=1e-6)
    >>> round(solution.value, 6), solution.status
    (0.060904, 'ok')
    """
    check_type("problem", problem, ObstacleProblem)
    places = as_real_array("at", at)
    if places.ndim > 1 or places.size == 0:
        raise InvalidInputError("at", at, "a number or a vector that is not empty")
    tolerance = as_number("tolerance", tolerance)
    if not tolerance > 0.0:
        raise InvalidInputError("tolerance", tolerance, "above 0")
    deadline = None if deadline is None else as_number("deadline", deadline)
    if interrupt is not None and not callable(interrupt):
        raise InvalidInputError("interrupt", interrupt, "a function without arguments")
    limit = TimeLimit(deadline) if deadline is None or deadline > 0.0 else TimeLimit(math.nextafter(0.0, 1.0))
    flat = places.reshape(-1)
    chosen = choose_map(problem, flat)
    levels = Levels(chosen, flat, left_out(problem, chosen, flat))
    status = levels.run(problem, tolerance, lambda: limit() or (interrupt is not None and interrupt()))
    levels.keep_between_obstacles(problem)
    value, slope, curvature = (_shaped(places, row) for row in levels.derivatives)
    error_estimate = _shaped(places, levels.error_estimate)
    return ObstacleSolution(
        problem,
        _shaped(places, flat),
        value,
        error_estimate,
        slope,
        curvature,
        status,
        levels.march,
        levels.coarse,
        levels.coarser,
    )


def _shaped(places: NDArray[np.float64], row: Vector) -> Any:
    """Return a number for a place that was given as a number."""
    return row if places.ndim else float(row[0])


@dataclass(slots=True, eq=False)
class Levels:
    """The grids that a solution has gone through, each with half the cells' width of the one before.

    Parameters
    ----------
    map : GridMap
    at : Vector, shape (m,)
    left_out : Vector, shape (m,)
        What lies beyond the interval, money.
    """

    map: GridMap
    at: Vector
    left_out: Vector
    march: March | None = None
    coarse: March | None = None
    coarser: March | None = None
    derivatives: Matrix = None  # type: ignore[assignment]
    error_estimate: Vector = None  # type: ignore[assignment]

    def run(self, problem: ObstacleProblem, tolerance: float, interrupt: Callable[[], bool]) -> Status:
        """March on finer and finer grids, to the tolerance."""
        self.derivatives = np.full((3, self.at.size), math.nan)
        self.error_estimate = np.full(self.at.size, math.nan)
        differences: list[Vector] = []
        refined = 1
        while self.map.cells * refined <= MOST_CELLS:
            try:
                found = march(problem, Grid.of(self.map, refined), interrupt)
            except IterationLimitError:  # on a grid that does not resolve the problem
                refined *= 2
                continue
            if found is None:
                return "deadline"
            if self.march is not None:
                differences.append(self._difference(found, self.march))
                self._extrapolate(found, self.march, differences)
            self.march, self.coarse, self.coarser = found, self.march, self.coarse
            if len(differences) + 1 >= FIRST_LEVELS and (self.error_estimate <= tolerance).all():
                return "ok"
            refined *= 2
        return "tolerance_not_met"

    def _difference(self, fine: March, coarse: March) -> Vector:
        """Return the largest difference of two marches around each place, shape (m,)."""
        step = self.map.size / coarse.grid.refined
        places = np.clip(self.at[:, None] + step * AROUND, self.map.left, self.map.right)
        difference = np.abs(fine.now(places.ravel()) - coarse.now(places.ravel()))
        return np.asarray(difference.reshape(places.shape).max(axis=1))

    def _extrapolate(self, fine: March, coarse: March, differences: list[Vector]) -> None:
        """Extrapolate, and estimate the error of V from how the differences of the grids fall.

        Where they fall as the third order says, the value without extrapolation is off by a seventh of the last one,
        which is told for the error of the extrapolated one. Where they fall more slowly, nothing is extrapolated, and
        the error is the sum of what is to come.
        """
        last, fine_values = differences[-1], fine.now.derivatives(self.at)
        ratio = np.full(last.shape, 0.5)
        if len(differences) > 1:
            ratio = np.clip(last / np.where(differences[-2] > 0.0, differences[-2], 1.0), 0.0, SLOWEST)
        # A step in which V comes to a kink that holds it has an error of second order, of either sign.
        is_regular = not any(part.pins_on_the_way for part in fine.parts)
        falls = (ratio <= STEEP) & is_regular
        change = fine_values - coarse.now.derivatives(self.at)
        extrapolated = np.where(falls, fine_values + change / (GAIN - 1.0), fine_values)
        crossed = fine.now.side(self.at) != coarse.now.side(self.at)  # the end of a contact set
        extrapolated[1:, crossed] = fine_values[1:, crossed]
        geometric, third = ratio / (1.0 - ratio), 1.0 / (GAIN - 1.0)
        rest = np.where(falls, np.maximum(third, MARGIN * (geometric - third)), geometric)
        rest = rest if is_regular else np.maximum(rest, AT_PINS)
        rounding = 1e-13 * np.maximum(1.0, np.abs(fine_values[0]))
        before = differences[-2] / PESSIMISM if len(differences) > 1 else 0.0
        # Where a cell's drift is more than its diffusion the order is not seen yet.
        peclet = np.median(np.abs(fine.parts[-1].instants[-1].moment.scheme.peclet))
        problem = fine.problem
        caution = AT_BREAKS if problem.diffusion.breaks and any(problem.obstacles) else 1.0
        caution *= max(1.0, float(peclet)) ** 2
        off_nodes = max(part.segment.off_nodes for part in fine.parts)
        kinks = off_nodes + sum(part.unresolved for part in fine.parts)
        error = caution * np.maximum(last * rest, before) + rounding + self.left_out + kinks
        worse = ~(error <= MUCH_WORSE * self.error_estimate) & ~np.isnan(self.error_estimate)
        worse &= len(differences) > 2  # an estimate of one difference alone is not kept
        self.derivatives = np.where(worse, self.derivatives, extrapolated)
        self.error_estimate = np.where(worse, self.error_estimate, error)

    def keep_between_obstacles(self, problem: ObstacleProblem) -> None:
        """Clip the values to the obstacles that act now, on a date as well."""
        for obstacle, sign in zip(problem.obstacles, (1.0, -1.0), strict=True):
            if obstacle is not None and obstacle.acts_at(0.0):
                own = obstacle.derivatives(self.at, 0.0, DIFFERENCE * self.map.size)
                short = sign * (own[0] - self.derivatives[0])
                self.derivatives[0] = np.where(short > 0.0, own[0], self.derivatives[0])
                self.derivatives[1:, short > self.error_estimate] = own[1:, short > self.error_estimate]
