"""Books by the march of obstacle problems, one contract at a time.

`contract_problem.py` states a contract as a problem of `pricing_core.obstacle`, `greeks.py` takes its derivatives and
`boundaries.py` its exercise boundaries.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import Prices, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.obstacle_march.boundaries import (
    Ends,
    Traces,
    boundary_now,
    coefficient_jumps,
    far_place,
    first_places,
)
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.american.engines.obstacle_march.greeks import by_parameters, by_place_and_time
from pricing_core.american.engines.price_bounds import range_of
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError, PricingCoreError
from pricing_core.obstacle import Obstacle, ObstacleProblem, ObstacleSolution, solve
from pricing_core.obstacle.solution import march_again
from pricing_core.obstacle.solve import GAIN

FAILURES = (PricingCoreError, ArithmeticError, np.linalg.LinAlgError)
# Factor of the error estimate of a local volatility, which is not smooth everywhere, and of an obstacle that moves;
# calibrated.
ROUGH_SHARE = 2.0
NEVER_MET = -1.0  # Value, in strikes, that no price falls to.
# Tolerance of a solve that boundaries are wanted of over what is asked of a price; chosen.
BOUNDARY_SHARE = 0.1


def solve_book(book: Book, request: Request) -> Prices:
    """Price one contract after the other; what fails numerically has the status "out_of_domain".

    With `share_solves` contracts that differ in the spot alone share one march, whose interval holds all spots.
    """
    least, most = range_of(book)
    rows = [[row] for row in range(book.count)]
    if request.share_solves and book.count > 1:
        rows = ladders(book, request)
    found = prices(book.count)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        for alike in rows:
            shared = _Shared.of(book, alike, request) if len(alike) > 1 else None
            for row in alike:
                own = _one(book, row, request, (least.item(row), most.item(row)), shared)
                found = own if book.count == 1 else found.replaced(np.array([row]), own)
    return found


@dataclass(slots=True, eq=False)
class BoundariesOf:
    """Both boundaries of one contract at any times, from one solve, or two where they begin far from the strike.

    The contract is solved where it is asked first, and only once.

    Parameters
    ----------
    book : Book
        A book of one contract.
    request : Request
    """

    book: Book
    request: Request
    _found: dict[float, Traces] = field(init=False, default_factory=dict)

    def __call__(self, times: Vector) -> Boundaries:
        """Return them at times, years from now, shape (m,)."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            return self._at(times)

    def _at(self, times: Vector) -> Boundaries:
        schedule = replace(self.book.schedule(0), spot=self.book.strike.item(0))
        nothing = np.full(times.size, math.nan)
        best = Ends(nothing, nothing, nothing)
        for place in first_places(schedule):
            if np.isnan(best.near).any():
                best = best.completed_by(self._traces(schedule, place).at(times))
        place = far_place(schedule)
        if not math.isnan(place) and np.isnan(best.far).any():
            best = best.completed_by(self._traces(schedule, place).at(times))
        at_expiry = times >= schedule.segments[-1].end
        last = schedule.segments[-1]
        if at_expiry.any() and not (last.due > 0.0 or last.fraction > 0.0):
            near, far = region_at_expiry(schedule).boundaries(schedule)
            best.near[at_expiry], best.far[at_expiry], best.error[at_expiry] = near, far, 0.0
        return Boundaries(best.near, best.far, best.error, np.ones(times.size, dtype=bool))

    def _traces(self, schedule: Schedule, place: float) -> Traces:
        """Return the boundaries of the solve around a place, which is solved once."""
        if place not in self._found:
            self._found[place] = self._solved(schedule, place)
        return self._found[place]

    def _solved(self, schedule: Schedule, place: float) -> Traces:
        there = replace(schedule, spot=schedule.strike * math.exp(place))
        problem = contract_problem(there, coefficient_jumps(schedule))
        tolerance = BOUNDARY_SHARE * self.request.tolerance.item(0)
        found = solve(problem, place, tolerance, interrupt=self.request.interrupt)
        if found.status == "deadline":
            raise NumericalError("the interrupt came before the boundary was found")
        return Traces.of(schedule, found)


@dataclass(frozen=True, slots=True, eq=False)
class _Shared:
    """One solution for the spots of several contracts; places (m,)."""

    places: Vector
    solution: ObstacleSolution

    @classmethod
    def of(cls, book: Book, rows: list[int], request: Request) -> _Shared | None:
        """Solve contracts that differ in the spot alone; None where that fails, and each is asked for by itself."""
        own = request.take(np.array(rows))
        part = _prepared(book.take(np.array(rows)), own)
        lowest = np.array([int(np.argmin(part.spot))])  # which has the widest interval
        problem, share = _problem(part.take(lowest), own)
        places = np.array([place_of(part.schedule(k)) for k in range(len(rows))])
        try:
            found = solve(problem, places, float(own.tolerance.min()) / share, interrupt=request.interrupt)
        except FAILURES:
            return None
        return cls(places, found)

    def at(self, place: float) -> ObstacleSolution:
        """Return the solution at one of the places."""
        k = int(np.argmin(np.abs(self.places - place)))
        whole = self.solution
        return replace(
            whole,
            at=place,
            value=float(whole.value[k]),
            error_estimate=float(whole.error_estimate[k]),
            slope=float(whole.slope[k]),
            curvature=float(whole.curvature[k]),
        )


def ladders(book: Book, request: Request) -> list[list[int]]:
    """Return the rows in groups that differ in the spot alone."""
    groups: dict[Hashable, list[int]] = {}
    for row in range(book.count):
        schedule = book.schedule(row)
        local, shift = schedule.local, 0.0
        if local is not None:  # whose reference depends on the spot
            shift = local.reference
        segments = tuple(replace(s, volatility=round(s.volatility - shift, 12)) for s in schedule.segments)
        listed = tuple(getattr(book.listed, name).row(row) for name in type(book.listed).__slots__)
        surface = None if local is None else local.volatility
        key = (schedule.is_put, schedule.strike, bool(book.escrowed[row]), segments, surface, listed)
        groups.setdefault((*key, request.tolerance.item(row)), []).append(row)
    return [*groups.values()]


def _one(
    book: Book, row: int, request: Request, within: tuple[float, float], shared: _Shared | None
) -> Prices:
    """Price one contract, whatever happens."""
    if request.is_interrupted():
        return prices(1, status="deadline", method="none")
    rows = slice(row, row + 1)
    try:
        return _priced(book.part(rows), request.take(rows), within, shared)
    except FAILURES as error:
        return prices(1, status="out_of_domain", method="none", message=str(error))


def _prepared(book: Book, request: Request) -> Book:
    """Return contracts with segments that end where their derivatives want it."""
    return book if request.greeks == "none" else _cut(book, extended=request.greeks == "extended")


def _problem(book: Book, request: Request) -> tuple[ObstacleProblem, float]:
    """Return the problem of a book of one contract, and the factor of its error estimate."""
    rough = book.is_local().item(0) or book.escrow_now().item(0) > 0.0
    greeks, extended = request.greeks != "none", request.greeks == "extended"
    cut = extended and _has_curves(book)
    problem = contract_problem(book.schedule(0), _dividends(book) if greeks else (), cut=cut)
    return problem, ROUGH_SHARE if rough else 1.0


def _priced(book: Book, request: Request, within: tuple[float, float], shared: _Shared | None) -> Prices:
    """Price a book of one contract, `within` its bounds of no arbitrage."""
    local = book.is_local().item(0)
    greeks, extended = request.greeks != "none", request.greeks == "extended"
    book = _prepared(book, request)
    schedule = book.schedule(0)
    problem, share = _problem(book, request)
    place, strike = place_of(schedule), schedule.strike
    if shared is None:
        found = solve(problem, place, request.tolerance.item(0) / share, interrupt=request.interrupt)
    else:
        found = shared.at(place)
        problem = found.problem
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
    # An obstacle that is never met keeps the segments, and with them the steps.
    own = problem.lower
    held = replace(problem, lower=Obstacle(NEVER_MET, during=own.during, at=own.at))
    place = np.array([place_of(schedule)])
    fine, coarse = (march_again(held, own).now(place)[0] for own in (found.march, found.coarse))
    return schedule.strike * max(float(fine + (fine - coarse) / (GAIN - 1.0)), 0.0)
