"""The engine of the method of lines: every contract, many at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, concatenated, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.engines.differences import STICKY, Bump, plan_differences, unchanged
from pricing_core.american.engines.engine import Boundaries, Engine, Request
from pricing_core.american.engines.held import charm_weights, priced
from pricing_core.american.engines.method_of_lines.joint_work import Work, done_together
from pricing_core.american.engines.method_of_lines.known import known_of
from pricing_core.american.engines.method_of_lines.level import ScheduleSolver, make_solver
from pricing_core.american.engines.method_of_lines.refinement import (
    Estimate,
    boundaries,
    estimating,
    levels_on_same_grids,
    limit_of,
    value_on_same_grids,
)
from pricing_core.american.engines.method_of_lines.sharing import solve_shared
from pricing_core.american.engines.method_of_lines.stage import LCPMethod
from pricing_core.american.engines.method_of_lines.sweep import FAILURES
from pricing_core.american.engines.method_of_lines.sweep_problem import SharedSweeps
from pricing_core.american.engines.method_of_lines.tangents import directions_of, moved
from pricing_core.american.engines.price_bounds import range_of
from pricing_core.arrays import BoolVector, Vector

# Number of contracts whose solves are done together, which fills the kernel's lanes; chosen: a deadline may lose all.
TOGETHER = 128
# Number of derivatives above which the price is found without them first: a deadline may come before theirs; chosen.
MANY_DIRECTIONS = 32
VOLGA_STEP = 0.04  # Step of the volatility for volga, as a share of the largest one; calibrated.
SURFACE_DIFFERENCE = 1e-3  # How far a surface is moved in ln S for a difference of prices; chosen.


@dataclass(frozen=True, slots=True)
class MethodOfLines:
    """The engine for every contract: any events, any number of exercise boundaries.

    Parameters
    ----------
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}
        The one-step method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each stage's complementarity problem.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps, once, without extrapolation; the error is estimated from a second
        solve with half as many of each.
    control : Engine, optional
        Prices the European options that have no formula, so that the error which the grid makes in them is taken out.
        Without one, what is found does not depend on another engine's treatment of events.
    """

    scheme: Scheme = "sdirk2"
    lcp_method: LCPMethod = "tridiagonal"
    resolution: Resolution | None = None
    control: Engine | None = None

    @property
    def name(self) -> str:
        """What the engine is called."""
        return "method of lines"

    @property
    def least_error(self) -> float:
        """1e-6 strikes: below that the prices of the faster engines are as accurate as those of this one."""
        return 1e-6

    def serves(self, book: Book) -> BoolVector:
        """Return True for every contract with time to expiry and a spot above 0."""
        return (book.expiry > 0.0) & (book.spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price some contracts at a time; what fails numerically has the status "out_of_domain"."""
        if request.share_solves and book.count > 1:
            return solve_shared(book, request, self._solve)
        return self._solve(book, request, None)

    def _solve(self, book: Book, request: Request, shared: SharedSweeps | None) -> Prices:
        least, most = range_of(book)
        ranges = [*zip(least.tolist(), most.tolist(), strict=True)]
        found: list[Prices] = []
        for first in range(0, book.count, TOGETHER):
            rows = range(first, min(first + TOGETHER, book.count))
            works = [self._row(book, request, row, ranges[row], shared) for row in rows]
            found += done_together(works, request.interrupt)
        return concatenated(found)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return both boundaries from one solve, without an error estimate."""
        schedule = replace(book.schedule(0), spot=book.strike.item(0))
        ends = boundaries(schedule, times, request.tolerance.item(0), request.interrupt)
        found = np.ones(times.size, dtype=bool)
        return Boundaries(ends[:, 0], ends[:, 1], np.full(times.size, math.nan), found)

    def _row(
        self,
        book: Book,
        request: Request,
        row: int,
        within: tuple[float, float],
        shared: SharedSweeps | None,
    ) -> Work[Prices]:
        if request.is_interrupted():
            return prices(1, status="deadline", method="none")
        rows = slice(row, row + 1)
        try:
            return (yield from self._priced(book.part(rows), request.take(rows), within, shared))
        except FAILURES as error:
            return prices(1, status="out_of_domain", method="none", message=str(error))

    def _priced(
        self, book: Book, request: Request, within: tuple[float, float], shared: SharedSweeps | None
    ) -> Work[Prices]:
        """Price a book of one contract, `within` its bounds of no arbitrage."""
        extended, tolerance = request.greeks == "extended", request.tolerance.item(0)
        solver = make_solver(book.schedule(0), tolerance, self.lcp_method, request.interrupt, shared)
        if request.greeks != "none":
            solver = replace(solver, directions=directions_of(book, extended=extended))
        price_alone: Estimate | None = None
        if len(solver.directions) > MANY_DIRECTIONS:
            price_alone = yield from self._estimating(book, replace(solver, directions=()), request)
        estimate = yield from self._estimating(book, solver, request)
        if not estimate.levels and price_alone is not None:
            estimate = replace(price_alone, interrupted=True)
        if not estimate.levels:
            known = None if book.local is not None else known_of(book, (), request, None)
            european = math.nan if known is None else book.strike.item(0) * known.values[0, 0]
            return prices(1, european=european, status="deadline", method="none")
        finest = estimate.levels[-1]
        columns: dict[str, Any] = {"complete": True}
        if request.greeks != "none" and not estimate.interrupted:
            columns = _derivatives(book, solver, estimate, request, self.control)
        late = estimate.interrupted or (not columns["complete"] and request.is_interrupted())
        strike, value, errors = book.strike, estimate.american[0], estimate.errors[0]
        if extended:
            columns |= _charm(book, value, errors)
        message = ""
        if solver.schedule.local is not None:
            surface, expiry = solver.schedule.local.volatility, book.expiry.item(0)
            message = surface.extrapolated(book.spot.item(0), strike.item(0), expiry)
        return priced(
            book,
            message=message,
            value=np.clip(strike * value[0], *within),
            european=np.clip(strike * estimate.european[0, 0], 0.0, within[1]),
            error=strike * errors[0],
            delta=value[1:2],
            gamma=value[2:3] / strike,
            delta_error=errors[1:2],
            gamma_error=errors[2:3] / strike,
            boundary=np.array([estimate.region.boundaries(solver.schedule)[0]]),
            exercised=np.array([finest.exercised]),
            settled=not late,
            status="deadline" if late else "ok",
            method=finest.resolution.scheme,
            solves=np.array([estimate.solves]),
            steps=np.array([finest.steps]),
            residual=np.array([finest.residual]),
            fitted=np.array([finest.fitted]),
            resolution=np.array([finest.resolution], dtype=object),
            **columns,
        )

    def _estimating(self, book: Book, solver: ScheduleSolver, request: Request) -> Work[Estimate]:
        return estimating(
            solver,
            request.tolerance.item(0),
            scheme=self.scheme,
            resolution=self.resolution,
            exact=known_of(book, solver.directions, request, self.control),
        )


def _derivatives(
    book: Book, solver: ScheduleSolver, estimate: Estimate, request: Request, control: Engine | None
) -> dict[str, Any]:
    """Return the derivatives by the parameters as columns, and whether all are there."""
    extended = request.greeks == "extended"
    if estimate.levels[-1].exercised:
        columns = unchanged(book, extended=extended) | {"complete": True}
        return columns if book.local is None else columns | {STICKY: -book.sign}
    if len(estimate.american) == 1 + len(solver.directions) > 1:
        return _carried(book, solver, estimate, request, control)
    plan = plan_differences(book, extended=extended)
    bumped, strike = plan.book, book.strike.item(0)
    value, delta = np.full((2, bumped.count), math.nan)
    for row in range(bumped.count):
        schedule = bumped.schedule(row)
        if schedule.spot <= 0.0:
            continue  # the bump makes escrowed dividends worth more than the spot
        try:
            v, slope = value_on_same_grids(estimate, replace(solver, schedule=schedule, directions=()))
        except FAILURES:
            continue  # the grids of the contract itself do not do for it
        if math.isnan(v):
            break
        value[row], delta[row] = strike * v, slope
    columns = plan.columns(value, delta) | {"complete": not bool(np.isnan(value).any())}
    schedule = solver.schedule
    if schedule.local is None or not columns["complete"]:
        return columns
    surfaces = (moved(schedule.local, by) for by in (SURFACE_DIFFERENCE, -SURFACE_DIFFERENCE))
    sides = [
        value_on_same_grids(
            estimate, replace(solver, schedule=replace(schedule, local=surface), directions=())
        )[0]
        for surface in surfaces
    ]
    by_surface = (sides[0] - sides[1]) / (2.0 * SURFACE_DIFFERENCE)
    columns |= _sticky(book, estimate.american[0, 1], math.nan, by_surface, math.nan)
    return columns | {"complete": not math.isnan(by_surface)}


def _carried(
    book: Book, solver: ScheduleSolver, estimate: Estimate, request: Request, control: Engine | None
) -> dict[str, Any]:
    """Return the derivatives that the march carried along as columns, with their errors."""
    extended, strike = request.greeks == "extended", book.strike.item(0)
    columns = unchanged(book, extended=extended)
    columns |= {
        error_of(name): Ragged(column.first, column.values.copy())
        if isinstance(column, Ragged)
        else column.copy()
        for name, column in columns.items()
    }
    found = zip(solver.directions, estimate.american[1:], estimate.errors[1:], strict=True)
    for direction, value, error in found:
        if direction.kind == STICKY:
            columns |= _sticky(book, estimate.american[0, 1], estimate.errors[0, 1], value[0], error[0])
            continue
        for name, number in ((direction.kind, value[0]), (error_of(direction.kind), error[0])):
            column = columns[name]
            (column.values if isinstance(column, Ragged) else column)[direction.entry] = strike * number
    if not extended:
        return columns | {"complete": True}
    vega = next(n for n, direction in enumerate(solver.directions) if direction.kind == "vega")
    columns["vanna"], columns["vanna_error"] = (
        estimate.american[[1 + vega], 1],
        estimate.errors[[1 + vega], 1],
    )
    volga = _volga(book, solver, estimate, request, control)
    complete = volga is not None
    columns["volga"], columns["volga_error"] = np.full((2, 1), math.nan) if volga is None else volga
    return columns | {"complete": complete}


def _sticky(book: Book, delta: float, delta_error: float, by_surface: float, error: float) -> dict[str, Any]:
    """Return the delta of a surface that moves with the spot as columns.

    Parameters
    ----------
    by_surface, error : float
        dV/dm in units of the strike, the surface moved by m in ln S, and its error.
    """
    share = book.strike / book.spot
    return {STICKY: delta + share * by_surface, error_of(STICKY): delta_error + share * error}


def _volga(
    book: Book, solver: ScheduleSolver, estimate: Estimate, request: Request, control: Engine | None
) -> tuple[Vector, Vector] | None:
    """Return volga and its error from vegas at two volatilities, each with its own contact sets."""
    step = VOLGA_STEP * float(np.max(book.segments.volatility))
    request = replace(request, greeks="standard")
    levels, known = [], []
    for shift in (step, -step):
        bumped = Bump(book, "volatility")(np.array([shift]))
        parameter = directions_of(bumped, extended=False, only="vega")
        again = replace(solver, schedule=bumped.schedule(0), directions=parameter)
        found = levels_on_same_grids(estimate, again)
        if found is None or any(len(level.american) == 1 for level in found):
            return None
        levels.append(found)
        exact = known_of(bumped, parameter, request, control)
        if exact is not None and not math.isnan(exact.values[1, 0]):
            known.append(exact)
    premium = len(known) == len(levels)
    differences = [
        np.array(
            [up.american[1, 0] - down.american[1, 0] - premium * (up.european[1, 0] - down.european[1, 0])]
        )
        for up, down in zip(*levels, strict=True)
    ]
    scale = book.strike / (2.0 * step)
    if len(differences) == 1:
        return scale * differences[0], np.full(1, math.nan)
    volga, error = limit_of(differences, first_order=estimate.levels[-1].fitted)
    if premium:
        volga = volga + known[0].values[1, 0] - known[1].values[1, 0]
        error = error + known[0].errors[1, 0] + known[1].errors[1, 0]
    # What the step leaves out is of the size of its square times the derivatives that the vegas show.
    at_once = [found[-1].american[1, 0] for found in levels]
    vega = next(n for n, direction in enumerate(solver.directions) if direction.kind == "vega")
    bend = abs(sum(at_once) - 2.0 * estimate.levels[-1].american[1 + vega, 0]) * 2.0 / VOLGA_STEP
    return scale * volga, scale * (error + VOLGA_STEP**2 * (np.abs(volga) + bend))


def _charm(book: Book, value: Vector, errors: Vector) -> dict[str, Any]:
    """Return d delta/dt and its error, where the contract is held, as columns."""
    by_strike = [weight / book.strike**power for power, weight in enumerate(charm_weights(book))]
    terms = [*zip(by_strike, value[1:], errors[1:], strict=True)]
    return {
        "charm": sum(weight * number for weight, number, _ in terms),
        "charm_error": sum(np.abs(weight) * error for weight, _, error in terms),
    }
