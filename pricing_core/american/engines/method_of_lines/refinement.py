"""From a tolerance to a price: refine, extrapolate, estimate the error, stop when it is small enough.

The values at the spot have errors that fall like c (ds**2 + dt**2), so that (4 b - a)/3 from two resolutions, each cell
and step of a halved in b, removes the leading term (Richardson). The European option is solved on the same grids. Where
its value is known without them, the error that the two solves share is taken out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pricing_core.american.book.resolution import MOST, Resolution, Scheme
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion, earning_region
from pricing_core.american.engines.method_of_lines.grid import even_stretching
from pricing_core.american.engines.method_of_lines.joint_work import Work, done
from pricing_core.american.engines.method_of_lines.known import Known
from pricing_core.american.engines.method_of_lines.level import (
    Level,
    ScheduleSolver,
    actual_region,
    coarsest_resolution,
    fewest,
    make_solver,
    solver_at_strike,
)
from pricing_core.american.engines.method_of_lines.limits import first_boundaries, region_before_expiry
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

# Largest number of doublings, ordinarily and below the tight tolerance; chosen.
DOUBLINGS, TIGHT_DOUBLINGS = 4, 5
TIGHT_TOLERANCE = 1e-6  # Tolerance, in strikes, below which there is one doubling more; chosen.
MOST_WORK = 4_000_000  # Cells times steps of the finest solve for which events count as few; chosen by time.
# Largest number of numbers that a solve may hold in memory, 100 MB: the next resolution takes up to four times as many
# as the one before; chosen.
MOST_STORED = 12_500_000
FEWEST_SOLVES = 3  # Smallest number of resolutions: two may agree by chance; chosen.
# Error of a solve over its distance to one with half the cells and steps: 4/3 at order 2, 2 at 1.
ERROR_SHARE = 1.5
# Share of the European value's error on the same grid that counts as error of a solve; calibrated.
EUROPEAN_SHARE = 0.5
# Share of the extrapolant's move before that counts as error of the extrapolant, for two may agree by chance, and share
# of the difference between the last two solves, which a region of exercise narrower than a few cells makes; calibrated.
CHANCE, STEP_SHARE = 1.0 / 4.0, 1.0 / 8.0
# The same of a local volatility, whose kinks lie anywhere in the cells; calibrated.
LOCAL_STEP_SHARE = 0.25
# Smallest width of a cell, as a share of the spot, in which a boundary is not looked for; chosen.
WIDE_CELL = 0.05
# Factor of the error estimates of derivatives by parameters, which converge less regularly; calibrated.
TANGENT_SHARE = 2.5
ROUNDING = 1e-13  # Rounding error of a value, in strikes, or in spots where that is more; measured.
REGION_DOUBLINGS = 2  # Number of doublings of the first resolution where the region alone is wanted; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A schedule's values at the spot now, in units of the strike, with an error estimate.

    Parameters
    ----------
    american, european : Matrix, shape (1 + P, 4)
        As in `Level`, with and without early exercise; NaN where the interrupt came before two solves.
    errors : Matrix, shape (1 + P, 4)
        Error estimates of `american`.
    region : ExerciseRegion
        Now, in ln(S/K) of the actual spot.
    levels : tuple of Level
        The last one, or up to four where the values are extrapolated from them.
    solves : int
        Resolutions solved.
    interrupted : bool
        The interrupt came before the error was small enough.
    """

    american: Matrix
    european: Matrix
    errors: Matrix
    region: ExerciseRegion
    levels: tuple[Level, ...]
    solves: int
    interrupted: bool

    @property
    def error(self) -> float:
        """The estimated error of the value v, in units of the strike."""
        return float(self.errors[0, 0])


def estimate_to_tolerance(
    solver: ScheduleSolver,
    tolerance: float,
    *,
    scheme: Scheme = "sdirk2",
    resolution: Resolution | None = None,
    exact: Known | None = None,
) -> Estimate:
    """Price a schedule to a tolerance; arguments and result are those of `estimating`."""
    work = estimating(solver, tolerance, scheme=scheme, resolution=resolution, exact=exact)
    return done(work, solver.interrupt)


def estimating(
    solver: ScheduleSolver,
    tolerance: float,
    *,
    scheme: Scheme = "sdirk2",
    resolution: Resolution | None = None,
    exact: Known | None = None,
) -> Work[Estimate]:
    """Price a schedule to a tolerance by the method of lines, one complementarity problem per stage.

    Parameters
    ----------
    solver : ScheduleSolver
    tolerance : float
        Absolute error as a fraction of the strike; the caller compares it with `error`.
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}
        The one-step method; crank-nicolson is damped after every event.
    resolution : Resolution, optional
        Solve at exactly this one, not extrapolated; the error is estimated from a second solve with half as many
        cells and steps. Its scheme, where it has one, goes before `scheme`.
    exact : Known, optional
        What is known of the European option.

    Returns
    -------
    Estimate
        Its error exceeds the tolerance where the finest resolution was not enough, or the next one would take more than
        100 MB of memory (`MOST_STORED`): at 1e-6, for wide distributions
        (volatility * sqrt(expiry) above 1) with several dividends, for rates near -50 % over years (where the value
        is a multiple of the strike), and where a segment has next to no volatility, which is of first order.

    Notes
    -----
    The grid reaches as far as the spot and the strike may move (`reach`); kinks enter it by projection
    (`event_transfer`), the exercise boundary by its place in a cell (`boundary_cell`): second order for every kind of
    event, and regular enough to extrapolate. In one of a hundred contracts the error estimate is too small, seldom by
    more than a factor of two.
    """
    if resolution is None:
        coarsest = coarsest_resolution(solver, scheme, tolerance)
        found = yield from _refined(solver, tolerance, coarsest, exact)
    else:
        found = yield from _at_resolution(
            solver, replace(resolution, scheme=resolution.scheme or scheme), exact
        )
    if found.interrupted or not _region_is_elsewhere(solver, found):
        return found
    region = yield from _region_elsewhere(solver, tolerance)
    return replace(found, region=region)


def value_on_same_grids(estimate: Estimate, solver: ScheduleSolver) -> tuple[float, float]:
    """Return v and v_s of a schedule that differs little from the estimate's, NaN where interrupted.

    It is solved on the grids and at the resolutions that the estimate comes from, and extrapolated likewise: the
    differences of such values are smooth in what differs.

    Parameters
    ----------
    solver : ScheduleSolver
        The solver on the range of spots that the estimate was solved on.
    """
    levels = levels_on_same_grids(replace(estimate, levels=estimate.levels[-2:]), solver, held=False)
    if levels is None:
        return math.nan, math.nan
    american = levels[-1].american
    if len(levels) > 1:
        american, _ = limit_of([level.american for level in levels], first_order=levels[-1].fitted)
    return float(american[0, 0]), float(american[0, 1])


def levels_on_same_grids(
    estimate: Estimate, solver: ScheduleSolver, *, held: bool = True
) -> list[Level] | None:
    """Return a schedule's solves at the resolutions that an estimate comes from, None where interrupted."""
    levels = []
    for level in estimate.levels:
        solved = solver.solve(level.resolution, held=held)
        if solved is None:
            return None
        levels.append(solved)
    return levels


def boundaries(
    schedule: Schedule,
    times: Vector,
    tolerance: float,
    interrupt: Callable[[], bool] | None = None,
) -> Matrix:
    """Return the (near, far) exercise boundary of the actual spot in money, shape (m, 2), NaN where there is none.

    One solve; its time steps end at the times asked for. Measured on the reference boundaries of flat markets: 1e-5 of
    the boundary for time to expiry >= expiry/4, 1e-4 at expiry/10, 4e-4 at expiry/100, at the default tolerance.

    Parameters
    ----------
    schedule : Schedule
        Its spot is not used.
    times : Vector, shape (m,)
        Years from now, increasing, 0 to expiry; at the end of a segment the boundary is that just before the event.
    tolerance : float
        Tolerance of the price, as a fraction of the strike: it settles how far the grid reaches and how fine it is.

    Raises
    ------
    NumericalError
        The interrupt came before the end.
    """
    asked = tuple(float(t) for t in times)
    ends = _ends(solver_at_strike(schedule, tolerance, interrupt), asked, tolerance)
    for column, start in enumerate(first_boundaries(schedule)):
        if np.isnan(ends[:, column]).any() and _lies_elsewhere(start, schedule.strike):
            # The boundary may lie on a range of its own.
            solver = make_solver(replace(schedule, spot=start), tolerance, interrupt=interrupt)
            ends = np.where(np.isnan(ends), _ends(solver, asked, tolerance), ends)
    return ends


def _ends(solver: ScheduleSolver, times: tuple[float, ...], tolerance: float) -> Matrix:
    """Return the (near, far) boundary that one solve sees, shape (m, 2)."""
    schedule, resolution = solver.schedule, _for_boundaries(solver, 0.0)
    for _ in range(DOUBLINGS if tolerance < 1e-4 else DOUBLINGS - 1):
        resolution = resolution.refined()
    regions = done(solver.regions(times, resolution), solver.interrupt)
    if regions is None:
        raise NumericalError("the interrupt came before the boundary was found")
    ends = np.full((len(times), 2), math.nan)
    for row, (t, found) in enumerate(zip(times, regions, strict=True)):
        segment = next((s for s in schedule.segments if t <= s.end), schedule.segments[-1])
        region = actual_region(found, segment.escrow_at(t) / schedule.strike)
        if t >= schedule.segments[-1].end:
            region = region_before_expiry(schedule, region)
        ends[row] = region.boundaries(schedule)
    return ends


def _refined(
    solver: ScheduleSolver, tolerance: float, coarsest: Resolution, exact: Known | None
) -> Work[Estimate]:
    """Refine from `coarsest` until the estimated error meets the tolerance, or to the finest resolution."""
    levels: list[Level] = []
    best = _NOTHING
    resolution = coarsest
    doublings = DOUBLINGS if tolerance >= TIGHT_TOLERANCE else TIGHT_DOUBLINGS
    while True:
        level = yield from solver.solving(resolution)
        if level is None:
            return replace(best, interrupted=True, solves=len(levels))
        levels.append(level)
        if len(levels) >= 2:
            best = _extrapolated(solver, levels, exact)
        if len(levels) >= FEWEST_SOLVES and best.error <= tolerance:
            break
        small = 4 * level.steps * resolution.intervals <= MOST_WORK
        most = max(resolution.intervals, resolution.steps) > MOST // 2 or 4 * level.stored > MOST_STORED
        if most or len(levels) > (TIGHT_DOUBLINGS if small else doublings):
            break
        resolution = resolution.refined()
    return best


def _at_resolution(solver: ScheduleSolver, resolution: Resolution, exact: Known | None) -> Work[Estimate]:
    """Solve at `resolution`, not extrapolated; a second solve and the European value, if known, give the error."""
    second = resolution.coarsened()
    level = yield from solver.solving(resolution)
    other = yield from solver.solving(resolution.refined() if second is None else second)
    if level is None or other is None:
        return replace(_NOTHING, interrupted=True)
    american, european, known = _common([level, other])
    errors = ERROR_SHARE * np.abs(american[0] - american[1])
    if exact is not None and not level.exercised:
        errors = np.fmax(errors, EUROPEAN_SHARE * np.abs(known[0] - exact.values[: len(errors)]))
    errors[0, 0] += _noise(solver, level)
    return Estimate(american[0], european[0], errors, level.region, (level,), 2, False)


def _extrapolated(solver: ScheduleSolver, levels: list[Level], exact: Known | None) -> Estimate:
    """Return the extrapolant of the last two levels, n >= 2, with its error."""
    last = levels[-1]
    americans, europeans, knowns = _common(levels)
    step_share = STEP_SHARE if solver.schedule.local is None else LOCAL_STEP_SHARE
    american, errors = limit_of(americans, first_order=last.fitted, step_share=step_share)
    european, _ = limit_of(europeans, first_order=last.fitted)
    if exact is not None:
        values, of_values = (part[: len(american)] for part in exact)
        # Where the option is exercised its value is the payoff, and the European value's error has no part in it.
        if not last.exercised:
            premiums = [a - b for a, b in zip(americans, knowns, strict=True)]
            premium, of_premium = limit_of(premiums, first_order=last.fitted, step_share=step_share)
            known = ~np.isnan(values)
            american = np.where(known, values + premium, american)
            errors = np.where(known, of_premium + of_values, errors)
        differences = [a - b for a, b in zip(europeans, knowns, strict=True)]
        difference, _ = limit_of(differences, first_order=last.fitted)
        european = np.where(np.isnan(values), european, values + difference)
    errors[1:] *= TANGENT_SHARE
    if last.exercised:
        american = americans[-1]
    errors[0, 0] += _noise(solver, last)
    return Estimate(american, european, errors, last.region, tuple(levels[-4:]), len(levels), False)


def _common(levels: list[Level]) -> tuple[list[Matrix], list[Matrix], list[Matrix]]:
    """Return `american`, `european` and `known` as all levels have them: a coarse one may lack the derivatives."""
    rows = min(min(len(level.american), len(level.european)) for level in levels)
    return (
        [level.american[:rows] for level in levels],
        [level.european[:rows] for level in levels],
        [level.known[:rows] for level in levels],
    )


def _noise(solver: ScheduleSolver, level: Level) -> float:
    """Return what no refinement removes: truncation, residual, rounding."""
    return solver.truncation + level.residual + ROUNDING * max(1.0, solver.spot)


def limit_of(
    values: list[Matrix], *, first_order: bool, step_share: float = STEP_SHARE
) -> tuple[Matrix, Matrix]:
    """Return the limits of sequences of numbers at doubling resolutions and their errors, both of the numbers' shape.

    How far an extrapolant moved, or a share of how far it moved before, or of how far the numbers themselves moved,
    whichever is largest; each number on its own.
    """
    differences = [after - before for before, after in pairwise(values[-4:])]
    last = differences[-1]
    if first_order:
        return values[-1], 2.0 * np.abs(last)
    limit = values[-1] + last / 3.0
    if len(differences) == 1:
        return limit, np.abs(last) / 3.0
    # By how much the extrapolant moved.
    moves = [np.abs(4.0 * after - before) / 3.0 for before, after in pairwise(differences)]
    earlier = np.maximum(CHANCE * moves[0], step_share * np.abs(last))
    return limit, np.maximum(moves[-1], earlier)


def _region_is_elsewhere(solver: ScheduleSolver, found: Estimate) -> bool:
    """Whether the exercise region may lie where the solver's grid does not reach, or where its cells are wide."""
    schedule, region = solver.schedule, found.region
    first = schedule.segments[0]
    if not first.exercisable:
        return False
    if not solver.covers_strike:
        return True
    if region.lower <= region.upper:
        end = region.upper if schedule.is_put else region.lower
        return not math.isinf(end) and _has_wide_cells(solver, found, math.exp(end))
    within = earning_region(first, is_put=schedule.is_put)
    if math.isfinite(within.lower) and math.isfinite(within.upper):
        return any(_has_wide_cells(solver, found, math.exp(end)) for end in (within.lower, within.upper))
    falls = schedule.is_put and solver.span.low > 0.0 and any(s.amount > 0.0 for s in schedule.segments)
    return falls or not math.isnan(first_boundaries(schedule)[0])


def _has_wide_cells(solver: ScheduleSolver, found: Estimate, spot: float) -> bool:
    """Whether the finest grid has wide cells at a spot in strikes, or does not reach it."""
    resolution = found.levels[-1].resolution
    s = spot - solver.schedule.segments[0].escrow_at(0.0) / solver.schedule.strike
    nodes = solver.span.grid(resolution.intervals, resolution.stretching).nodes
    above = min(max(int(np.searchsorted(nodes, s)), 1), nodes.size - 1)
    return bool(nodes[above] - nodes[above - 1] > WIDE_CELL * s or not nodes[0] <= s <= nodes[-1])


def _region_elsewhere(seen: ScheduleSolver, tolerance: float) -> Work[ExerciseRegion]:
    """Return the exercise region now as seen from the strike, or from where it begins; empty where interrupted."""
    schedule, interrupt, shared = seen.schedule, seen.interrupt, seen.shared
    near, _ = first_boundaries(schedule)
    solvers = [solver_at_strike(schedule, tolerance, interrupt, shared)]
    if _lies_elsewhere(near, schedule.strike):
        at_start = make_solver(replace(schedule, spot=near), tolerance, interrupt=interrupt)
        solvers.append(replace(at_start, shared=shared))
    region = EMPTY_REGION
    for solver in solvers:
        resolution = _for_boundaries(solver, tolerance)
        while resolution.intervals < fewest(tolerance)[0] << REGION_DOUBLINGS:
            resolution = resolution.refined()
        regions = yield from solver.regions((0.0,), resolution)
        if regions is not None and region.lower > region.upper:
            region = actual_region(regions[0], schedule.segments[0].escrow_at(0.0) / schedule.strike)
    return region


def _for_boundaries(solver: ScheduleSolver, tolerance: float) -> Resolution:
    coarsest = coarsest_resolution(solver, "sdirk2", tolerance)
    return replace(coarsest, stretching=even_stretching(solver.span.spread))


def _lies_elsewhere(start: float, strike: float) -> bool:
    """Tell whether there is a spot where the boundary begins, other than the strike: one too small for it is none."""
    return start / strike > 0.0 and start != strike


_UNKNOWN = np.full((1, 4), math.nan)
_NOTHING = Estimate(_UNKNOWN, _UNKNOWN, _UNKNOWN, EMPTY_REGION, (), solves=0, interrupted=False)
