"""Greeks with errors that suit the tolerance: from the solution that gave the price, or from finer ones if need be."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import error_of, taken
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.differences import (
    BUCKETS,
    DIVIDENDS,
    PARALLEL,
    Bump,
    plan_differences,
    smallest_of,
    stored,
    unchanged,
)
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.multiplier_collocation.greeks import (
    CHANGE,
    OWN,
    VOLATILITY,
    by_spot,
    greeks_of,
    lacks_cuts,
    with_entries,
)
from pricing_core.american.engines.multiplier_collocation.levels import (
    FINEST,
    Solved,
    pack,
    solve_once,
    solve_to_tolerance,
)
from pricing_core.arrays import BoolVector, Vector

# Share of the tolerance to which a contract is solved again for Greeks whose errors are too large; chosen.
FINER = 0.03
# Shares of how far the finer solution's derivatives are from the first one's, and of the first one's changes with the
# degrees, that stand for the changes of the finer ones; calibrated on random contracts.
MOVED_SHARE, CHANGE_SHARE = 0.13, 0.03
# How large the errors of Greeks should be at most, in tolerances times a power of the strike; chosen.
ALLOWED = {
    **dict.fromkeys(("delta", DIVIDENDS), (10.0, 0)),
    **dict.fromkeys((*PARALLEL.values(), *BUCKETS.values()), (10.0, 1)),
    **dict.fromkeys(("vanna", "charm"), (100.0, 0)),
    "gamma": (1000.0, -1),
    "volga": (100.0, 1),
}
# How much larger an estimate may be: it is some thirty times the error in the median; calibrated on random contracts.
PESSIMISM = 5.0
VOLGA_PESSIMISM = 4.0  # The same of volga, whose estimate is closer; calibrated likewise.
LEAST_TOLERANCE = 1e-7  # Smallest tolerance, in strikes, that the errors of Greeks are measured by; chosen.
CLOSE = 1e-8  # Tolerance, in strikes, of values whose differences are taken; chosen.
# Error of a derivative by a parameter, in strikes, from which on differences are tried; chosen: they take many solves.
BY_DIFFERENCES = 1e-2
DIFFERENCE_SHARES = (1.0, 0.5)  # Steps of differences, in the usual ones; chosen.
# Error of a second difference by its step, in squared shares of that, over volga and vega over the volatility, and over
# what it is if the value falls with the square of its distance from the strike; calibrated likewise.
VOLGA_TRUNCATION, FAR_TRUNCATION = 1.5, 0.3
Columns = dict[str, Any]


class Differences(NamedTuple):
    """How volga is found by differences.

    Parameters
    ----------
    step : float
        Step of the volatility, as a share of the contract's smallest one.
    vega_share, slope_share : float
        Error of volga over that of vega, in smallest volatilities, and over how far vega by the differences is from it,
        in steps.
    """

    step: float
    vega_share: float
    slope_share: float


# Volga from values and from vegas; calibrated on random contracts.
BY_VALUES, BY_VEGAS = Differences(0.005, 1.0, 0.015), Differences(0.0025, 0.2, 0.1)


def greeks_to_tolerance(
    book: Book, solved: Solved, exercised: BoolVector, believed: BoolVector, request: Request
) -> tuple[Columns, Rows]:
    """Return the Greeks and their errors as columns, and the rows for which the interrupt came too early.

    Contracts without a segment that ends where a Greek is asked for are solved again with one. Where an error is too
    large, or a Greek is missing, the contract is solved to a smaller tolerance; its price stays the first one. What
    is still far off is taken from differences. Nothing changes the value of those that are `exercised`, and nothing is
    known of those that are not `believed`; both have shape (n,).
    """
    extended = request.greeks == "extended"
    wanted, complete = np.flatnonzero(believed & ~exercised), exercised.copy()
    refused = np.zeros(book.count, dtype=bool)
    columns = _nothing_known(book, solved, np.flatnonzero(~exercised), extended=extended)
    lacking = lacks_cuts(book, extended=extended)
    for rows in (wanted[~lacking[wanted]], wanted[lacking[wanted]]):
        if rows.size == 0:
            continue
        if request.is_interrupted():
            break
        part, first = book.take(rows), solved.take(rows, book)
        found, missed, refused[rows] = _first_or_finer(
            part, first, request.take(rows), lacking=bool(lacking[rows[0]])
        )
        known = np.flatnonzero(missed < np.inf)
        columns = stored(columns, rows[known], {name: taken(column, known) for name, column in found.items()})
        complete[rows[known]] = True
    doubtful = [columns[error_of(greek)][wanted] / book.strike[wanted] for greek in PARALLEL.values()]
    rows = wanted[(complete & ~refused)[wanted] & (np.max(doubtful, axis=0) > BY_DIFFERENCES)]
    if rows.size and not request.is_interrupted():
        closer = _closer(book.take(rows), columns, rows, request)
        columns |= stored({name: columns[name] for name in closer}, rows, closer)
    late = wanted[~complete[wanted]] if request.is_interrupted() else np.zeros(0, dtype=np.intp)
    return columns | {"complete": complete}, late


def _first_or_finer(
    book: Book, first: Solved, request: Request, *, lacking: bool
) -> tuple[Columns, Vector, BoolVector]:
    """Return the Greeks of the first solution, or of a finer one where those have too large errors.

    The second result is the largest error of each contract over what it should be at most; the third tells where the
    finer solution was not found, so that still finer ones would be sought in vain. `lacking` tells that no segment ends
    at some entries by which there is a derivative.
    """
    extended, threads, interrupt = request.greeks == "extended", request.threads, request.interrupt
    price, error = first.value, np.maximum(first.error, request.tolerance)
    if lacking:
        book = with_entries(book, extended=extended)
        step = volatility_step(book) if extended else None
        first = solve_to_tolerance(
            book, request.tolerance, threads, walks=2, volatility_step=step, interrupt=interrupt
        )
    found, missed = _greeks_and_errors(book, first, (price, error), request)
    volga = _volga_by_values(book, first, found) if extended else {}
    lacks_volga = ~(_largest_error(book, volga, request.tolerance) <= VOLGA_PESSIMISM)
    rows = np.flatnonzero(~(missed <= PESSIMISM) | lacks_volga)
    refused = np.zeros(book.count, dtype=bool)
    if rows.size and not request.is_interrupted():
        part, coarse, asked = book.take(rows), first.take(rows, book), request.take(rows)
        level, step = np.minimum(coarse.level + 1, FINEST), None
        if extended:
            step = np.where(lacks_volga[rows], volatility_step(part), 0.0)
        fine = solve_once(pack(part), level, FINER * asked.tolerance, threads, 1, interrupt, step)
        refused[rows] = ~fine.settled
        with np.errstate(invalid="ignore"):  # a derivative that was not found is not finite
            moved = np.abs(fine.gradient[:, OWN] - coarse.gradient[:, OWN])
        fine.gradient[:, CHANGE] = MOVED_SHARE * moved + CHANGE_SHARE * coarse.gradient[:, CHANGE]
        finer, still = _greeks_and_errors(part, fine, (price[rows], error[rows]), asked)
        better = np.flatnonzero(still < missed[rows])
        missed[rows[better]] = still[better]
        found = stored(found, rows[better], {name: taken(column, better) for name, column in finer.items()})
        if extended:
            volga = _closest(volga, rows, _volga_by_values(part, fine, finer))
    if extended:
        found |= _volga_to_tolerance(book, volga, found, ~refused, request)
        missed = np.where(np.isnan(found["volga"]), np.inf, missed)
    return found, missed, refused


def _greeks_and_errors(
    book: Book, solved: Solved, priced: tuple[Vector, Vector], request: Request
) -> tuple[Columns, Vector]:
    """Return the Greeks of a solution but volga, and the largest of their errors over what it should be at most.

    That is infinite where a Greek lacks, or where the solution's value is not the one `priced`, V/K, within its error.
    """
    columns = greeks_of(book, solved, extended=request.greeks == "extended")
    same = np.abs(solved.value - priced[0]) <= priced[1]
    return columns, np.where(same, _largest_error(book, columns, request.tolerance), np.inf)


def _nothing_known(book: Book, solved: Solved, unknown: Rows, *, extended: bool) -> Columns:
    """Return delta and gamma, and the other columns of what no parameter changes, with NaN in the rows `unknown`."""
    columns = unchanged(book, extended=extended)
    columns |= {error_of(name): column for name, column in columns.items()}
    columns |= {error_of(name): np.zeros(book.count) for name in ("delta", "gamma")}
    if extended:
        columns |= dict.fromkeys(("charm", error_of("charm")), np.zeros(book.count))
    for name, column in columns.items():
        if isinstance(column, Ragged):
            values = np.where(np.isin(column.owner(), unknown), math.nan, column.values)
            columns[name] = Ragged(column.first, values)
        else:
            columns[name] = column.copy()
            columns[name][unknown] = math.nan
    return columns | by_spot(book, solved)


def _largest_error(book: Book, columns: Columns, tolerance: Vector) -> Vector:
    """Return the largest error of the Greeks, each over what it may be at that tolerance; infinite where one lacks."""
    largest, tolerance = np.zeros(book.count), np.maximum(tolerance, LEAST_TOLERANCE)
    for greek, (tolerances, power) in ALLOWED.items():
        if error_of(greek) not in columns:
            continue
        column, error = columns[greek], columns[error_of(greek)]
        owner = column.owner() if isinstance(column, Ragged) else np.arange(book.count)
        numbers, errors = (each.values if isinstance(each, Ragged) else each for each in (column, error))
        allowed = tolerances * tolerance * book.strike**power
        missed = np.where(np.isfinite(numbers) & np.isfinite(errors), errors / allowed[owner], np.inf)
        np.maximum.at(largest, owner, missed)
    return largest


def _closer(book: Book, columns: Columns, rows: Rows, request: Request) -> Columns:
    """Return the derivatives by parameters and dividends from extrapolated differences, where these are closer.

    The adjoint is not close where the boundary moves a long way with a parameter.
    """
    found = []
    for share in DIFFERENCE_SHARES:
        plan = plan_differences(book, extended=False, share=share)
        tolerance, K = np.full(plan.book.count, CLOSE), plan.book.strike
        solved = solve_to_tolerance(plan.book, tolerance, request.threads, interrupt=request.interrupt)
        value = np.where(solved.settled, K * solved.value, math.nan)
        found.append((plan.columns(value, value), plan.noise(K * solved.error)))
    (far, _), (near, noise) = found
    closer: Columns = {}
    for greek in (*PARALLEL.values(), DIVIDENDS):
        value, error = (taken(columns[name], rows) for name in (greek, error_of(greek)))
        steps = far[greek], near[greek], noise[greek]
        if isinstance(value, Ragged):
            numbers, errors = _better(value.values, error.values, *(each.values for each in steps))
            closer[greek], closer[error_of(greek)] = Ragged(value.first, numbers), Ragged(value.first, errors)
        else:
            closer[greek], closer[error_of(greek)] = _better(value, error, *steps)
    for name, greek in PARALLEL.items():
        if BUCKETS[name] in columns:  # their sum stays the parallel derivative
            buckets, errors = (
                taken(columns[each], rows) for each in (BUCKETS[name], error_of(BUCKETS[name]))
            )
            owner = buckets.owner()
            share = errors.values / np.bincount(owner, errors.values, book.count)[owner]
            moved = (closer[greek] - columns[greek][rows])[owner]
            closer[BUCKETS[name]] = Ragged(buckets.first, buckets.values + share * moved)
    return closer


def _better(value: Vector, error: Vector, far: Vector, near: Vector, noise: Vector) -> tuple[Vector, Vector]:
    """Return the differences, extrapolated from both steps, where their distance and noise are less than the error."""
    distance = np.abs(near - far) + noise
    closer = distance < error
    return np.where(closer, near + (near - far) / 3.0, value), np.where(closer, distance, error)


def volatility_step(book: Book) -> Vector:
    """Return the step of the volatility to the values nearby from which volga is found, shape (n,)."""
    return BY_VALUES.step * smallest_of(book, book.segments.volatility)


def _volga_by_values(book: Book, solved: Solved, greeks: Columns) -> Columns:
    """Return volga from the solution's values nearby, NaN without these, and its error; `greeks` are the solution's."""
    smallest = smallest_of(book, book.segments.volatility)
    step = BY_VALUES.step * smallest
    down, same, up = (book.strike * value for value in solved.nearby.T)
    by_values = (up - down) / (2.0 * step), (up - 2.0 * same + down) / step**2
    return _with_error(by_values, greeks, smallest, BY_VALUES)


def _closest(columns: Columns, rows: Rows, found: Columns) -> Columns:
    """Return volga and its error with those found for some rows put in where that error is smaller."""
    error = error_of("volga")
    better = np.flatnonzero(np.isfinite(found[error]) & ~(columns[error][rows] <= found[error]))
    return stored(columns, rows[better], {name: column[better] for name, column in found.items()})


def _volga_to_tolerance(
    book: Book, volga: Columns, greeks: Columns, solvable: BoolVector, request: Request
) -> Columns:
    """Return volga and its error from vegas to a small tolerance where the error from values is too large.

    Parameters
    ----------
    solvable : bool array, shape (n,)
        Where such a small tolerance is tried.
    """
    rows = np.flatnonzero(solvable & ~(_largest_error(book, volga, request.tolerance) <= VOLGA_PESSIMISM))
    if rows.size == 0 or request.is_interrupted():
        return volga
    part, known = book.take(rows), {name: greeks[name][rows] for name in ("vega", error_of("vega"))}
    smallest = smallest_of(part, part.segments.volatility)
    by_vegas = _difference_of_vegas(part, BY_VEGAS.step * smallest, request)
    return _closest(volga, rows, _with_error(by_vegas, known, smallest, BY_VEGAS))


def _with_error(
    found: tuple[Vector, Vector], vega: Columns, smallest: Vector, differences: Differences
) -> Columns:
    """Return volga and its error from vega and volga by differences, and the smallest volatility of each contract."""
    (slope, volga), step = found, differences.step * smallest
    per_volatility = np.abs(vega["vega"]) / smallest
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        far = np.nan_to_num((volga / per_volatility) ** 2, posinf=0.0)
    curved = VOLGA_TRUNCATION * (np.abs(volga) + per_volatility) + FAR_TRUNCATION * far * np.abs(volga)
    error = differences.step**2 * curved + differences.vega_share * vega[error_of("vega")] / smallest
    error += differences.slope_share * np.abs(slope - vega["vega"]) / step
    return {"volga": volga, error_of("volga"): error}


def _difference_of_vegas(book: Book, step: Vector, request: Request) -> tuple[Vector, Vector]:
    """Return the mean of the vegas at both steps of the volatility, money, and their difference per volatility."""
    bumped, tolerance = Bump(book, "volatility"), np.full(book.count, CLOSE)
    down, up = (
        _vega(
            solve_to_tolerance(moved, tolerance, request.threads, walks=1, interrupt=request.interrupt), moved
        )
        for moved in (bumped(-step), bumped(step))
    )
    return 0.5 * (up + down), (up - down) / (2.0 * step)


def _vega(solved: Solved, book: Book) -> Vector:
    """Return vega, money; NaN where the derivative was not found."""
    vega: Vector = np.add.reduceat(solved.gradient[:, OWN, 0, VOLATILITY], book.first[:-1])
    return book.strike * vega
