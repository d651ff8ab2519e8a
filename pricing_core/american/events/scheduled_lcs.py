"""Options with events by the general path: refine, extrapolate, estimate the error, as `engine` does without events.

The European option is solved on the same grids. Where a formula gives its exact value, the error that the two solves
share is taken out.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.events.scheduled_level import (
    Level,
    ScheduledSolver,
    actual_region,
    coarsest_scheduled_resolution,
    make_scheduled_solver,
    solver_at_strike,
)
from pricing_core.american.events.scheduled_limits import (
    exact_european,
    option_of,
    scheduled_region_at_expiry,
    value_at_zero,
    without_exercise,
)
from pricing_core.american.flat.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.flat.resolution import MOST, Resolution, Scheme
from pricing_core.american.flat.tridiagonal_step import LCPMethod
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

DOUBLINGS, TIGHT_DOUBLINGS = 4, 5
TIGHT_TOLERANCE = 1e-6  # below it, and where there are few events, once more
MOST_WORK = 4_000_000  # cells times steps of the finest solve with few events: about two seconds
LEAST_SOLVES = 3  # two may agree by chance
ERROR_SHARE = 1.5  # of the distance of two solves a factor of two apart
CHANCE, REGULAR_CHANCE = 1.0 / 4.0, 1.0 / 16.0  # share of a distance below which agreement is not believed
REGULAR = (3.4, 4.6)  # ratios of successive differences that speak of second order
ROUNDING = 1e-13  # of the strike, or of the spot where that is larger
REGION_DOUBLINGS = 2  # for the region alone


@dataclass(frozen=True, slots=True, eq=False)
class ScheduledSolution:
    """An option with events: values at the spot now, in money, with error estimates.

    Parameters
    ----------
    value, error : float
        NaN where the interrupt came before two solves.
    european, european_error : float
        The option without early exercise, with the same events.
    delta, gamma, european_delta, european_gamma : float
    region : ExerciseRegion
        Now, in ln(S/K) of the actual spot.
    exercised : bool
        Whether the spot lies in that region.
    resolution : Resolution
        Of the finest solve.
    solves : int
        Resolutions solved; the result is extrapolated from the last two unless the resolution was given.
    steps : int
        Time steps of the finest solve.
    lcp_residual : float
        Largest natural residual of the finest solve's complementarity problems, as a fraction of the strike, or of the
        spot where that is larger.
    fitted : bool
        Exponential fitting was needed (the drift dominates the diffusion on the finest grid): first order only.
    interrupted : bool
        The interrupt came before the error was small enough.
    solver : ScheduledSolver
        With the range of spots that was solved on.
    """

    value: float
    error: float
    european: float
    european_error: float
    delta: float
    gamma: float
    european_delta: float
    european_gamma: float
    region: ExerciseRegion
    exercised: bool
    resolution: Resolution
    solves: int
    steps: int
    lcp_residual: float
    fitted: bool
    interrupted: bool
    solver: ScheduledSolver


def solve_schedule_lcs(
    schedule: Schedule,
    tolerance: float,
    *,
    scheme: Scheme = "sdirk2",
    lcp_method: LCPMethod = "tridiagonal",
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> ScheduledSolution:
    """Price an option with events to a tolerance by the method of lines, one complementarity problem per stage.

    Parameters
    ----------
    schedule : Schedule
    tolerance : float
        Absolute error as a fraction of the strike; the caller compares it with `error`.
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}
        The one-step method; crank-nicolson is damped after every event.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
    resolution : Resolution, optional
        Solve at exactly this one, not extrapolated; the error is estimated from a second solve with half as many
        cells and steps. Its formulation plays no part, and its scheme, where it has one, goes before `scheme`.
    interrupt : callable, optional
        Asked before every time step; True ends the work.

    Returns
    -------
    ScheduledSolution
        Its error exceeds the tolerance where the finest resolution was not enough: at 1e-6, for wide distributions
        (volatility * sqrt(expiry) above 1) with several dividends, for rates near -50 % over years (where the value
        is a multiple of the strike), and where a stretch has next to no volatility, which is of first order.

    Notes
    -----
    The grid reaches as far as the spot and the strike may move (`spot_range`); kinks enter it by projection
    (`event_transfer`), the exercise boundary by its place in a cell (`boundary_cell`): second order for every kind of
    event, and regular enough to extrapolate. In one of twenty contracts the error estimate is too small, seldom by more
    than a factor of two. About 0.1 s at 1e-6 for a contract with one dividend, 1.5 s with sixty.
    """
    if schedule.spot == 0.0:
        return _worthless_underlying(schedule, tolerance, scheme, interrupt)
    solver = make_scheduled_solver(schedule, tolerance, lcp_method, interrupt)
    if resolution is None:
        solution = _to_tolerance(solver, tolerance, coarsest_scheduled_resolution(solver, scheme))
    else:
        solution = _at_resolution(solver, replace(resolution, scheme=resolution.scheme or scheme))
    if solution.interrupted or not _region_is_elsewhere(solver, solution.region):
        return solution
    return replace(solution, region=_region_near_strike(schedule, tolerance, interrupt))


def values_on_same_grid(
    solution: ScheduledSolution, schedules: Sequence[Schedule]
) -> list[tuple[float, float]]:
    """Return value and delta in money of schedules that differ little from the solution's, NaN where interrupted.

    Each is solved once on the solution's grid and at its resolution, not extrapolated: their differences among each
    other, the solution's own schedule included, are smooth in what differs.
    """
    found = []
    for schedule in schedules:
        solver = replace(solution.solver, schedule=schedule)
        pair = (
            solver.value_and_slope(solution.resolution)
            if schedule.spot > 0.0
            else value_at_zero(schedule)[:2]
        )
        value, slope = (math.nan, math.nan) if pair is None else pair
        found.append((schedule.strike * value, slope))
    return found


def boundaries_lcs(
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
        Of the price, as a fraction of the strike: it settles how far the grid reaches and how fine it is.

    Raises
    ------
    NumericalError
        The interrupt came before the end.
    """
    asked = tuple(float(t) for t in times)
    ends = _ends(solver_at_strike(schedule, tolerance, interrupt), asked, tolerance)
    far = _far_limit(schedule)
    if not math.isnan(far) and np.any(np.isnan(ends[:, 1])):  # it may lie on a range of its own
        seen = _ends(
            make_scheduled_solver(replace(schedule, spot=far), tolerance, interrupt=interrupt),
            asked,
            tolerance,
        )
        ends = np.where(np.isnan(ends), seen, ends)
    return ends


def _ends(solver: ScheduledSolver, times: tuple[float, ...], tolerance: float) -> Matrix:
    """Return the (near, far) boundary that one solve sees, shape (m, 2)."""
    schedule, resolution = solver.schedule, coarsest_scheduled_resolution(solver, "sdirk2")
    for _ in range(DOUBLINGS if tolerance < 1e-4 else DOUBLINGS - 1):
        resolution = resolution.refined()
    regions = solver.regions(times, resolution)
    if regions is None:
        raise NumericalError("the interrupt came before the boundary was found")
    ends = np.full((len(times), 2), math.nan)
    for row, (t, found) in enumerate(zip(times, regions, strict=True)):
        segment = next((s for s in schedule.segments if t <= s.end), schedule.segments[-1])
        region = actual_region(found, segment.escrow_at(t) / schedule.strike)
        if t >= schedule.segments[-1].end:
            region = scheduled_region_at_expiry(schedule, region)
        ends[row] = region.boundaries(option_of(schedule))
    return ends


def _far_limit(schedule: Schedule) -> float:
    """Return K r/q, the far end of the last exercise region that has two, NaN where none has."""
    for segment in reversed(schedule.segments):
        r, q = segment.rate, segment.dividend_yield
        if segment.exercisable and (q < r < 0.0 if schedule.is_put else r < q < 0.0):
            return schedule.strike * r / q
    return math.nan


def _to_tolerance(solver: ScheduledSolver, tolerance: float, coarsest: Resolution) -> ScheduledSolution:
    """Refine from `coarsest` until the estimated error meets the tolerance, or to the finest resolution."""
    levels: list[Level] = []
    best = _nothing(solver, coarsest)
    resolution = coarsest
    doublings = DOUBLINGS if tolerance >= TIGHT_TOLERANCE else TIGHT_DOUBLINGS
    while True:
        level = solver.solve(resolution)
        if level is None:
            return replace(best, interrupted=True, solves=len(levels))
        levels.append(level)
        if len(levels) >= 2:
            best = _extrapolated(solver, levels)
        if len(levels) >= LEAST_SOLVES and best.error <= tolerance * solver.schedule.strike:
            break
        small = 4 * level.steps * resolution.intervals <= MOST_WORK
        most = max(resolution.intervals, resolution.steps) > MOST // 2
        if most or len(levels) > (TIGHT_DOUBLINGS if small else doublings):
            break
        resolution = resolution.refined()
    return best


def _at_resolution(solver: ScheduledSolver, resolution: Resolution) -> ScheduledSolution:
    """Solve at `resolution`, not extrapolated; a second solve gives the error."""
    second = resolution.coarsened()
    level = solver.solve(resolution)
    other = solver.solve(resolution.refined() if second is None else second)
    if level is None or other is None:
        return replace(_nothing(solver, resolution), interrupted=True)
    errors = (
        ERROR_SHARE * abs(float(level.american[0] - other.american[0])),
        ERROR_SHARE * abs(float(level.european[0] - other.european[0])),
    )
    return _solution(solver, level, level.american, level.european, errors, solves=2)


def _extrapolated(solver: ScheduledSolver, levels: list[Level]) -> ScheduledSolution:
    """Return the extrapolant of the last two levels, n >= 2, with its error."""
    last = levels[-1]
    european, european_error = _limit([level.european for level in levels], last.fitted)
    exact = exact_european(solver.schedule)
    if exact is None:
        american, error = _limit([level.american for level in levels], last.fitted)
    else:
        premium, error = _limit([level.american - level.european for level in levels], last.fitted)
        american, european, european_error = exact + premium, exact, -solver.truncation  # it needs no grid
    if last.exercised:
        american = last.american
    return _solution(solver, last, american, european, (error, european_error), solves=len(levels))


def _limit(values: list[Vector], first_order: bool) -> tuple[Vector, float]:
    """Return the limit of values at doubling resolutions, and its error.

    How far the extrapolant moved, or a share of how far it lies from the value, or of how far it moved before,
    whichever is largest; a smaller share where the values have been seen to converge at second order.
    """
    last, fine = float(values[-2][0]), float(values[-1][0])
    if first_order:
        return values[-1], 2.0 * abs(fine - last)
    limit = (4.0 * values[-1] - values[-2]) / 3.0
    if len(values) == 2:
        return limit, abs(float(limit[0]) - fine)
    heads = [float(value[0]) for value in values]
    differences = [b - a for a, b in pairwise(heads)]
    moves = [abs(4.0 * d - c) / 3.0 for c, d in pairwise(differences)]  # of the extrapolant
    ratios = [c / d if d != 0.0 else math.inf for c, d in pairwise(differences)][-2:]
    regular = len(ratios) == 2 and all(REGULAR[0] <= ratio <= REGULAR[1] for ratio in ratios)
    chance = REGULAR_CHANCE if regular else CHANCE
    return limit, max(moves[-1], chance * abs(differences[-1]) / 3.0, chance * max(moves[-2:]))


def _solution(
    solver: ScheduledSolver,
    level: Level,
    american: Vector,
    european: Vector,
    errors: tuple[float, float],
    solves: int,
) -> ScheduledSolution:
    """Return everything in money; what the value lacks of a bound below it counts as error."""
    strike = solver.schedule.strike
    noise = solver.truncation + level.residual + ROUNDING * max(1.0, solver.spot)
    least = max(float(european[0]), 0.0)
    if solver.schedule.segments[0].exercisable:
        least = max(least, float(solver.exercised()[0]))
    missing = max(least - float(american[0]), 0.0)
    scale = np.array([strike, 1.0, 1.0 / strike])
    value, delta, gamma = (american * scale).tolist()
    held, held_delta, held_gamma = (european * scale).tolist()
    return ScheduledSolution(
        value=value + strike * missing,
        error=strike * (max(errors[0], missing) + noise),
        european=max(held, 0.0),
        european_error=strike * (errors[1] + noise),
        delta=delta,
        gamma=gamma,
        european_delta=held_delta,
        european_gamma=held_gamma,
        region=level.region,
        exercised=level.exercised,
        resolution=level.resolution,
        solves=solves,
        steps=level.steps,
        lcp_residual=level.residual,
        fitted=level.fitted,
        interrupted=False,
        solver=solver,
    )


def _nothing(solver: ScheduledSolver, resolution: Resolution) -> ScheduledSolution:
    nan = math.nan
    return ScheduledSolution(
        nan, nan, nan, nan, nan, nan, nan, nan,
        EMPTY_REGION, False, resolution, 0, 0, 0.0, False, False, solver,
    )  # fmt: skip


def _region_is_elsewhere(solver: ScheduledSolver, region: ExerciseRegion) -> bool:
    """Whether the exercise region may lie where the solver's grid does not reach."""
    schedule, empty = solver.schedule, region.lower > region.upper
    below = schedule.is_put and solver.span.low > 0.0 and any(s.amount > 0.0 for s in schedule.segments)
    return schedule.segments[0].exercisable and (not solver.covers_strike or (empty and below))


def _region_near_strike(
    schedule: Schedule, tolerance: float, interrupt: Callable[[], bool] | None
) -> ExerciseRegion:
    """Return the exercise region now as seen from a spot at the strike; empty where interrupted."""
    solver = solver_at_strike(schedule, tolerance, interrupt)
    resolution = coarsest_scheduled_resolution(solver, "sdirk2")
    for _ in range(REGION_DOUBLINGS):
        resolution = resolution.refined()
    regions = solver.regions((0.0,), resolution)
    if regions is None:
        return EMPTY_REGION
    return actual_region(regions[0], schedule.segments[0].escrow_at(0.0) / schedule.strike)


def _worthless_underlying(
    schedule: Schedule, tolerance: float, scheme: Scheme, interrupt: Callable[[], bool] | None
) -> ScheduledSolution:
    """Return the option on a spot of 0, which stays there: its value is exact, the region is that of a solve."""
    solver = solver_at_strike(schedule, tolerance, interrupt)
    value, slope, exercised = value_at_zero(schedule)
    european, european_slope, _ = value_at_zero(without_exercise(schedule))
    strike = schedule.strike
    return replace(
        _nothing(solver, coarsest_scheduled_resolution(solver, scheme)),
        value=strike * value,
        error=strike * ROUNDING,
        european=strike * european,
        european_error=strike * ROUNDING,
        delta=slope,
        gamma=0.0,
        european_delta=european_slope,
        european_gamma=0.0,
        region=_region_near_strike(schedule, tolerance, interrupt),
        exercised=exercised,
    )
