"""Schedules to a tolerance, many at once, by the kernel's collocation of the multiplier.

`pricing_core.collocation_twin` tells the scheme. The kernel raises the degree of each boundary until what is left of
the value's last change, weighed by the chance to get there, is less than its share of the tolerance: each degree gains
a factor of three to ten, so that 0.6 of the last change bounds what is left. Where no degree is enough the stretch is
cut next to its event. How finely the value itself is held is the level's; calibrated on random contracts, checked in
tests.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.events.packed_schedules import PackedSchedules, pack
from pricing_core.arrays import BoolVector, Matrix, Vector

FINEST = 6  # level
FIRST_LEVELS = ((4e-6, 1), (4e-7, 2), (4e-8, 3), (0.0, 4))  # tolerances from which a level is tried first
NEGLECTED = (
    1e-5,
    1e-6,
    2e-8,
    1e-9,
    3e-11,
    1e-12,
    1e-13,
)  # strikes: what lies beyond the interval of each level
ROUNDING = 1e-13  # strikes
LEAST_SHARE = 0.1  # of the tolerance, that is left for the boundaries
FURTHEST = 30.0  # deviations between spot and strike
LARGEST_CALL_DEVIATION = 4.0
LARGEST_DRIFT = 6.0  # of ln(spot) in a segment, over its spread
SAFE = 3.5  # deviations by which the spot may fall before its dividends take it to zero
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

    There must be chance in every segment, no less than LARGEST_DRIFT allows, and none far shorter than the whole; spot
    and strike must be within reach of each other; a call's spot must not spread so far that its parts cancel; and no
    dividend may be likely to take a put's spot to zero, where the contact set begins in a way that is not followed.
    """
    starts, columns = book.first[:-1], book.columns()
    spread = columns.volatility * np.sqrt(columns.duration)
    deviation = np.sqrt(np.add.reduceat(spread * spread, starts))
    least = np.minimum.reduceat(spread, starts)
    served = (book.spot > 0.0) & (np.abs(book.x) <= FURTHEST * deviation)
    served &= (least >= LEAST_SPREAD) & (least >= deviation / WIDEST)
    drift = np.abs(columns.rate - columns.dividend_yield) * columns.duration
    served &= np.logical_and.reduceat(drift <= LARGEST_DRIFT * spread, starts)
    narrow = np.where(book.sign > 0.0, _keeps_its_spot(book, spread), deviation <= LARGEST_CALL_DEVIATION)
    return served & narrow


def _keeps_its_spot(book: PackedSchedules, spread: Vector) -> BoolVector:
    """Tell whether a put's dividends are small against its spot when they are paid, with all but certainty."""
    columns = book.columns()
    growth, left = np.exp((columns.rate - columns.dividend_yield) * columns.duration), 1.0 - columns.fraction
    forward, (variance, paid) = np.exp(book.x), np.zeros((2, book.x.size))
    lowest = np.empty(spread.size)  # at every end, before its dividend, on a path that falls as far as it may
    for rows, at in book.by_place():
        ahead = forward[rows] * growth[at]
        variance[rows] += spread[at] ** 2
        fallen = np.exp(-SAFE * np.sqrt(variance[rows]))
        lowest[at] = np.minimum(ahead, 1.0) * fallen - paid[rows] * (1.0 - fallen)
        forward[rows] = np.maximum(ahead * left[at] - columns.amount[at], 0.0)
        paid[rows] += columns.amount[at]
    likely = (columns.amount > 0.0) & (columns.amount >= lowest)
    jumps = (columns.fraction > 0.0) | (columns.amount > 0.0) | (columns.escrow > 0.0)
    between = jumps & (columns.exercisable > 0.0) & (columns.dividend_yield < 0.0) & (columns.rate > 0.0)
    # Where it lies between two spots, exercise begins in yet another way.
    return ~np.logical_or.reduceat(likely | between, book.first[:-1]) & (forward > 0.0)


def solve_to_tolerance(book: PackedSchedules, tolerance: Vector, threads: int) -> Solved:
    """Solve every schedule at the level of its tolerance, and at finer ones until its stated error meets that.

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
    european, _ = solve_book(book.european(), level, threads)
    solved = Solved(value, slope, curvature, boundary, european[0], *nothing)
    rows = np.arange(count)
    while rows.size:
        beyond = np.array(NEGLECTED)[level[rows]] + ROUNDING
        left = np.maximum(tolerance[rows] - beyond, LEAST_SHARE * tolerance[rows])
        found, settled = solve_book(book.take(rows), level[rows], threads, left)
        _keep(solved, rows, level[rows], found, settled, found[5] + beyond)
        rows = rows[~(solved.error[rows] <= tolerance[rows]) & (level[rows] < FINEST)]
        level[rows] += 1
    return solved


def _keep(
    solved: Solved,
    rows: NDArray[np.intp],
    level: NDArray[np.int64],
    found: Matrix,
    settled: BoolVector,
    error: Vector,
) -> None:
    """Store what these rows found, unless what is there has the smaller error."""
    better = settled & ((error <= solved.error[rows]) | ~solved.settled[rows])
    kept = rows[better]
    columns = (solved.value, solved.slope, solved.curvature, solved.boundary)
    for column, numbers in zip(columns, found[:4], strict=True):
        column[kept] = numbers[better]
    solved.error[kept], solved.level[kept] = error[better], level[better]
    solved.settled[kept] = True


def solve_book(
    book: PackedSchedules, level: NDArray[np.int64], threads: int, tolerance: Vector | None = None
) -> tuple[Matrix, BoolVector]:
    """Return the kernel's numbers, shape (6, n), and whether they may be used.

    Parameters
    ----------
    tolerance : Vector, shape (n,), optional
        Strikes, for the boundaries; each has its level's own degree without it.
    """
    nothing, none = np.zeros(0), np.zeros(book.x.size + 1, dtype=np.int64)
    if tolerance is None:
        tolerance = np.zeros(book.x.size)
    found, _, settled = kernel.solve_schedules(
        book.sign, book.x, book.first, book.stretches, level, tolerance, nothing, none, threads
    )
    return found, settled


def boundaries_at(schedule: Schedule, times: Vector, level: int) -> tuple[Vector, bool]:
    """Return ln(S*/K) at increasing times from now, just before what happens then, and whether all were found."""
    book = pack([schedule])
    ends = np.array([0, times.size], dtype=np.int64)
    numbers = book.sign, book.x, book.first, book.stretches, np.array([level], dtype=np.int64), np.zeros(1)
    _, boundary, settled = kernel.solve_schedules(*numbers, times, ends, 1)
    return boundary, bool(settled[0])
