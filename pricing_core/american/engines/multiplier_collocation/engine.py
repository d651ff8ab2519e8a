"""The engine of the collocation: values and their derivatives from the kernel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.schedule import SAME_TIME, Schedule
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.multiplier_collocation.far_boundary import begun_at, far_boundaries
from pricing_core.american.engines.multiplier_collocation.greeks import by_spot
from pricing_core.american.engines.multiplier_collocation.greeks_to_tolerance import (
    greeks_to_tolerance,
    volatility_step,
)
from pricing_core.american.engines.multiplier_collocation.levels import (
    FINEST,
    Packed,
    Solved,
    boundaries_at,
    european_values,
    pack,
    solve_to_tolerance,
)
from pricing_core.american.engines.multiplier_collocation.served import is_served, log_moneyness
from pricing_core.arrays import BoolVector, Vector

# Largest error, in strikes, of a price that misses its tolerance and is still believed; measured.
ROUGHEST = 1e-6
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
        return is_served(book) & book.has_events() & ~book.is_local()

    def solve(self, book: Book, request: Request) -> Prices:
        """Solve to the tolerances; the Greeks are derivatives of the solution itself."""
        wanted = request.greeks != "none"
        step = volatility_step(book) if request.greeks == "extended" else None
        solved = solve_to_tolerance(
            book,
            request.tolerance,
            request.threads,
            walks=2 * wanted,
            volatility_step=step,
            interrupt=request.interrupt,
        )
        believed = solved.settled & (solved.error <= np.maximum(request.tolerance, ROUGHEST))
        exercised = book.sign * (solved.boundary - log_moneyness(book)) >= 0.0
        packed = pack(book)
        boundary = _with_far_boundaries(packed, solved, request)
        # Before the Greeks: what ends these leaves the price whole.
        european = european_values(packed, request.tolerance, request.threads, request.interrupt)
        columns: dict[str, Any] = by_spot(book, solved) | {
            "complete": True,
            "european": book.strike * european,
        }
        ended = np.full(book.count, "ok", dtype=object)
        if wanted:
            greeks, late = greeks_to_tolerance(book, solved, exercised, believed, request)
            columns |= greeks
            ended[late] = "deadline"
        return _in_money(book, solved, boundary, exercised, settled=believed, status=ended, **columns)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundary from two levels that are close enough, or from the closest two."""
        tolerance, schedule = request.tolerance[0], book.schedule(0)
        escrow = np.array([_escrow_at(schedule, float(time)) for time in times])
        best: tuple[Vector, Vector] | None = None
        coarse: Vector | None = None
        for level in range((FIRST_LEVEL if tolerance > TIGHT_TOLERANCE else TIGHT_LEVEL) - 1, FINEST + 1):
            places, settled = boundaries_at(book, times, level, request.interrupt)
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
        far = np.flatnonzero(np.isnan(near) & (times < schedule.segments[-1].end))
        if far.size and book.is_put[0]:
            near[far], error[far] = _far_at(book, times[far], escrow[far], request)
        if book.is_put[0] and book.escrowed[0]:
            waits = _pays_to_wait(schedule, times)
            near[waits] = error[waits] = math.nan
        last = schedule.segments[-1]
        if last.due == last.fraction == 0.0 and times[-1] == last.end:
            near[-1], error[-1] = region_at_expiry(schedule).boundaries(schedule)[0], 0.0
        return Boundaries(near, nothing, error, np.ones(times.size, dtype=bool))


def _in_money(book: Book, solved: Solved, boundary: Vector, exercised: BoolVector, **columns: Any) -> Prices:
    K = book.strike
    return priced(
        book,
        value=K * solved.value,
        error=np.where(solved.settled, K * solved.error, math.nan),
        boundary=K * np.exp(boundary) + book.escrow_now(),
        exercised=exercised,
        method="multiplier-collocation",
        solves=1 + solved.level,
        **columns,
    )


def _with_far_boundaries(packed: Packed, solved: Solved, request: Request) -> Vector:
    """Return ln(S*/K) now, of puts also where that is too far from the spot to matter to the price."""
    rows = np.flatnonzero(solved.settled & np.isnan(solved.boundary) & (packed.sign > 0.0))
    if rows.size == 0 or request.is_interrupted():
        return solved.boundary
    boundary, level = solved.boundary.copy(), solved.level[rows]
    boundary[rows] = far_boundaries(packed.take(rows), level, request.threads, request.interrupt)
    return boundary


def _far_at(book: Book, times: Vector, escrow: Vector, request: Request) -> tuple[Vector, Vector]:
    """Return a put's boundaries at times at which they do not matter at its spot, and their errors, money."""
    begun = begun_at(pack(book), times)
    rough, near = (
        book.strike * np.exp(far_boundaries(begun, np.full(times.size, level), 1, request.interrupt)) + escrow
        for level in (FIRST_LEVEL, TIGHT_LEVEL)
    )
    return near, CAUTION * np.abs(near - rough)


def _pays_to_wait(schedule: Schedule, times: Vector) -> BoolVector:
    """Tell at which times the holder of an escrowed put waits at least until a payment at that time is over."""
    segments = schedule.segments
    later = [*(segment.exercisable for segment in segments[1:]), True]
    ends = [s.end for s, may_exercise in zip(segments, later, strict=True) if s.due > 0.0 and may_exercise]
    waits: BoolVector = np.isclose(times[:, None], np.array(ends), rtol=SAME_TIME, atol=0.0).any(axis=1)
    return waits


def _escrow_at(schedule: Schedule, time: float) -> float:
    """Return what the escrowed dividends are worth just before what happens at `time`, money."""
    for segment in schedule.segments:
        if time <= segment.end * (1.0 + SAME_TIME):
            return segment.escrow_at(time)
    return 0.0
