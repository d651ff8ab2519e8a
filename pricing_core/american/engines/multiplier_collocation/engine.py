"""The engine of the collocation: values from the kernel, Greeks from bumped contracts at a fixed level."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.differences import Differences, plan_differences, stored, unchanged
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.multiplier_collocation.levels import (
    FINEST,
    Solved,
    boundaries_at,
    solve_at_level,
    solve_to_tolerance,
)
from pricing_core.american.engines.multiplier_collocation.served import is_served, log_moneyness
from pricing_core.arrays import BoolVector, Vector

# Largest error, in strikes, of a price that misses its tolerance and is still believed; measured.
ROUGHEST = 1e-6
CLOSE = 1e-8  # Tolerance of the boundaries, in strikes, where Greeks need degrees that follow the contract; chosen.
CLOSE_LEVEL = 4  # Level of the values at that tolerance; chosen.
SEGMENTS_AT_ONCE = 500  # Segments solved between two looks at the clock: a fraction of a second; chosen.
# Levels at which a boundary is tried first, ordinarily and at tight tolerances.
FIRST_LEVEL, TIGHT_LEVEL = 4, 5
TIGHT_TOLERANCE = 1e-7  # Tolerance, in strikes, from which boundaries begin at the finer level; chosen.
CAUTION = 3.0  # Stated error of a boundary, in distances of two levels; calibrated on reference boundaries.


class MultiplierCollocation:
    """Events, and one exercise boundary between any two of them."""

    name = "multiplier collocation"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts with events, and a positive volatility in every segment, that the collocation may be tried on.

        Those without events, which the march gives up, lie where the estimate of the error does not hold: their one
        segment is longer, or its rates are larger, than what it was calibrated on.
        """
        if kernel.solve_schedules is None:
            return np.zeros(book.count, dtype=bool)
        return is_served(book) & book.has_events()

    def solve(self, book: Book, request: Request) -> Prices:
        """Solve to the tolerances; Greeks are differences of bumped contracts, solved one level finer."""
        solved = solve_to_tolerance(book, request.tolerance, request.threads)
        believed = solved.settled & (solved.error <= np.maximum(request.tolerance, ROUGHEST))
        exercised = book.sign * (solved.boundary - log_moneyness(book)) >= 0.0
        columns: dict[str, Any] = {"complete": True}
        ended = np.full(book.count, "ok", dtype=object)
        if request.greeks != "none":
            wanted = np.flatnonzero(believed & ~exercised)
            columns, late = _derivatives(book, solved, wanted, request)
            ended[late] = "deadline"
        return _in_money(book, solved, exercised, settled=believed, status=ended, **columns)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundary from two levels that are close enough, or from the closest two."""
        tolerance, schedule = request.tolerance[0], book.schedule(0)
        escrow = np.array([_escrow_at(book, float(time)) for time in times])
        best: tuple[Vector, Vector] | None = None
        coarse: Vector | None = None
        for level in range((FIRST_LEVEL if tolerance > TIGHT_TOLERANCE else TIGHT_LEVEL) - 1, FINEST + 1):
            places, settled = boundaries_at(book, times, level)
            fine = schedule.strike * np.exp(places) + escrow if settled else None
            if fine is not None and coarse is not None:
                error = np.abs(fine - coarse)
                if best is None or np.nansum(error) < np.nansum(best[1]):
                    best = fine, error
                if np.nanmax(error / fine, initial=0.0) <= BOUNDARY_ACCURACY * math.sqrt(tolerance):
                    break
            coarse = fine
        nothing = np.full(times.size, math.nan)
        if best is None:
            return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
        near, error = best[0], CAUTION * best[1]
        last = schedule.segments[-1]
        if last.due == last.fraction == 0.0 and times[-1] == last.end:
            near[-1], error[-1] = region_at_expiry(schedule).boundaries(schedule)[0], 0.0
        return Boundaries(near, nothing, error, np.ones(times.size, dtype=bool))


def _in_money(book: Book, solved: Solved, exercised: BoolVector, **columns: Any) -> Prices:
    K, escrow = book.strike, book.escrow_now()
    S = book.spot - escrow
    return priced(
        book,
        value=K * solved.value,
        european=K * solved.european,
        error=np.where(solved.settled, K * solved.error, math.nan),
        delta=K / S * solved.slope,
        gamma=K / S * ((solved.curvature - solved.slope) / S),
        boundary=K * np.exp(solved.boundary) + escrow,
        exercised=exercised,
        method="multiplier-collocation",
        solves=1 + solved.level,
        **columns,
    )


def _derivatives(book: Book, solved: Solved, wanted: Rows, request: Request) -> tuple[dict[str, Any], Rows]:
    """Return the derivatives by the parameters as columns, and the rows for which the interrupt came too early.

    The level above that of the price gives every boundary a fixed degree: bumped or not, it is solved alike. Where a
    bumped contract does not settle so, or the contract itself has another value there than its price, which a boundary
    that its degree cannot follow makes it, the next level serves, then degrees of its own to a small tolerance. Rows
    that are not `wanted` are exercised, and nothing changes their value, or were not settled.
    """
    extended = request.greeks == "extended"
    columns = unchanged(book, extended=extended)
    complete = np.ones(book.count, dtype=bool)
    complete[wanted] = False
    late = np.zeros(0, dtype=np.intp)
    for above in (1, 2, None):
        rows = np.flatnonzero(~complete)
        if rows.size == 0 or late.size:
            break
        part = book.take(rows)
        plan = plan_differences(part, extended=extended)
        level = solved.level[rows] + above if above is not None else np.full(rows.size, CLOSE_LEVEL)
        level, tolerance = np.minimum(level, FINEST), 0.0 if above is not None else CLOSE
        value, delta = _bumped_values(plan, level, tolerance, request)
        own, _ = solve_at_level(part, level, request.threads, np.full(rows.size, tolerance))
        same = np.abs(own[0] - solved.value[rows]) <= np.maximum(solved.error[rows], request.tolerance[rows])
        missing = np.union1d(plan.row[np.isnan(value)], np.flatnonzero(~same))
        complete[np.delete(rows, missing)] = True
        columns = stored(columns, rows, plan.columns(value, delta))
        if missing.size and request.is_interrupted():
            late = rows[missing]
    return columns | {"complete": complete}, late


def _bumped_values(
    plan: Differences, level: NDArray[np.int64], tolerance: float, request: Request
) -> tuple[Vector, Vector]:
    """Return value and delta of the bumped contracts, money, NaN where they do not settle or time has run out."""
    book = plan.book
    value, delta = np.full((2, book.count), math.nan)
    for rows in _portions(book):
        if request.is_interrupted():
            break
        part = book.part(rows)
        levels = level[plan.row[rows]]
        numbers, settled = solve_at_level(part, levels, request.threads, np.full(levels.size, tolerance))
        spot = part.spot - part.escrow_now()
        value[rows] = np.where(settled, part.strike * numbers[0], math.nan)
        delta[rows] = np.where(settled, part.strike / spot * numbers[1], math.nan)
    return value, delta


def _portions(book: Book) -> Iterator[slice]:
    """Cut the book where the segments so far are enough for one call of the kernel."""
    start = 0
    while start < book.count:
        enough = int(np.searchsorted(book.first, book.first[start] + SEGMENTS_AT_ONCE))
        stop = min(max(enough, start + 1), book.count)
        yield slice(start, stop)
        start = stop


def _escrow_at(book: Book, time: float) -> float:
    """Return what the escrowed dividends are worth just before what happens at `time`, money."""
    for segment in book.schedule(0).segments:
        if time <= segment.end * (1.0 + 1e-12):
            return segment.escrow_at(time)
    return 0.0
