"""Contracts to a tolerance, many at once, by the kernel's collocation of the multiplier.

The kernel raises the degree of each boundary until what is left of the value's last change, weighted by the probability
to get there, is less than its share of the tolerance: each degree gains a factor of three to ten, so that 0.6 of the
last change bounds what is left. Where no degree is enough the segment is cut next to its event. How finely the value
itself is held is the level's; calibrated on random contracts, checked in tests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.ragged import gather
from pricing_core.american.engines.multiplier_collocation.served import log_moneyness
from pricing_core.arrays import BoolVector, Matrix, Vector

FINEST = 6  # Finest level of the kernel.
# Tolerances from which a level is tried first; calibrated on random contracts.
FIRST_LEVELS = ((4e-6, 1), (4e-7, 2), (4e-8, 3), (0.0, 4))
# What lies beyond the interval of space of each level, in strikes; derived from the interval.
NEGLECTED = (1e-5, 1e-6, 6e-8, 1e-9, 3e-11, 1e-12, 1e-13)
ROUNDING = 1e-13  # Rounding error of a value, in strikes; measured.
# Share of the last level's error above which a finer level brings nothing, and error, in tolerances, above which it is
# not tried again then; chosen.
LEAST_GAIN, OUT_OF_REACH = 0.8, 1.2
SMALLEST_SHARE = 0.1  # Smallest share of the tolerance that is left for the boundaries; chosen.
EXERCISE = slice(4, 6)  # The columns of a segment that tell when the holder may exercise.
AMOUNT, ESCROW = 7, 8  # The columns of money.
# What the kernel's numbers say of the value's error, in strikes, and of the values nearby.
ERROR, NEARBY = 5, slice(6, 9)


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """Contracts, n of them with m segments in all, money in strikes.

    Parameters
    ----------
    sign : Vector, shape (n,)
        1 for a put, -1 for a call.
    x : Vector, shape (n,)
        ln(S/K) of the spot that diffuses.
    first : int array, shape (n + 1,)
        Where the segments of each contract begin, and the end.
    segments : Matrix, shape (m, 9)
        Duration, rate, dividend yield, volatility, exercisable and exercise at end (0 or 1), fraction, amount, escrow.
    """

    sign: Vector
    x: Vector
    first: NDArray[np.int64]
    segments: Matrix

    def take(self, rows: Rows) -> Packed:
        """Return some of the contracts, in the order asked for."""
        if rows.size == self.x.size:
            return self
        first, chosen = gather(self.first, rows)
        return Packed(self.sign[rows], self.x[rows], first, self.segments[chosen])

    def european(self) -> Packed:
        """Return the same contracts without early exercise."""
        segments = self.segments.copy()
        segments[:, EXERCISE] = 0.0
        return replace(self, segments=segments)


def pack(book: Book) -> Packed:
    """Return the book for the kernel."""
    columns, strike = book.segments, book.per_segment(book.strike)
    segments = np.empty((columns.end.size, 9))
    segments[:, 0], segments[:, 1] = columns.duration, columns.rate
    segments[:, 2], segments[:, 3] = columns.dividend_yield, columns.volatility
    segments[:, 4], segments[:, 5] = columns.exercisable, columns.exercise_at_end
    segments[:, 6] = columns.fraction
    segments[:, AMOUNT], segments[:, ESCROW] = book.drops() / strike, book.escrow() / strike
    return Packed(book.sign, log_moneyness(book), book.first, segments)


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """The solution of the collocation for each schedule, in strikes; arrays have shape (n,) unless stated.

    Parameters
    ----------
    value, slope, curvature : Vector
        V/K and its first and second derivative by x = ln(S/K).
    boundary : Vector
        ln(S*/K) now; NaN without one.
    error : Vector
        Error estimate of the value.
    settled : bool array
        Whether the collocation found every boundary; nothing in the other columns may be used where it did not.
    level : int array
        The level at which the value was found.
    gradient : array, shape (m, 2, 2, 6), or (0, 2, 2, 6) where derivatives were not asked for
        The derivatives of value and slope (third axis) by the rate, yield, volatility, amount and escrow of each
        segment, what exercise on it contributes, and (second axis) how far all that changes with the degrees of the
        boundaries; NaN what is not found or was not asked for.
    nearby : Matrix, shape (n, 3)
        V/K at volatilities lower by a step, the same and higher, solved alike; NaN what is not found or not asked for.
    """

    value: Vector
    slope: Vector
    curvature: Vector
    boundary: Vector
    error: Vector
    settled: BoolVector
    level: NDArray[np.int64]
    gradient: NDArray[np.float64]
    nearby: Matrix

    def take(self, rows: Rows, book: Book) -> Solved:
        """Return some rows of the solution."""
        columns = {name: getattr(self, name)[rows] for name in self.__slots__ if name != "gradient"}
        return Solved(**columns, gradient=self.gradient[gather(book.first, rows)[1]])


def solve_to_tolerance(
    book: Book,
    tolerance: Vector,
    threads: int,
    *,
    walks: int = 0,
    volatility_step: Vector | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Solved:
    """Solve every contract at the level of its tolerance, and at finer ones until its error meets that or stalls.

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Fractions of the strike.
    walks : int
        0, 1 for the derivatives by the segments' numbers, 2 for their changes with the boundaries' degrees as well; the
        values do not depend on it.
    volatility_step : Vector, shape (n,), optional
        Step of all volatilities for the values nearby, which take at least one walk.
    interrupt : callable, optional
        True ends the work; what is not solved then is not settled.
    """
    packed, level = pack(book), _first_levels(tolerance)
    solved = solve_once(packed, level, tolerance, threads, walks, interrupt, volatility_step)
    rows, before = np.arange(book.count), np.full(book.count, np.inf)
    error = solved.error
    while True:
        met = solved.error[rows] <= tolerance[rows]
        stalls = (error > LEAST_GAIN * before) & (error > OUT_OF_REACH * tolerance[rows])
        rows = rows[~met & ~stalls & (level[rows] < FINEST)]
        if rows.size == 0 or (interrupt is not None and interrupt()):
            return solved
        level[rows] += 1
        step = None if volatility_step is None else volatility_step[rows]
        finer = solve_once(packed.take(rows), level[rows], tolerance[rows], threads, walks, interrupt, step)
        before, error = solved.error[rows], finer.error
        _keep(solved, book, rows, finer)


def solve_once(
    packed: Packed,
    level: NDArray[np.int64],
    tolerance: Vector,
    threads: int,
    walks: int,
    interrupt: Callable[[], bool] | None,
    volatility_step: Vector | None = None,
) -> Solved:
    """Solve every contract at its level, with boundaries to the tolerance in fractions of the strike."""
    beyond = np.array(NEGLECTED)[level] + ROUNDING
    left = np.maximum(tolerance - beyond, SMALLEST_SHARE * tolerance)
    found = kernel_values(
        packed, level, threads, left, walks=walks, volatility_step=volatility_step, interrupt=interrupt
    )
    error = np.where(found.settled, found.numbers[ERROR] + beyond, np.inf)
    value, slope, curvature, boundary = np.where(found.settled, found.numbers[:4], np.nan)
    return Solved(
        value, slope, curvature, boundary, error, found.settled, level.copy(), found.gradient,
        found.numbers[NEARBY].T.copy(),
    )  # fmt: skip


def european_values(
    packed: Packed, tolerance: Vector, threads: int, interrupt: Callable[[], bool] | None = None
) -> Vector:
    """Return V/K without early exercise at the levels of the tolerances, shape (n,)."""
    found = kernel_values(
        packed.european(), _first_levels(tolerance), threads, tolerance, interrupt=interrupt
    )
    value: Vector = found.numbers[0]
    return value


def _first_levels(tolerance: Vector) -> NDArray[np.int64]:
    least, first = np.array(FIRST_LEVELS).T
    level: NDArray[np.int64] = first[np.argmax(tolerance[:, None] >= least, axis=1)].astype(np.int64)
    return level


def _keep(solved: Solved, book: Book, rows: Rows, finer: Solved) -> None:
    """Store what these rows found, unless what is there has the smaller error."""
    better = np.flatnonzero(finer.settled & (finer.error <= solved.error[rows]))
    kept = rows[better]
    for name in ("value", "slope", "curvature", "boundary", "error", "settled", "level", "nearby"):
        getattr(solved, name)[kept] = getattr(finer, name)[better]
    if finer.gradient.size:
        first, _ = gather(book.first, rows)
        solved.gradient[gather(book.first, kept)[1]] = finer.gradient[gather(first, better)[1]]


class KernelValues(NamedTuple):
    """What the kernel's `solve_schedules` returns for n contracts with m segments in all."""

    numbers: Matrix
    settled: BoolVector
    gradient: NDArray[np.float64]


def solve_at_level(
    book: Book, level: NDArray[np.int64], threads: int, interrupt: Callable[[], bool] | None = None
) -> KernelValues:
    """Solve the contracts with the degree of the level at every boundary, and return what the kernel finds.

    Contracts that differ little are solved alike as a rule.
    """
    return kernel_values(pack(book), level, threads, np.zeros(level.size), interrupt=interrupt)


def kernel_values(
    packed: Packed,
    level: NDArray[np.int64],
    threads: int,
    tolerance: Vector,
    *,
    walks: int = 0,
    volatility_step: Vector | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> KernelValues:
    """Solve the contracts at these levels; where the tolerance is 0 every boundary has the degree of its level."""
    assert kernel.solve_schedules is not None
    nothing, none = np.zeros(0), np.zeros(packed.x.size + 1, dtype=np.int64)
    step = np.zeros(packed.x.size) if volatility_step is None else volatility_step
    numbers, _, settled, gradient = kernel.solve_schedules(
        packed.sign, packed.x, packed.first, packed.segments, level, tolerance, step, nothing, none,
        walks, threads, interrupt,
    )  # fmt: skip
    return KernelValues(numbers, settled, gradient)


def boundaries_at(
    book: Book, times: Vector, level: int, interrupt: Callable[[], bool] | None = None
) -> tuple[Vector, bool]:
    """Return ln(S*/K) at increasing times from now, just before what happens then, and whether all were found.

    Parameters
    ----------
    book : Book
        One contract.
    """
    assert kernel.solve_schedules is not None
    packed, ends = pack(book), np.array([0, times.size], dtype=np.int64)
    numbers = (
        packed.sign,
        packed.x,
        packed.first,
        packed.segments,
        np.array([level], dtype=np.int64),
        np.zeros(1),
        np.zeros(1),
    )
    _, boundary, settled, _ = kernel.solve_schedules(*numbers, times, ends, 0, 1, interrupt)
    return boundary, bool(settled[0])
