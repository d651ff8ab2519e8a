"""A schedule at one resolution: the grid it is solved on, and what the solve says at the spot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.engines.method_of_lines.grid import (
    Grid,
    SpotRange,
    even_stretching,
    natural_stretching,
    reach,
)
from pricing_core.american.engines.method_of_lines.joint_work import Work, done
from pricing_core.american.engines.method_of_lines.stage import LCPMethod
from pricing_core.american.engines.method_of_lines.sweep import SMALLEST_SHARE
from pricing_core.american.engines.method_of_lines.sweep_problem import SharedSweeps, Sweep, SweepRequest
from pricing_core.american.engines.method_of_lines.tangents import Direction
from pricing_core.arrays import Matrix

COARSEST_INTERVALS, COARSEST_STEPS = 64, 16  # Cells and steps of the first resolution; calibrated.
# Tolerance, in strikes, above which the first resolution has half as many of both; calibrated.
LOOSE_TOLERANCE = 2e-5
MOST_COARSEST_INTERVALS, MOST_COARSEST_STEPS = 768, 96  # The same where drift or rates ask for more; chosen.
# Number of cells that the drift asks for, over the most, from which it is not followed; calibrated.
HOPELESS = 1.0
# Smallest volatility, 1/sqrt(year), that is looked at: its square does not vanish; chosen.
SMALLEST_VOLATILITY = 1e-100
TRUNCATION_SHARE = 0.01  # Share of the tolerance that the ends of the grid may neglect; chosen.
LARGEST_TRUNCATION = 1e-6  # Largest value that the ends of the grid may neglect, in strikes; chosen.
# Excess of a value over the payoff, in strikes, up to which a spot next to a node that is held is exercised; chosen.
INDIFFERENT = 1e-6
STEPS_PER_RATE = 4.0  # Number of steps per unit of |rate| * duration; calibrated.
STEPS_PER_DRIFT = 2.0  # Number of steps per standard deviation that the spot drifts; calibrated.


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """The values at the spot that the solves at one resolution give.

    Parameters
    ----------
    american, european : Matrix, shape (1 + P, 4)
        v, v_s, v_ss, v_sss in units of the strike, and then the derivatives of these by the parameters; those are NaN
        where the march does not carry them.
    exercised : bool
    region : ExerciseRegion
        In ln(S/K) of the actual spot.
    resolution : Resolution
    steps : int
    residual : float
    fitted : bool
    stored : int
        As in `Sweep`.
    control : Matrix, shape (1, 4), or None
        With a local volatility, v and its derivatives of the European option at the volatility that stands for it.
    """

    american: Matrix
    european: Matrix
    exercised: bool
    region: ExerciseRegion
    resolution: Resolution
    steps: int
    residual: float
    fitted: bool
    stored: int
    control: Matrix | None = None

    @property
    def known(self) -> Matrix:
        """What a formula may give exactly, shape (1 + P, 4): `european`, or in its first row `control`."""
        if self.control is None:
            return self.european
        return np.concatenate([self.control, self.european[1:]])


@dataclass(frozen=True, slots=True, eq=False)
class ScheduleSolver:
    """One schedule's solves at different resolutions, all on the same range of spots.

    Parameters
    ----------
    span : SpotRange
    covers_strike : bool
        The range includes what the strike, as a spot, may become; else they do not meet.
    truncation : float
        What the ends of the range neglect, as a fraction of the strike.
    directions : tuple of Direction
        The P parameters whose derivatives are wanted.
    shared : SharedSweeps, optional
        The sweeps of contracts that differ in the spot alone: the range is theirs, and each sweep is done once.
    """

    schedule: Schedule
    span: SpotRange
    covers_strike: bool
    truncation: float
    lcp_method: LCPMethod = "tridiagonal"
    interrupt: Callable[[], bool] | None = None
    directions: tuple[Direction, ...] = ()
    shared: SharedSweeps | None = None

    @property
    def spot(self) -> float:
        """The spot that diffuses, in units of the strike."""
        return self.schedule.spot / self.schedule.strike

    def solve(self, resolution: Resolution, *, held: bool = True) -> Level | None:
        """Solve at one resolution; arguments and result are those of `solving`."""
        return done(self.solving(resolution, held=held), self.interrupt)

    def solving(self, resolution: Resolution, *, held: bool = True) -> Work[Level | None]:
        """Return the solves with and without early exercise, None where they were interrupted.

        Parameters
        ----------
        held : bool
            Whether the one without is wanted; its values are NaN otherwise.
        """
        request = SweepRequest(
            self.schedule,
            self._grid(resolution),
            resolution,
            self.lcp_method,
            directions=self.directions,
            shared=self.shared,
        )
        requests = [request]
        if held and any(s.exercisable or s.exercise_at_end for s in self.schedule.segments):
            requests.append(replace(request, never_exercised=True))
        asked = len(requests)
        if held and self.schedule.local is not None:
            flat = replace(self.schedule, local=None)
            requests.append(replace(request, schedule=flat, directions=(), never_exercised=True))
        answers = yield requests
        with_exercise, without = answers[0], answers[asked - 1]
        if with_exercise is None or without is None or answers[-1] is None:
            return None
        sweep = with_exercise.sweep
        paid = self.exercised(sweep)
        earns = with_exercise.at_spot[0, 0] - paid[0, 0] > INDIFFERENT
        exercised = sweep.region.contains(self.spot) and not (earns and sweep.holds_in_gap(self.spot))
        return Level(
            paid if exercised else self._total(with_exercise.at_spot),
            self._total(without.at_spot) if held else np.full((1, 4), math.nan),
            exercised,
            actual_region(sweep.region, self._escrow()),
            resolution,
            sweep.steps,
            sweep.residual,
            sweep.fitted,
            sweep.stored,
            answers[-1].at_spot if len(requests) > asked else None,
        )

    def regions(
        self, times: tuple[float, ...], resolution: Resolution
    ) -> Work[tuple[ExerciseRegion, ...] | None]:
        """Return the exercise regions at these times in s = S/K of the spot that diffuses, None where interrupted."""
        grid = self._grid(resolution)
        request = SweepRequest(self.schedule, grid, resolution, self.lcp_method, times, shared=self.shared)
        (answer,) = yield [request]
        return None if answer is None else answer.sweep.regions

    def exercised(self, sweep: Sweep) -> Matrix:
        """Return what exercise now brings, shape (1 + P, 4): no parameter changes it at a given spot."""
        parameters = 0 if sweep.tangents is None else len(sweep.tangents)
        sign, found = 1.0 if self.schedule.is_put else -1.0, np.zeros((1 + parameters, 4))
        found[0, :2] = sign * (1.0 - self._escrow() - self.spot), -sign
        return found

    def _total(self, found: Matrix) -> Matrix:
        """Return the derivatives at a given spot from those at a given spot that diffuses."""
        found = found.copy()  # a European option's values are those with and without exercise
        for row, direction in zip(found[1:], self.directions, strict=False):
            row[:3] += direction.spot * found[0, 1:]
        return found

    def _grid(self, resolution: Resolution) -> Grid:
        return self.span.grid(resolution.intervals, resolution.stretching)

    def _escrow(self) -> float:
        return self.schedule.segments[0].escrow_at(0.0) / self.schedule.strike


def make_solver(
    schedule: Schedule,
    tolerance: float,
    lcp_method: LCPMethod = "tridiagonal",
    interrupt: Callable[[], bool] | None = None,
    shared: SharedSweeps | None = None,
) -> ScheduleSolver:
    """Choose the range: what the spots and the strike may become, or the spots alone where these do not meet.

    The spots are the schedule's own, or those of the contracts that share sweeps.
    """
    truncation = min(TRUNCATION_SHARE * tolerance, LARGEST_TRUNCATION)
    spots = (schedule.spot / schedule.strike,) if shared is None else shared.spots
    low, high = min(spots), max(spots)
    moves = reach(schedule, truncation, (low, high))
    span, of_strike = moves.range_of(low, high), moves.range_of(1.0, 1.0)
    together = span.low < of_strike.high and of_strike.low < span.high
    if together:
        span = moves.range_of(min(low, 1.0), max(high, 1.0))
    return ScheduleSolver(schedule, span, together, truncation, lcp_method, interrupt, shared=shared)


def solver_at_strike(
    schedule: Schedule,
    tolerance: float,
    interrupt: Callable[[], bool] | None,
    shared: SharedSweeps | None = None,
) -> ScheduleSolver:
    """Return a solver whose range is that of the strike: for the exercise region, which the spot does not change.

    A put's may shrink to nothing before a cash dividend, and is followed there.
    """
    at_strike = replace(schedule, spot=schedule.strike)
    solver = replace(make_solver(at_strike, tolerance, interrupt=interrupt), shared=shared)
    if schedule.is_put and any(segment.amount > 0.0 for segment in schedule.segments):
        return replace(solver, span=solver.span.down_to_zero())
    return solver


def fewest(tolerance: float) -> tuple[int, int]:
    """Return the smallest numbers of cells and steps of a first resolution for a tolerance in strikes."""
    few = 2 if tolerance > LOOSE_TOLERANCE else 1
    return COARSEST_INTERVALS // few, COARSEST_STEPS // few


def coarsest_resolution(solver: ScheduleSolver, scheme: Scheme, tolerance: float) -> Resolution:
    """Return the first of the doubling resolutions: fine enough for the rates and for the drift.

    Parameters
    ----------
    tolerance : float
        Tolerance of the price, in strikes: two doublings of the first resolution are meant to reach it.
    """
    if solver.schedule.local is not None:  # whose kinks coarse cells do not see
        tolerance = min(tolerance, LOOSE_TOLERANCE)
    fewest_intervals, fewest_steps = fewest(tolerance)
    span, segments = solver.span, solver.schedule.segments
    width = math.log(span.high / max(span.low, span.shift))
    steps, cells = 1.0, 1.0
    for segment in segments:
        drift, root = abs(segment.rate - segment.dividend_yield), math.sqrt(segment.duration)
        # A segment's share of the steps goes like the root of its length.
        share = max(root / math.sqrt(segments[-1].end), SMALLEST_SHARE)
        needed = STEPS_PER_RATE * abs(segment.rate) * segment.duration
        if segment.volatility > 0.0:
            volatility = max(segment.volatility, SMALLEST_VOLATILITY)
            needed = max(needed, STEPS_PER_DRIFT * drift * root / volatility)
            cells = max(cells, 0.5 * width * drift / volatility**2 / fewest_intervals)
        steps = max(steps, needed / share / fewest_steps)
    if cells > HOPELESS * MOST_COARSEST_INTERVALS / fewest_intervals:
        # No grid resolves the drift: the spot hardly diffuses, and the fitted operator carries it.
        cells = steps = 1.0
    # What Crank-Nicolson does not damp, it amplifies on the finest cells: the plain grid is the better one for it.
    plain = scheme == "crank-nicolson"
    return Resolution(
        fewest_intervals * min(math.ceil(cells), MOST_COARSEST_INTERVALS // fewest_intervals),
        fewest_steps * min(math.ceil(steps), MOST_COARSEST_STEPS // fewest_steps),
        time_mesh="square-root" if plain else "cube-root",
        scheme=scheme,
        stretching=even_stretching(span.spread) if plain else natural_stretching(span.spread, span.tails),
    )


def actual_region(region: ExerciseRegion, escrow: float) -> ExerciseRegion:
    """Return the region in ln(S/K) of the actual spot from that in s = S*/K; escrow in units of the strike."""
    upper = region.upper + escrow
    if region.lower > region.upper or upper <= 0.0:
        return EMPTY_REGION
    lower = region.lower + escrow
    return ExerciseRegion(
        math.log(lower) if lower > 0.0 else -math.inf,
        math.log(upper) if upper < math.inf else math.inf,
    )
