"""Schedules to a tolerance, many at once, by the kernel's collocation of the multiplier.

`pricing_core.collocation_twin` tells the scheme. Its levels gain a factor of about five each, so the distance of two
neighbours bounds the error of the finer one, unless they agree by chance: a share of the early exercise premium is
added, where there is a boundary to resolve. Calibrated on random contracts, checked in tests.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.schedule import Schedule
from pricing_core.arrays import BoolVector, Matrix, Vector

FINEST = 6  # level
PREMIUM_SHARE = (0.0, 3e-3, 5e-4, 5e-5, 5e-6, 1e-6, 2e-7)  # by level
EUROPEAN_LEVEL = 2  # its values are closer than NEGLECTED of the level, for they have no boundary
FIRST_LEVELS = ((4e-6, 1), (4e-7, 2), (4e-8, 3), (0.0, 4))  # tolerances from which a level is tried first
NEGLECTED = (
    1e-5,
    5e-7,
    2e-8,
    1e-9,
    3e-11,
    1e-12,
    1e-13,
)  # strikes: what lies beyond the interval of each level
ROUNDING = 1e-13  # strikes
FURTHEST = 30.0  # deviations between spot and strike
LARGEST_CALL_DEVIATION = 4.0
SAFE = 4.5  # deviations of the spot above what a dividend takes to nearly zero
WIDEST = 400.0  # deviation at expiry over the spread of a segment
LEAST_SPREAD = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """What the collocation says of each schedule, in strikes; every array has shape (n,).

    Parameters
    ----------
    value, slope, curvature : Vector
        V/K and its first and second derivative by x = ln(S/K).
    european : Vector
        The value without early exercise.
    boundary : Vector
        ln(S*/K) now; NaN without one.
    error : Vector
        Of the value.
    settled : bool array
        Whether the collocation found every boundary; nothing in the other columns may be used where it did not.
    level : int array
        At which the value was found.
    """

    value: Vector
    slope: Vector
    curvature: Vector
    boundary: Vector
    european: Vector
    error: Vector
    settled: BoolVector
    level: NDArray[np.int64]


def is_served(schedule: Schedule) -> bool:
    """Whether the collocation may be tried.

    There must be chance in every segment, and none far shorter than the whole; spot and strike must be within
    reach of each other; a call's spot must not spread so far that its parts cancel; and no dividend may be likely
    to take a put's spot to nearly zero, where the contact set begins in a way that is not followed.
    """
    if schedule.spot <= 0.0:
        return False
    distance = abs(math.log(schedule.spot / schedule.strike))
    spreads = [segment.volatility * math.sqrt(segment.duration) for segment in schedule.segments]
    deviation = math.hypot(*spreads)
    if min(spreads) < max(LEAST_SPREAD, deviation / WIDEST) or distance > FURTHEST * deviation:
        return False
    return _keeps_its_spot(schedule, spreads) if schedule.is_put else deviation <= LARGEST_CALL_DEVIATION


def _keeps_its_spot(schedule: Schedule, spreads: list[float]) -> bool:
    """Whether the dividends of a put are small against its spot when they are paid, with all but certainty."""
    forward, variance = math.log(schedule.spot / schedule.strike), 0.0
    for segment, spread in zip(schedule.segments, spreads, strict=True):
        forward += (segment.rate - segment.dividend_yield) * segment.duration
        variance += spread * spread
        jumps = segment.fraction > 0.0 or segment.amount > 0.0 or segment.escrow > 0.0
        if segment.exercisable and segment.dividend_yield < 0.0 < segment.rate and jumps:
            return False  # exercise begins between two spots
        if segment.amount > 0.0:
            nearly_zero = math.log(segment.amount / schedule.strike) + spread
            if nearly_zero > min(forward, 0.0) - SAFE * math.sqrt(variance):
                return False
            left = math.exp(forward) * (1.0 - segment.fraction) - segment.amount / schedule.strike
            forward = math.log(left) if left > 0.0 else -math.inf
        elif segment.fraction > 0.0:
            forward += math.log1p(-segment.fraction) if segment.fraction < 1.0 else -math.inf
    return math.isfinite(forward)


def solve_to_tolerance(schedules: Sequence[Schedule], tolerance: Vector, threads: int) -> Solved:
    """Refine every schedule until its stated error meets its tolerance, or to the finest level.

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Fractions of the strike.
    """
    count = len(schedules)
    book = pack(schedules)
    level = np.array(
        [next(first for least, first in FIRST_LEVELS if t >= least) for t in tolerance], dtype=np.int64
    )
    value, slope, curvature, boundary = np.full((4, count), np.nan)
    nothing = np.full(count, np.inf), np.zeros(count, dtype=bool), level.copy()
    european, _ = solve_book(pack(schedules, exercise=False), np.maximum(level, EUROPEAN_LEVEL), threads)
    solved = Solved(value, slope, curvature, boundary, european[0], *nothing)
    coarse = np.full(count, np.nan)
    rows = np.arange(count)
    found, settled = solve_book(book.take(rows), level - 1, threads)
    coarse[settled] = found[0, settled]
    while rows.size:
        found, settled = solve_book(book.take(rows), level[rows], threads)
        _keep(solved, rows, level[rows], found, settled, coarse[rows])
        coarse[rows] = np.where(settled, found[0], np.nan)
        missed = ~(solved.error[rows] <= tolerance[rows]) & (level[rows] < FINEST)
        rows = rows[missed]
        level[rows] += 1
    return solved


def _keep(
    solved: Solved,
    rows: NDArray[np.intp],
    level: NDArray[np.int64],
    found: Matrix,
    settled: BoolVector,
    coarse: Vector,
) -> None:
    """Store what these rows found, unless what is there has the smaller error."""
    has_boundary = found[4] != 0.0
    premium = np.where(has_boundary, np.maximum(found[0] - solved.european[rows], 0.0), 0.0)
    error = np.abs(found[0] - coarse) + np.array(PREMIUM_SHARE)[level] * premium
    error += np.array(NEGLECTED)[level] + ROUNDING
    error = np.where(np.isnan(error), np.inf, error)
    better = settled & ((error <= solved.error[rows]) | ~solved.settled[rows])
    kept = rows[better]
    columns = (solved.value, solved.slope, solved.curvature, solved.boundary)
    for column, numbers in zip(columns, found[:4], strict=True):
        column[kept] = numbers[better]
    solved.error[kept], solved.level[kept] = error[better], level[better]
    solved.settled[kept] = True


@dataclass(frozen=True, slots=True, eq=False)
class PackedSchedules:
    """Schedules as the kernel takes them."""

    sign: Vector  # (n,)
    x: Vector  # (n,)
    first: NDArray[np.int64]  # (n + 1,)
    stretches: Matrix  # (m, 9)

    def take(self, rows: NDArray[np.intp]) -> "PackedSchedules":
        """Return some of them."""
        if rows.size == self.x.size:
            return self
        counts = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(counts)])
        chosen = np.repeat(self.first[rows] - first[:-1], counts) + np.arange(first[-1])
        return PackedSchedules(self.sign[rows], self.x[rows], first, self.stretches[chosen])


def pack(schedules: Sequence[Schedule], *, exercise: bool = True) -> PackedSchedules:
    """Return the schedules in units of their strikes; without exercise, those of the European options."""
    rows = [
        (
            segment.end - segment.start,
            segment.rate,
            segment.dividend_yield,
            segment.volatility,
            float(exercise and segment.exercisable),
            float(exercise and segment.exercise_at_end),
            segment.fraction,
            segment.amount / schedule.strike,
            segment.escrow / schedule.strike,
        )
        for schedule in schedules
        for segment in schedule.segments
    ]
    counts = [len(schedule.segments) for schedule in schedules]
    return PackedSchedules(
        np.array([1.0 if schedule.is_put else -1.0 for schedule in schedules]),
        np.array([math.log(schedule.spot) - math.log(schedule.strike) for schedule in schedules]),
        np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64),
        np.array(rows, dtype=np.float64).reshape(len(rows), 9),
    )


def solve_book(book: PackedSchedules, level: NDArray[np.int64], threads: int) -> tuple[Matrix, BoolVector]:
    """Return the kernel's numbers, shape (5, n), at these levels, and whether they may be used."""
    nothing, none = np.zeros(0), np.zeros(book.x.size + 1, dtype=np.int64)
    found, _, settled = kernel.solve_schedules(
        book.sign, book.x, book.first, book.stretches, level, nothing, none, threads
    )
    return found, settled


def boundaries_at(schedule: Schedule, times: Vector, level: int) -> tuple[Vector, bool]:
    """Return ln(S*/K) at increasing times from now, just before what happens then, and whether all were found."""
    book = pack([schedule])
    ends = np.array([0, times.size], dtype=np.int64)
    _, boundary, settled = kernel.solve_schedules(
        book.sign, book.x, book.first, book.stretches, np.array([level], dtype=np.int64), times, ends, 1
    )
    return boundary, bool(settled[0])
