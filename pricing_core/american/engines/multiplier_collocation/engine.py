"""The engine of the collocation: values and their derivatives from the kernel."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import CURVES, Book, Rows
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import Prices, error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.differences import stored, unchanged
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.multiplier_collocation.greeks import by_spot, greeks_of, lacks_cuts
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
# Shares of the tolerance to which a contract is solved for its Greeks, as long as their errors are too large; chosen.
FURTHER_TOLERANCES = (1.0, 0.1, 0.01, 1e-3)
# How large the errors of Greeks may be, in tolerances times a power of the strike; chosen.
ALLOWED = {
    **dict.fromkeys(("delta", "dividend_sensitivities"), (10.0, 0)),
    **dict.fromkeys(("vega", "rho", "dividend_rho", *(f"{name}_buckets" for name in CURVES)), (10.0, 1)),
    **dict.fromkeys(("vanna", "charm"), (100.0, 0)),
    "gamma": (1000.0, -1),
    "volga": (100.0, 1),
}
VOLGA_STEP = 0.01  # Step of the volatility for volga, as a share of the contract's smallest one; calibrated.
VOLGA_STEPS = (
    -1.0,
    0.0,
    1.0,
    -2.0,
    2.0,
)  # The values that volga needs, in steps from the contract's own volatility.
CLOSE = 1e-9  # Tolerance, in strikes, of these values where a boundary has no fixed degree; chosen.
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
        """Solve to the tolerances; the Greeks are derivatives of the solution itself."""
        wanted = request.greeks != "none"
        solved = solve_to_tolerance(
            book, request.tolerance, request.threads, derivatives=wanted, interrupt=request.interrupt
        )
        believed = solved.settled & (solved.error <= np.maximum(request.tolerance, ROUGHEST))
        exercised = book.sign * (solved.boundary - log_moneyness(book)) >= 0.0
        columns: dict[str, Any] = by_spot(book, solved) | {"complete": True}
        ended = np.full(book.count, "ok", dtype=object)
        if wanted:
            greeks, late = _greeks(book, solved, np.flatnonzero(believed & ~exercised), request)
            columns |= greeks
            ended[late] = "deadline"
        return _in_money(book, solved, exercised, settled=believed, status=ended, **columns)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundary from two levels that are close enough, or from the closest two."""
        tolerance, schedule = request.tolerance[0], book.schedule(0)
        escrow = np.array([_escrow_at(book, float(time)) for time in times])
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
        last = schedule.segments[-1]
        if last.due == last.fraction == 0.0 and times[-1] == last.end:
            near[-1], error[-1] = region_at_expiry(schedule).boundaries(schedule)[0], 0.0
        return Boundaries(near, nothing, error, np.ones(times.size, dtype=bool))


def _in_money(book: Book, solved: Solved, exercised: BoolVector, **columns: Any) -> Prices:
    K = book.strike
    return priced(
        book,
        value=K * solved.value,
        european=K * solved.european,
        error=np.where(solved.settled, K * solved.error, math.nan),
        boundary=K * np.exp(solved.boundary) + book.escrow_now(),
        exercised=exercised,
        method="multiplier-collocation",
        solves=1 + solved.level,
        **columns,
    )


def _greeks(book: Book, solved: Solved, wanted: Rows, request: Request) -> tuple[dict[str, Any], Rows]:
    """Return the Greeks and their errors as columns, and the rows for which the interrupt came too early.

    Where an error is too large, a Greek is missing, or no segment ends where a Greek is asked for, the contract is
    solved again to a smaller tolerance; its price stays the first one. Rows that are not `wanted` are exercised, and
    nothing changes their value, or were not settled.
    """
    extended = request.greeks == "extended"
    columns = unchanged(book, extended=extended)
    columns |= {error_of(name): column for name, column in columns.items()}
    columns |= {error_of(name): np.zeros(book.count) for name in ("delta", "gamma")}
    if extended:
        columns |= dict.fromkeys(("charm", error_of("charm")), np.zeros(book.count))
    complete = np.ones(book.count, dtype=bool)
    complete[wanted] = False
    columns = by_spot(book, solved) | {name: _nan_at(column, wanted) for name, column in columns.items()}
    late = np.zeros(0, dtype=np.intp)
    rows, cuts_lacking = wanted, lacks_cuts(book, extended=extended)
    smallest = np.full(book.count, np.inf)  # the largest error so far, in what it may be
    for share in FURTHER_TOLERANCES:
        if rows.size == 0:
            break
        if request.is_interrupted():
            late = rows[~complete[rows]]
            break
        part = book.take(rows)
        found = solved.take(rows, book)
        if share < 1.0 or cuts_lacking[rows].any():
            part = with_cuts(part, _entries(part, extended=extended)) if cuts_lacking[rows].any() else part
            found = solve_to_tolerance(
                part,
                share * request.tolerance[rows],
                request.threads,
                derivatives=True,
                interrupt=request.interrupt,
            )
        part_columns = greeks_of(part, found, extended=extended)
        if extended:
            part_columns |= _volga(part, found, request)
        allowed = request.tolerance[rows]
        same = np.abs(found.value - solved.value[rows]) <= np.maximum(solved.error[rows], allowed)
        missed = np.where(same, _largest_error(part, part_columns, allowed), np.inf)
        better = missed < smallest[rows]
        smallest[rows] = np.minimum(smallest[rows], missed)
        complete[rows] = np.isfinite(smallest[rows])
        kept = np.flatnonzero(better)
        columns = stored(
            columns, rows[kept], {name: _taken(column, kept) for name, column in part_columns.items()}
        )
        rows = rows[~(smallest[rows] <= 1.0)]
    return columns | {"complete": complete}, late


def _largest_error(book: Book, columns: dict[str, Any], tolerance: Vector) -> Vector:
    """Return the largest error of the Greeks, each over what it may be at that tolerance; infinite where one lacks."""
    largest = np.zeros(book.count)
    for name, column in columns.items():
        greek = name.removesuffix("_error")
        if greek == name:
            continue
        tolerances, power = ALLOWED[greek]
        allowed = tolerances * tolerance * book.strike**power
        owner = column.owner() if isinstance(column, Ragged) else np.arange(book.count)
        numbers, errors = (
            each.values if isinstance(each, Ragged) else each for each in (columns.get(greek, column), column)
        )
        missed = np.where(np.isfinite(numbers) & np.isfinite(errors), errors / allowed[owner], np.inf)
        np.maximum.at(largest, owner, missed)
    return largest


def _volga(book: Book, solved: Solved, request: Request) -> dict[str, Vector]:
    """Return volga and its error: second differences of values that are solved alike, extrapolated from two steps.

    All boundaries have a fixed degree; where one of them is not found so, the values are solved to a small tolerance.
    """
    threads, interrupt = request.threads, request.interrupt
    step = VOLGA_STEP * np.minimum.reduceat(book.segments.volatility, book.first[:-1])
    level = np.minimum(solved.level + 1, FINEST)
    values = np.stack(
        [solve_at_level(_moved(book, by * step), level, threads, interrupt)[0] for by in VOLGA_STEPS]
    )
    rows = np.flatnonzero(np.isnan(values).any(axis=0))
    if rows.size:
        part, tolerance = book.take(rows), np.full(rows.size, CLOSE)
        for value, by in zip(values, VOLGA_STEPS, strict=True):
            moved = _moved(part, by * step[rows])
            value[rows] = solve_to_tolerance(moved, tolerance, threads, interrupt=interrupt).value
    second = book.strike * (values[0] - 2.0 * values[1] + values[2]) / step**2
    far = book.strike * (values[3] - 2.0 * values[1] + values[4]) / (2.0 * step) ** 2
    return {"volga": second + (second - far) / 3.0, error_of("volga"): np.abs(second - far)}


def _moved(book: Book, by: Vector) -> Book:
    """Return the contracts with their volatilities moved in parallel, each by its own step."""
    volatility = book.segments.volatility + book.per_segment(by)
    return replace(book, segments=replace(book.segments, volatility=volatility))


def _entries(book: Book, *, extended: bool) -> Ragged:
    """Return the times of all entries by which there are derivatives, one list per contract."""
    names = ("cash_dividends", *(CURVES if extended else ()))
    listed = [getattr(book.listed, name) for name in names]
    return Ragged.of([sum((times.row(row) for times in listed), ()) for row in range(book.count)])


def _nan_at(column: Vector | Ragged, rows: Rows) -> Vector | Ragged:
    """Return the column without numbers in some rows."""
    if isinstance(column, Ragged):
        return Ragged(column.first, np.where(np.isin(column.owner(), rows), math.nan, column.values))
    changed = column.copy()
    changed[rows] = math.nan
    return changed


def _taken(column: Vector | Ragged, rows: Rows) -> Vector | Ragged:
    return column.take(rows) if isinstance(column, Ragged) else column[rows]


def _escrow_at(book: Book, time: float) -> float:
    """Return what the escrowed dividends are worth just before what happens at `time`, money."""
    for segment in book.schedule(0).segments:
        if time <= segment.end * (1.0 + 1e-12):
            return segment.escrow_at(time)
    return 0.0
