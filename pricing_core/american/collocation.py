"""Schedules to a tolerance, many at once, by the kernel's collocation of the multiplier.

`pricing_core.collocation_twin` tells the scheme. Its levels gain a factor of about five each, so the distance of two
neighbours bounds the error of the finer one, unless they agree by chance: a share of the early exercise premium is
added, where there is a boundary to resolve. Calibrated on random contracts, checked in tests.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.packed_schedules import PackedSchedules, pack
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

    def take(self, rows: NDArray[np.intp]) -> "Solved":
        """Return some of them."""
        return Solved(*(getattr(self, name)[rows] for name in self.__slots__))


def is_served(book: PackedSchedules) -> BoolVector:
    """Tell for which schedules the collocation may be tried.

    There must be chance in every segment, and none far shorter than the whole; spot and strike must be within
    reach of each other; a call's spot must not spread so far that its parts cancel; and no dividend may be likely
    to take a put's spot to nearly zero, where the contact set begins in a way that is not followed.
    """
    starts, columns = book.first[:-1], book.columns()
    spread = columns.volatility * np.sqrt(columns.duration)
    deviation = np.sqrt(np.add.reduceat(spread * spread, starts))
    least = np.minimum.reduceat(spread, starts)
    served = (book.spot > 0.0) & (np.abs(book.x) <= FURTHEST * deviation)
    served &= (least >= LEAST_SPREAD) & (least >= deviation / WIDEST)
    narrow = np.where(book.sign > 0.0, _keeps_its_spot(book, spread), deviation <= LARGEST_CALL_DEVIATION)
    return served & narrow


def _keeps_its_spot(book: PackedSchedules, spread: Vector) -> BoolVector:
    """Tell whether a put's dividends are small against its spot when they are paid, with all but certainty."""
    columns = book.columns()
    growth, left = np.exp((columns.rate - columns.dividend_yield) * columns.duration), 1.0 - columns.fraction
    forward, variance = np.exp(book.x), np.zeros(book.x.size)
    ahead, spreads = np.empty((2, spread.size))  # forward and variance at every end, before its dividend
    for rows, at in book.by_place():
        ahead[at] = grown = forward[rows] * growth[at]
        forward[rows] = np.maximum(grown * left[at] - columns.amount[at], 0.0)
        variance[rows] += spread[at] ** 2
        spreads[at] = variance[rows]
    with np.errstate(divide="ignore"):
        lowest = np.minimum(np.log(ahead), 0.0) - SAFE * np.sqrt(spreads)
        likely = np.log(columns.amount) + spread > lowest
    jumps = (columns.fraction > 0.0) | (columns.amount > 0.0) | (columns.escrow > 0.0)
    between = jumps & (columns.exercisable > 0.0) & (columns.dividend_yield < 0.0) & (columns.rate > 0.0)
    # Where it lies between two spots, exercise begins in yet another way.
    return ~np.logical_or.reduceat(likely | between, book.first[:-1]) & (forward > 0.0)


def solve_to_tolerance(book: PackedSchedules, tolerance: Vector, threads: int) -> Solved:
    """Refine every schedule until its stated error meets its tolerance, or to the finest level.

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Fractions of the strike.
    """
    count = book.x.size
    least, first = np.array(FIRST_LEVELS).T
    level = first[np.argmax(tolerance[:, None] >= least, axis=1)].astype(np.int64)
    value, slope, curvature, boundary = np.full((4, count), np.nan)
    nothing = np.full(count, np.inf), np.zeros(count, dtype=bool), level.copy()
    european, _ = solve_book(book.european(), np.maximum(level, EUROPEAN_LEVEL), threads)
    solved = Solved(value, slope, curvature, boundary, european[0], *nothing)
    found, settled = solve_book(book, level - 1, threads)
    coarse = np.where(settled, found[0], np.nan)
    rows = np.arange(count)
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
