"""Books by the march of obstacle problems, one contract at a time.

`contract_problem.py` states a contract as a problem of `pricing_core.obstacle`, `greeks.py` takes its derivatives and
`contact_ends.py` its exercise boundaries.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import Prices, concatenated, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.engine import INTERRUPTED, UNRESOLVED, Request
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.obstacle_march.boundaries import Traces
from pricing_core.american.engines.obstacle_march.contact_ends import (
    boundary_now,
    coefficient_jumps,
    exercise_begins,
    traces_of,
)
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.american.engines.obstacle_march.greeks import by_parameters, by_place_and_time
from pricing_core.american.engines.price_bounds import range_of
from pricing_core.errors import NumericalError, PricingCoreError
from pricing_core.obstacle import Obstacle, ObstacleProblem, ObstacleSolution, solve
from pricing_core.obstacle.solution import march_again
from pricing_core.obstacle.solve import GAIN

FAILURES = (PricingCoreError, ArithmeticError, np.linalg.LinAlgError)
# Factors of the error estimates of a local volatility, which is not smooth everywhere, of an obstacle that moves, and
# where dividends are paid; calibrated.
ROUGH_SHARE, PAYING_SHARE = 2.0, 5.0
NEVER_MET = -1.0  # Value, in strikes, that no price falls to.


def solve_book(book: Book, request: Request) -> Prices:
    """Price one contract after the other."""
    return one_by_one(book, request, _priced)


def one_by_one(
    book: Book, request: Request, priced_alone: Callable[[Book, Request, tuple[float, float]], Prices]
) -> Prices:
    """Price one contract after the other; what fails numerically has the status "out_of_domain".

    Parameters
    ----------
    priced_alone : callable
        Takes a book of one contract, its request and its bounds of no arbitrage.
    """
    least, most = range_of(book)
    found = []
    for row in range(book.count):
        if request.is_interrupted():
            found.append(prices(1, status="deadline", method="none"))
            continue
        rows, within = slice(row, row + 1), (least.item(row), most.item(row))
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
                found.append(priced_alone(book.part(rows), request.take(rows), within))
        except FAILURES as error:
            found.append(prices(1, status="out_of_domain", method="none", message=str(error)))
    return concatenated(found)


def solved_traces(book: Book, request: Request) -> Traces:
    """Return the boundaries over time of a book of one contract, solved around its spot.

    Raises
    ------
    NumericalError
        The interrupt came before the end, or no grid resolves the contract.
    """
    try:
        problem = contract_problem(book, coefficient_jumps(book))
        found = solve(problem, place_of(book), request.tolerance.item(0), interrupt=request.interrupt)
    except FAILURES as error:
        raise NumericalError(f"the exercise boundary of this contract is out of reach: {error}") from error
    if found.status == "deadline":
        raise NumericalError(INTERRUPTED)
    return traces_of(book, found)


def _priced(book: Book, request: Request, within: tuple[float, float]) -> Prices:
    """Price a book of one contract, `within` its bounds of no arbitrage."""
    local, share = book.is_local().item(0), 1.0
    if ((book.drops() > 0.0) | (book.segments.fraction > 0.0)).any():
        share = PAYING_SHARE
    elif local or book.escrow_now().item(0) > 0.0:
        share = ROUGH_SHARE
    greeks, extended = request.greeks != "none", request.greeks == "extended"
    if greeks:  # whose derivatives want segments that end at every entry
        book = _cut(book, extended=extended)
    cut = extended and _has_curves(book)
    problem = contract_problem(book, exercise_begins(book) + (_dividends(book) if greeks else ()), cut=cut)
    place, strike = place_of(book), book.strike.item()
    found = solve(problem, place, request.tolerance.item(0) / share, interrupt=request.interrupt)
    european = _european(book, problem, found, request)
    if found.march is None or found.coarse is None or math.isnan(found.value):
        status = "deadline" if found.status == "deadline" else "out_of_domain"
        return prices(1, european=european, status=status, method="none", message=UNRESOLVED)
    boundary, boundary_error = boundary_now(book, found, request)
    exercised = bool(found.march.now.side(np.array([place]))[0] > 0)
    columns: dict[str, Any] = by_place_and_time(book, found, extended=extended)
    complete, late = True, found.status == "deadline"
    if greeks:
        derivatives = None if late else by_parameters(book, problem, found, request, held=not exercised)
        complete = derivatives is not None
        late = late or (not complete and request.is_interrupted())
        columns |= derivatives or {}
    return priced(
        book,
        value=np.clip(np.array([strike * found.value]), *within),
        european=np.array([european]),
        error=np.array([strike * share * found.error_estimate]),
        boundary=np.array([boundary]),
        boundary_error=np.array([boundary_error]),
        exercised=np.array([exercised]),
        complete=complete,
        settled=not late,
        status="deadline" if late else "ok",
        method="obstacle-march",
        steps=np.array([sum(found.march.steps)]),
        solves=np.array([round(math.log2(found.march.grid.refined)) + 1]),
        **columns,
    )


def _cut(book: Book, *, extended: bool) -> Book:
    """Return contracts with segments that end at every dividend and every curve's time that is listed."""
    listed = book.listed
    lists = [listed.cash_dividends]
    if extended:
        lists += [listed.rate, listed.dividend_yield, listed.volatility]
    if not any(column.values.size for column in lists):
        return book
    times = [sorted({t for column in lists for t in column.row(row)}) for row in range(book.count)]
    return with_cuts(book, Ragged.of(times))


def _dividends(book: Book) -> tuple[float, ...]:
    """Return the ends of segments at which a dividend is listed."""
    listed, ends = book.listed.cash_dividends.values, book.segments.end
    return (
        tuple(ends[np.abs(ends[:, None] - listed).min(axis=1) <= 1e-12 * ends[-1]].tolist())
        if listed.size
        else ()
    )


def _has_curves(book: Book) -> bool:
    listed = book.listed
    return any(column.values.size > 0 for column in (listed.rate, listed.dividend_yield, listed.volatility))


def _european(book: Book, problem: ObstacleProblem, found: ObstacleSolution, request: Request) -> float:
    """Return the price without early exercise, money: by the formula, or from the same grids; NaN where neither."""
    if book.local is None and not (book.drops() != 0.0).any():
        return float(european_columns(book, "none")["value"][0])
    if found.march is None or found.coarse is None:
        return math.nan
    if problem.lower is None:
        return book.strike.item() * float(found.value)
    if request.is_interrupted():
        return math.nan
    # An obstacle that is never met keeps the segments, and with them the steps.
    own = problem.lower
    held = replace(problem, lower=Obstacle(NEVER_MET, during=own.during, at=own.at))
    place = np.array([place_of(book)])
    fine, coarse = (march_again(held, own).now(place)[0] for own in (found.march, found.coarse))
    return book.strike.item() * max(float(fine + (fine - coarse) / (GAIN - 1.0)), 0.0)
