"""One solve of a schedule at one resolution: backward in time, segment by segment."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.events.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.events.event_transfer import (
    GridFunction,
    Payoff,
    SlopeWeights,
    ValueFunction,
    before_event,
)
from pricing_core.american.events.scheduled_form import SegmentForm
from pricing_core.american.flat.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.flat.grid import Grid
from pricing_core.american.flat.resolution import Resolution, integrate_stage
from pricing_core.american.flat.tridiagonal_step import (
    LCPMethod,
    OptionStage,
    TridiagonalStage,
    UnconstrainedStage,
)
from pricing_core.arrays import BoolVector, Vector

LEAST_SHARE = 0.125  # of the steps, for a segment however short
SHARES = 16  # a segment's share of the steps is a multiple of 1/16, so that halves and doubles are exact

SMALLEST_DROP = 1e-12  # of the strike: what rounding takes from the escrow


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A schedule solved at one resolution, in units of the strike.

    Parameters
    ----------
    grid : Grid
    values : Vector, shape (N + 2,)
        Now, at the nodes.
    at_zero : float
        Now, at s = 0: exact.
    contact : BoolVector, shape (N,)
        The interior nodes in the exercise region now.
    region : ExerciseRegion
        In s = S/K (not its logarithm), of the spot that diffuses.
    regions : tuple of ExerciseRegion
        At the times asked for, likewise.
    steps : int
    residual : float
        Largest natural residual of the complementarity problems.
    fitted : bool
        See `spot_operator`.
    """

    grid: Grid
    values: Vector
    at_zero: float
    contact: BoolVector
    region: ExerciseRegion
    regions: tuple[ExerciseRegion, ...]
    steps: int
    residual: float
    fitted: bool


def sweep_schedule(
    schedule: Schedule,
    grid: Grid,
    resolution: Resolution,
    *,
    lcp_method: LCPMethod = "tridiagonal",
    times: tuple[float, ...] = (),
    interrupt: Callable[[], bool] | None = None,
) -> Sweep | None:
    """Solve from expiry to now; None where interrupted.

    Parameters
    ----------
    resolution : Resolution
        `steps` are those of an option without events; a segment has a share that goes like the root of its length.
    times : tuple of float
        Years from now, increasing: when to look at the exercise region; at the end of a segment just before the event.
    """
    sign, strike, nodes = 1.0 if schedule.is_put else -1.0, schedule.strike, grid.nodes
    weights = SlopeWeights.of(nodes)
    watched = (1.0, schedule.spot / strike)
    after: ValueFunction = Payoff(sign)
    at_zero = max(sign, 0.0)
    escrow_after = 0.0
    steps, residual, fitted = 0, 0.0, False
    found: dict[float, ExerciseRegion] = {}
    region, state = EMPTY_REGION, None
    for segment in reversed(schedule.segments):
        event = before_event(after, at_zero, segment, sign, strike, nodes)
        before = event.region if _pays(segment, escrow_after, strike) or not segment.exercisable else region
        found.update((t, before) for t in times if t == segment.end)
        form = SegmentForm.discretise(segment, grid, sign, strike, event.values, watched)
        stage: OptionStage = (
            BoundaryCellStage(TridiagonalStage(form, lcp_method), form)
            if segment.exercisable
            else UnconstrainedStage(form)
        )
        wanted = [t for t in times if segment.start <= t < segment.end]
        run = integrate_stage(
            stage,
            form.start(event.values),
            segment.duration,
            _steps(resolution.steps, segment, schedule.segments[-1].end),
            resolution,
            stop_times=[segment.end - t for t in wanted if t > segment.start],
            interrupt=interrupt,
        )
        if run.status == "interrupted":
            return None
        state = run.states[-1]
        values = form.everywhere(state, segment.duration)
        at_zero = _held_at_zero(event.at_zero, form)
        if nodes[0] == 0.0:
            values[0] = at_zero
        region = region_in_cells(state, form)
        for t in wanted:
            k = int(np.argmin(np.abs(run.t - (segment.end - t))))
            found[t] = region_in_cells(run.states[k], form)
        steps += run.accepted
        residual = max(residual, *(each.residual for each in run.states))
        fitted |= form.operators.fitted
        escrow_after = segment.escrow_at(segment.start)
        after = GridFunction.through(nodes, values, at_zero, weights)
    assert state is not None
    regions = tuple(found.get(t, EMPTY_REGION) for t in times)
    return Sweep(grid, values, at_zero, state.contact, region, regions, steps, residual, fitted)


def _steps(steps: int, segment: Segment, expiry: float) -> int:
    share = max(math.sqrt(segment.duration / expiry), LEAST_SHARE)
    return math.ceil(steps * math.ceil(SHARES * share) / SHARES)


def _held_at_zero(at_end: float, form: SegmentForm) -> float:
    """Return the value at s = 0 at the segment's start: exercise pays best at one of its ends, or at none."""
    duration = form.segment.duration
    held = at_end * math.exp(-form.segment.rate * duration)
    return max(held, float(form.obstacle(duration, np.zeros(1))[0])) if form.segment.exercisable else held


def _pays(segment: Segment, escrow_after: float, strike: float) -> bool:
    """Whether a dividend is due at the segment's end."""
    drop = segment.amount + max(segment.escrow - escrow_after, 0.0)
    return segment.fraction > 0.0 or drop > SMALLEST_DROP * strike
