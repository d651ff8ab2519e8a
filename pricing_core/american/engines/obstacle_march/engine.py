"""The engine of the march of obstacle problems: every contract, one at a time.

`contract_problem.py` states a contract as a problem of `pricing_core.obstacle`, `greeks.py` takes its derivatives and
`boundaries.py` its exercise boundaries.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import Prices, concatenated, prices
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.obstacle_march.boundaries import Ends, boundary_now, ends_at, first_places
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.american.engines.obstacle_march.greeks import by_parameters, by_place_and_time
from pricing_core.american.engines.price_bounds import range_of
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError, PricingCoreError
from pricing_core.obstacle import ObstacleProblem, ObstacleSolution, solve
from pricing_core.obstacle.solution import march_again
from pricing_core.obstacle.solve import GAIN

FAILURES = (PricingCoreError, ArithmeticError, np.linalg.LinAlgError)
# Factor of the error estimate of a local volatility, which is not smooth everywhere, and of an obstacle that moves;
# calibrated.
ROUGH_SHARE = 2.0
# Tolerance, in strikes, of a solve that boundaries are wanted of, over the square of their relative accuracy; chosen.
BOUNDARY_SHARE = 1e-2


@dataclass(frozen=True, slots=True)
class ObstacleMarch:
    """The engine for every contract: any events, any number of exercise boundaries, volatilities that are local."""

    @property
    def name(self) -> str:
        """What the engine is called."""
        return "obstacle march"

    @property
    def least_error(self) -> float:
        """1e-6 strikes: below that the prices of the faster engines are as accurate as those of this one."""
        return 1e-6

    def serves(self, book: Book) -> BoolVector:
        """Return True for every contract with time to expiry and a spot above 0."""
        return (book.expiry > 0.0) & (book.spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price one contract after the other; what fails numerically has the status "out_of_domain"."""
        least, most = range_of(book)
        found = []
        for row in range(book.count):
            if request.is_interrupted():
                found.append(prices(1, status="deadline", method="none"))
                continue
            rows = slice(row, row + 1)
            try:
                with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
                    found.append(
                        _priced(book.part(rows), request.take(rows), (least.item(row), most.item(row)))
                    )
            except FAILURES as error:
                found.append(prices(1, status="out_of_domain", method="none", message=str(error)))
        return concatenated(found)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return both boundaries from one solve, or two where they begin far from the strike."""
        schedule = replace(book.schedule(0), spot=book.strike.item(0))
        tolerance = BOUNDARY_SHARE * request.tolerance.item(0)
        nothing = np.full(times.size, math.nan)
        best = Ends(nothing, nothing, nothing)
        for place in first_places(schedule):
            if np.isnan(best.near).any():
                found = solve(contract_problem(schedule), place, tolerance, interrupt=request.interrupt)
                if found.status == "deadline":
                    raise NumericalError("the interrupt came before the boundary was found")
                best = best.completed_by(ends_at(schedule, found, times))
        at_expiry = times >= schedule.segments[-1].end
        last = schedule.segments[-1]
        if at_expiry.any() and not (last.due > 0.0 or last.fraction > 0.0):
            near, far = region_at_expiry(schedule).boundaries(schedule)
            best.near[at_expiry], best.far[at_expiry], best.error[at_expiry] = near, far, 0.0
        return Boundaries(best.near, best.far, best.error, np.ones(times.size, dtype=bool))


def _priced(book: Book, request: Request, within: tuple[float, float]) -> Prices:
    """Price a book of one contract, `within` its bounds of no arbitrage."""
    local = book.is_local().item(0)
    share = ROUGH_SHARE if local or book.escrow_now().item(0) > 0.0 else 1.0
    greeks, extended = request.greeks != "none", request.greeks == "extended"
    book = _cut(book, extended=extended) if greeks else book
    schedule = book.schedule(0)
    problem = contract_problem(
        schedule, _dividends(book) if greeks else (), cut=greeks and extended and _has_curves(book)
    )
    place, strike = place_of(schedule), schedule.strike
    found = solve(problem, place, request.tolerance.item(0) / share, interrupt=request.interrupt)
    european = _european(book, schedule, problem, found, request)
    if found.march is None or found.coarse is None or math.isnan(found.value):
        status = "deadline" if found.status == "deadline" else "out_of_domain"
        return prices(
            1, european=european, status=status, method="none", message="no grid resolves the contract"
        )
    exercised = bool(found.march.now.side(np.array([place]))[0] > 0)
    columns: dict[str, Any] = by_place_and_time(book, schedule, found, extended=extended)
    complete, late = True, found.status == "deadline"
    if greeks:
        derivatives = (
            None if late else by_parameters(book, schedule, problem, found, request, held=not exercised)
        )
        complete = derivatives is not None
        late = late or (not complete and request.is_interrupted())
        columns |= derivatives or {}
    message = ""
    if local and schedule.local is not None:
        surface, expiry = schedule.local.volatility, book.expiry.item(0)
        message = surface.extrapolated(book.spot.item(0), strike, expiry)
    return priced(
        book,
        message=message,
        value=np.clip(np.array([strike * found.value]), *within),
        european=np.array([european]),
        error=np.array([strike * share * found.error_estimate]),
        boundary=np.array([boundary_now(schedule, found, request)]),
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
    """Return a book of one contract with segments that end at every dividend and every curve's time that is listed."""
    listed = book.listed
    lists = [listed.cash_dividends]
    if extended:
        lists += [listed.rate, listed.dividend_yield, listed.volatility]
    if not any(column.values.size for column in lists):
        return book
    times = np.unique(np.concatenate([column.values for column in lists]))
    return with_cuts(book, type(listed.rate).of([times.tolist()]))


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


def _european(
    book: Book, schedule: Schedule, problem: ObstacleProblem, found: ObstacleSolution, request: Request
) -> float:
    """Return the price without early exercise, money: by the formula, or from the same grids; NaN where neither."""
    if book.local is None and not (book.drops() != 0.0).any():
        return float(european_columns(book, "none")["value"][0])
    if found.march is None or found.coarse is None:
        return math.nan
    if problem.lower is None:
        return schedule.strike * float(found.value)
    if request.is_interrupted():
        return math.nan
    held, place = replace(problem, lower=None), np.array([place_of(schedule)])
    fine, coarse = (march_again(held, own).now(place)[0] for own in (found.march, found.coarse))
    return schedule.strike * max(float(fine + (fine - coarse) / (GAIN - 1.0)), 0.0)
