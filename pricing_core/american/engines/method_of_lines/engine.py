"""The engine of the method of lines: every contract, one at a time."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, concatenated, prices
from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.differences import plan_differences, unchanged
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.method_of_lines.level import ScheduleSolver, make_solver
from pricing_core.american.engines.method_of_lines.refinement import (
    Estimate,
    boundaries,
    estimate_to_tolerance,
    value_on_same_grids,
)
from pricing_core.american.engines.method_of_lines.stage import LCPMethod
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import PricingCoreError


@dataclass(frozen=True, slots=True)
class MethodOfLines:
    """Any events, any number of exercise boundaries.

    Parameters
    ----------
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}
        The one-step method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each stage's complementarity problem.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps, once, without extrapolation; the error is estimated from a second
        solve with half as many of each.
    """

    scheme: Scheme = "sdirk2"
    lcp_method: LCPMethod = "tridiagonal"
    resolution: Resolution | None = None

    @property
    def name(self) -> str:
        """What the engine is called."""
        return "method of lines"

    @property
    def least_error(self) -> float:
        """An error of 1e-6 strikes: below, the faster engines' prices are as good as this one's."""
        return 1e-6

    def serves(self, book: Book) -> BoolVector:
        """Serve every contract that has some life before it and a spot above 0."""
        return (book.expiry > 0.0) & (book.spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price one contract after the other; what fails numerically has the status "out_of_domain"."""
        return concatenated([self._row(book, request, row) for row in range(book.count)])

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return both boundaries from one solve, without an error estimate."""
        schedule = replace(book.schedule(0), spot=book.strike.item(0))
        ends = boundaries(schedule, times, request.tolerance.item(0), request.interrupt)
        found = np.ones(times.size, dtype=bool)
        return Boundaries(ends[:, 0], ends[:, 1], np.full(times.size, math.nan), found)

    def _row(self, book: Book, request: Request, row: int) -> Prices:
        if request.is_interrupted():
            return prices(1, status="deadline", method="none")
        try:
            return self._priced(book.part(slice(row, row + 1)), request.take(slice(row, row + 1)))
        except (PricingCoreError, ArithmeticError, np.linalg.LinAlgError) as error:
            return prices(1, status="out_of_domain", method="none", message=str(error))

    def _priced(self, book: Book, request: Request) -> Prices:
        """Price a book of one contract."""
        solver = make_solver(book.schedule(0), request.tolerance.item(0), self.lcp_method, request.interrupt)
        estimate = estimate_to_tolerance(
            solver,
            request.tolerance.item(0),
            scheme=self.scheme,
            resolution=self.resolution,
            exact=_exact_european(book),
        )
        if not estimate.levels:
            european = _exact_european(book)
            known = math.nan if european is None else book.strike.item(0) * european[0]
            return prices(1, european=known, status="deadline", method="none")
        finest = estimate.levels[-1]
        columns: dict[str, Any] = {"complete": True}
        if request.greeks != "none" and not estimate.interrupted:
            columns = _derivatives(book, solver, estimate, request)
        late = estimate.interrupted or (not columns["complete"] and request.is_interrupted())
        strike = book.strike
        return priced(
            book,
            value=strike * estimate.american[0],
            european=np.maximum(strike * estimate.european[0], 0.0),
            error=strike * estimate.error,
            delta=estimate.american[1:2],
            gamma=estimate.american[2:3] / strike,
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


def _derivatives(book: Book, solver: ScheduleSolver, estimate: Estimate, request: Request) -> dict[str, Any]:
    """Return the derivatives by the parameters as columns, and whether all are there."""
    extended = request.greeks == "extended"
    if estimate.levels[-1].exercised:
        return unchanged(book, extended=extended) | {"complete": True}
    plan = plan_differences(book, extended=extended)
    bumped, strike = plan.book, book.strike.item(0)
    value, delta = np.full((2, bumped.count), math.nan)
    for row in range(bumped.count):
        schedule = bumped.schedule(row)
        if schedule.spot <= 0.0:
            continue  # the bump makes escrowed dividends worth more than the spot
        try:
            v, slope = value_on_same_grids(estimate, replace(solver, schedule=schedule))
        except (PricingCoreError, ArithmeticError, np.linalg.LinAlgError):
            continue  # the grids of the contract itself do not do for it
        if math.isnan(v):
            break
        value[row], delta[row] = strike * v, slope
    return plan.columns(value, delta) | {"complete": not bool(np.isnan(value).any())}


def _exact_european(book: Book) -> Vector | None:
    """Return (v, v_s, v_ss) of the European option by the formula in units of the strike; None where it has none."""
    if (book.drops() > 0.0).any():
        return None
    found = european_columns(book, "none")
    strike = book.strike
    return np.concatenate([found["value"] / strike, found["delta"], found["gamma"] * strike])
