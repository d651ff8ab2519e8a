"""From a tolerance to a price: refine, extrapolate, estimate the error, stop when it is small enough.

Value and derivatives at the spot have errors that fall like c (dx**2 + dtau**2), so (4 b - a)/3 from two
resolutions, each cell and step of a halved in b, removes the leading term (Richardson). What remains is
irregular (the exercise boundary moves through the cells), so the error of the last extrapolant is judged by
how far it moved from the one before and from the plain value: max(|e2 - e1|, |e2 - c|/8).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.closed_form import LARGEST_EXPONENT
from pricing_core.american.flat.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.flat.grid import Domain, exercise_domain
from pricing_core.american.flat.resolution import Resolution, Scheme, Solution, align, solve_at
from pricing_core.american.flat.spot_values import region_of, values_at
from pricing_core.american.flat.tridiagonal_step import LCPMethod
from pricing_core.arrays import Matrix

FINEST_INTERVALS = 768  # about 0.1 s; twice as many below the default tolerance
TIGHT_TOLERANCE = 1e-6
TRUNCATION_SHARE = 0.01  # of the tolerance, for cutting off the domain
MOST_STEPS = 800
WIDENINGS = 8
COARSEST_INTERVALS, COARSEST_STEPS = 48, 12
STRETCHED_FROM = 0.5  # volatility * sqrt(expiry)
LEAST_SOLVES = 3  # two may agree by chance
ERROR_SHARE = 1.5  # of the distance of two solves a factor of two apart: 1/3 or 4/3 at order 2, 1 or 2 at 1
ROUNDING = 1e-14  # of the strike (or the spot where that is larger)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The option at the spot, in units of the strike, with an error estimate.

    Parameters
    ----------
    values : Matrix, shape (m, 3)
        Row 0: v, v_x, v_xx; rows 1-3, where present, begin with dv/dsigma, dv/dr, dv/dq.
    error : float
        Fraction of the strike.
    region : ExerciseRegion
        Now, from the finest solve.
    solution : Solution
        The finest solve.
    exercised : bool
        Whether the spot lies in that region.
    solves : int
    interrupted : bool
    """

    values: Matrix
    error: float
    region: ExerciseRegion
    exercised: bool
    solution: Solution
    solves: int
    interrupted: bool


@dataclass(frozen=True, slots=True)
class Solver:
    """One option's solves at different resolutions, all on the same domain."""

    option: Option
    market: FlatMarket
    domain: Domain
    x: float
    lcp_method: LCPMethod
    tangents: bool
    interrupt: Callable[[], bool] | None

    def solve(self, resolution: Resolution) -> "Level | None":
        """Return the solve at this resolution, None where it was interrupted."""
        solution = solve_at(
            self.option,
            self.market,
            self.domain,
            resolution,
            lcp_method=self.lcp_method,
            tangents=self.tangents and resolution.formulation == "premium",
            interrupt=self.interrupt,
        )
        if not solution.finished:
            return None
        region = region_of(solution)
        return Level(solution, region, values_at(solution, region, self.x), region.contains(self.x))

    def noise(self, level: "Level") -> float:
        """Return what no refinement removes: truncation, residual, rounding; fraction of the strike."""
        rounding = 0.0 if level.exercised else ROUNDING * max(1.0, math.exp(min(self.x, LARGEST_EXPONENT)))
        residual = max(state.residual for state in level.solution.integration.states)
        return self.domain.neglected + residual + rounding


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """What one solve says at the spot."""

    solution: Solution
    region: ExerciseRegion
    values: Matrix
    exercised: bool


def make_solver(
    option: Option,
    market: FlatMarket,
    tolerance: float,
    coarsest: Resolution,
    *,
    lcp_method: LCPMethod = "tridiagonal",
    tangents: bool = False,
    interrupt: Callable[[], bool] | None = None,
) -> Solver:
    """Choose the domain and return the solver."""
    domain = settled_domain(option, market, tolerance, coarsest, interrupt)
    x = math.log(market.spot) - math.log(option.strike)
    return Solver(option, market, domain, x, lcp_method, tangents, interrupt)


def estimate_to_tolerance(solver: Solver, tolerance: float, coarsest: Resolution) -> Estimate | None:
    """Refine from `coarsest` until the estimated error meets the tolerance, or to the finest resolution.

    Parameters
    ----------
    tolerance : float
        Fraction of the strike.

    Returns
    -------
    Estimate, or None where the interrupt came before two resolutions were solved.
    """
    best: Estimate | None = None
    coarse = solver.solve(coarsest)
    resolution, extrapolated, solves = coarsest, None, 1
    finest = FINEST_INTERVALS if tolerance >= TIGHT_TOLERANCE else 2 * FINEST_INTERVALS
    while coarse is not None and resolution.intervals < finest and resolution.steps < MOST_STEPS:
        resolution = resolution.refined()
        fine = solver.solve(resolution)
        if fine is None:
            return None if best is None else replace(best, interrupted=True)
        solves += 1
        values, error = _extrapolate(coarse, fine, extrapolated)
        error += solver.noise(fine)
        best = Estimate(values, error, fine.region, fine.exercised, fine.solution, solves, False)
        if error <= tolerance and solves >= LEAST_SOLVES:
            break
        coarse, extrapolated = fine, values
    return best


def _extrapolate(coarse: Level, fine: Level, before: Matrix | None) -> tuple[Matrix, float]:
    """Return the extrapolant of two levels and its error; `before` is that of the two levels before."""
    if fine.solution.form.operators.fitted:  # first order
        return fine.values, 2.0 * _distance(fine.values, coarse.values)
    values = (4.0 * fine.values - coarse.values) / 3.0
    error = _distance(values, fine.values)
    if before is None:
        return values, error
    return values, max(_distance(values, before), error / 8.0)


def _distance(values: Matrix, others: Matrix) -> float:
    return float(abs(values[0, 0] - others[0, 0]))


def estimate_at_resolution(solver: Solver, resolution: Resolution) -> Estimate | None:
    """Solve at `resolution`, not extrapolated; a second solve gives the error.

    The second has half the cells and steps, or twice as many where those are too few to be halved.
    """
    second = resolution.coarsened()
    level, other = solver.solve(resolution), solver.solve(resolution.refined() if second is None else second)
    if level is None or other is None:
        return None
    error = ERROR_SHARE * _distance(level.values, other.values) + solver.noise(level)
    return Estimate(level.values, error, level.region, level.exercised, level.solution, 2, False)


def region_near_strike(
    option: Option,
    market: FlatMarket,
    tolerance: float,
    resolution: Resolution,
    interrupt: Callable[[], bool] | None,
) -> ExerciseRegion:
    """Return the exercise region now as seen from a spot at the strike; empty where interrupted."""
    at_strike = replace(market, spot=option.strike)
    solver = make_solver(option, at_strike, tolerance, resolution, interrupt=interrupt)
    level = solver.solve(resolution)
    return EMPTY_REGION if level is None else level.region


def coarsest_resolution(option: Option, market: FlatMarket, scheme: Scheme) -> Resolution:
    """Return the first of the doubling resolutions.

    With a negative rate the value grows on its way from expiry: 1 + h r, the row sum of the stage's matrix,
    must stay positive, and the longest stage is 0.6 T/M. A wide distribution needs a wide grid, but the payoff
    keeps its scale of 1 in ln(S/K): there the grid is stretched.
    """
    steps = max(COARSEST_STEPS, math.ceil(option.expiry * max(-market.rate, 0.0)))
    spread = market.volatility * math.sqrt(option.expiry)
    stretching = math.log1p(spread / STRETCHED_FROM) if spread > STRETCHED_FROM else 0.0
    return Resolution(COARSEST_INTERVALS, steps, scheme=scheme, stretching=stretching)


def settled_domain(
    option: Option,
    market: FlatMarket,
    tolerance: float,
    coarsest: Resolution,
    interrupt: Callable[[], bool] | None,
) -> Domain:
    """Return a domain that a cheap solve shows to reach into the exercise region at all times."""
    truncation = min(TRUNCATION_SHARE * tolerance, 1e-6)
    probe = replace(coarsest, intervals=64, formulation="premium", scheme="sdirk2", time_mesh="square-root")
    widening = 1.0
    for _ in range(WIDENINGS):
        domain = exercise_domain(option, market, truncation, widening)
        if not (domain.contact_at_left or domain.contact_at_right):
            break
        solution = solve_at(option, market, domain, probe, interrupt=interrupt)
        end = 0 if domain.contact_at_left else -1
        if all(state.contact[end] for state in solution.integration.states[1:]):
            break
        widening *= 1.5
    return align(domain, coarsest.intervals, coarsest.stretching)
