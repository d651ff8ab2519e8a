"""The chapter's road: one contract as the linear complementarity system (11.63), stepped implicitly, (11.65).

`nodal_run.py` steps it at one resolution; here it is repeated, the error is told by the solve with half as many cells
and steps, and Greeks by parameters are differences of bumped contracts. The nodal condition keeps the second order at
best, with a factor that depends on where in its cell the boundary lies, so that nothing is extrapolated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, error_of, prices
from pricing_core.american.book.resolution import MOST, LCPMethod, Resolution, Scheme
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.differences import STICKY, plan_differences, unchanged
from pricing_core.american.engines.engine import INTERRUPTED, Boundaries, BoundariesAt, Request
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.nodal_run import NodalRun, nodal_grid, nodal_run
from pricing_core.american.engines.obstacle_march.boundaries import Ends, quoted
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.american.engines.obstacle_march.pricing import one_by_one
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError
from pricing_core.obstacle.as_lcs import NodalSolver

# The first is policy iteration as well: its linear systems are tridiagonal, and solved by elimination.
SOLVERS: dict[LCPMethod, NodalSolver] = {
    "tridiagonal": "policy",
    "policy": "policy",
    "psor": "psor",
    "lemke": "lemke",
}
FIRST, DOUBLINGS = Resolution(128, 32), 5  # The first resolution and how often it is doubled at most; chosen.
# Error of a solve over its distance to one with half the cells and steps: 4/3 at order 2, 2 at 1.
ERROR_SHARE = 1.5
SURFACE_STEP = 1e-3  # How far a surface is moved in ln S for a difference of prices; chosen.


@dataclass(frozen=True, slots=True)
class Chapter:
    """The engine of `method="lcs"` and "crank-nicolson": one contract after the other.

    Parameters
    ----------
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}
        The one-step method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each stage's complementarity problem.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps; the error is estimated from a second solve with half as many of
        each. Without it both are doubled until the estimate meets the tolerance.
    """

    scheme: Scheme = "sdirk2"
    lcp_method: LCPMethod = "tridiagonal"
    resolution: Resolution | None = None

    @property
    def name(self) -> str:
        """What the engine is called."""
        return self.method

    @property
    def method(self) -> str:
        """What results say of it."""
        return "crank-nicolson" if self._scheme == "crank-nicolson" else "lcs"

    @property
    def least_error(self) -> float:
        """0: it is asked for by name."""
        return 0.0

    @property
    def _scheme(self) -> Scheme:
        return self.scheme if self.resolution is None else self.resolution.scheme or self.scheme

    def serves(self, book: Book) -> BoolVector:
        """Return True for every contract with time to expiry and a spot above 0."""
        return (book.expiry > 0.0) & (book.spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price one contract after the other; what fails numerically has the status "out_of_domain"."""
        return one_by_one(book, request, self._priced)

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return both boundaries from two solves, of which the second tells the error."""
        return lambda times: self._boundary(book, times, request)

    def _boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        book = book.diffusing_at(book.strike)
        fine = self.resolution or replace(FIRST.refined().refined(), scheme=self._scheme)
        ends = []
        for resolution in (fine, fine.coarsened() or fine.refined()):
            run = self._run(book, resolution, request, times=times)
            if run is None:
                raise NumericalError(INTERRUPTED)
            ends.append(
                np.array([_money(book, t, run.ends.get(t, (math.nan, math.nan))) for t in times.tolist()])
            )
        (near, far), (other, _) = (each.T for each in ends)
        found = Ends(near, far, ERROR_SHARE * np.abs(near - other)).with_limit(book, times)
        return Boundaries(found.near, found.far, found.error, np.ones(times.size, dtype=bool))

    def _run(
        self, book: Book, resolution: Resolution, request: Request, times: Vector | None = None
    ) -> NodalRun | None:
        problem, place = contract_problem(book), place_of(book)
        grid = nodal_grid(problem, place, resolution)
        solver = SOLVERS[self.lcp_method]
        stops = () if times is None else tuple(times.tolist())
        return nodal_run(
            problem,
            grid,
            resolution,
            self._scheme,
            solver,
            is_put=book.is_put.item(),
            times=stops,
            interrupt=request.interrupt,
        )

    def _priced(self, book: Book, request: Request, within: tuple[float, float]) -> Prices:
        runs: list[NodalRun] = []
        resolution = self.resolution or replace(FIRST, scheme=self._scheme)
        tolerance, error = request.tolerance.item(0), math.inf
        place = np.array([place_of(book)])
        while True:
            found = self._run(book, resolution, request)
            if found is None:
                break
            runs.append(found)
            if len(runs) > 1:
                error = ERROR_SHARE * abs(float(runs[-1].now(place)[0] - runs[-2].now(place)[0]))
            if self.resolution is not None or (len(runs) > 2 and error <= tolerance):
                break
            if len(runs) > DOUBLINGS or 2 * max(resolution.intervals, resolution.steps) > MOST:
                break
            resolution = resolution.refined()
        fine, coarse = (runs[-1], runs[-2]) if len(runs) > 1 else (runs[0] if runs else None, None)
        if fine is not None and self.resolution is not None:
            coarse = self._run(book, resolution.coarsened() or resolution.refined(), request)
        if fine is None or coarse is None:
            return prices(1, status="deadline", method="none")
        return self._answer(book, fine, coarse, request, within, solves=len(runs) + (len(runs) == 1))

    def _answer(
        self,
        book: Book,
        fine: NodalRun,
        coarse: NodalRun,
        request: Request,
        within: tuple[float, float],
        solves: int,
    ) -> Prices:
        place, strike, s = np.array([place_of(book)]), book.strike, math.exp(place_of(book))
        own, other = (run.now.derivatives(place)[:, 0] for run in (fine, coarse))
        differences = ERROR_SHARE * np.abs(own - other)
        ends = np.array([_money(book, 0.0, run.ends[0.0])[0] for run in (fine, coarse)])
        exercised = bool(fine.now.side(place)[0] > 0)
        columns: dict[str, Any] = {"complete": True}
        if request.greeks != "none":
            columns = self._derivatives(book, fine, request, held=not exercised)
        european = self._european(book, fine, request)
        late = not columns["complete"] and request.is_interrupted()
        return priced(
            book,
            value=np.clip(strike * own[0], *within),
            european=np.array([european]),
            error=strike * differences[0],
            delta=own[1:2] / s,
            gamma=(own[2:3] - own[1:2]) / s**2 / strike,
            delta_error=differences[1:2] / s,
            gamma_error=(differences[2:3] + differences[1:2]) / s**2 / strike,
            boundary=ends[:1],
            boundary_error=ERROR_SHARE * np.abs(ends[:1] - ends[1:]),
            exercised=np.array([exercised]),
            settled=not late,
            status="deadline" if late else "ok",
            method=self.name,
            solves=np.array([solves]),
            steps=np.array([fine.steps]),
            residual=np.array([fine.residual]),
            fitted=np.array([fine.fitted]),
            resolution=np.array([replace(fine.resolution, scheme=self._scheme)], dtype=object),
            **columns,
        )

    def _again(self, book: Book, like: NodalRun, request: Request, *, held: bool = False) -> NodalRun | None:
        """Return a run of a contract that differs little on the same grid and in the same steps."""
        problem = contract_problem(book)
        if held:
            problem = replace(problem, lower=None)
        solver = SOLVERS[self.lcp_method]
        return nodal_run(
            problem,
            like.now.grid,
            like.resolution,
            self._scheme,
            solver,
            is_put=book.is_put.item(),
            interrupt=request.interrupt,
        )

    def _european(self, book: Book, fine: NodalRun, request: Request) -> float:
        if book.local is None and not (book.drops() != 0.0).any():
            return float(european_columns(book, "none")["value"][0])
        found = self._again(book, fine, request, held=True)
        if found is None:
            return math.nan
        return book.strike.item() * max(float(found.now(np.array([place_of(book)]))[0]), 0.0)

    def _derivatives(self, book: Book, fine: NodalRun, request: Request, *, held: bool) -> dict[str, Any]:
        """Return the derivatives by the parameters: differences of the prices of bumped contracts."""
        extended, local = request.greeks == "extended", book.local_terms()
        if not held:
            columns = unchanged(book, extended=extended) | {"complete": True}
            return columns if local is None else columns | {STICKY: -book.sign}
        plan = plan_differences(book, extended=extended)
        value, delta = np.full((2, plan.book.count), math.nan)
        for row in range(plan.book.count):
            bumped = plan.book.part(slice(row, row + 1))
            if bumped.diffusing().item() <= 0.0:
                continue
            found = self._again(bumped, fine, request)
            if found is None:
                break
            x = place_of(bumped)
            at = found.now.derivatives(np.array([x]))[:, 0]
            value[row], delta[row] = bumped.strike.item() * at[0], at[1] / math.exp(x)
        columns = plan.columns(value, delta) | {"complete": not bool(np.isnan(value).any())}
        if local is None or not columns["complete"]:
            return columns
        place, sides = np.array([place_of(book)]), []
        for by in (SURFACE_STEP, -SURFACE_STEP):
            found = self._again(book.with_surfaces_moved(by), fine, request)
            sides.append(math.nan if found is None else float(found.now(place)[0]))
        by_surface = (sides[0] - sides[1]) / (2.0 * SURFACE_STEP)
        own = float(fine.now.derivatives(place)[1, 0]) / math.exp(float(place[0]))
        columns |= {
            STICKY: own + book.strike / book.spot * by_surface,
            error_of(STICKY): np.full(1, math.nan),
        }
        return columns | {"complete": not math.isnan(by_surface)}


def _money(book: Book, t: float, places: tuple[float, float]) -> tuple[float, float]:
    """Return the quoted spots at places; NaN where there is none."""
    segments = book.segments_of()
    segment = next((s for s in segments if t <= s.end), segments[-1])
    near, far = quoted(book.strike.item(), segment, t, np.array(places)).tolist()
    return near, far
