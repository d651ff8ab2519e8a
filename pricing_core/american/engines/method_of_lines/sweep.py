"""One solve of a schedule at one resolution: backward in time, segment by segment."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.engines.method_of_lines.event_transfer import (
    GridFunction,
    Payoff,
    SlopeWeights,
    ValueFunction,
    before_event,
)
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.segment_march import march_segment
from pricing_core.american.engines.method_of_lines.stage import LCPMethod
from pricing_core.american.engines.method_of_lines.tangents import (
    Direction,
    Tangents,
    event_changes,
    kernel_arguments,
)
from pricing_core.american.engines.method_of_lines.tangents import before_event as tangents_before_event
from pricing_core.arrays import BoolVector, Matrix, Vector

SMALLEST_SHARE = 0.125  # Smallest share of the steps, for a segment however short; calibrated.
SHARES = 16  # Number of parts that a segment's share of the steps is counted in, so that halves and doubles are exact.


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
    stored : int
        Largest number of numbers that the march over a segment held in memory.
    tangents : Matrix, shape (P, N + 2), or None
        Derivatives of the values by the parameters; None where the march does not carry them.
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
    stored: int = 0
    tangents: Matrix | None = None


def sweep_schedule(
    schedule: Schedule,
    grid: Grid,
    resolution: Resolution,
    *,
    lcp_method: LCPMethod = "tridiagonal",
    times: tuple[float, ...] = (),
    directions: tuple[Direction, ...] = (),
    interrupt: Callable[[], bool] | None = None,
) -> Sweep | None:
    """Solve from expiry to now; None where interrupted.

    Parameters
    ----------
    resolution : Resolution
        `steps` are those of an option without events; a segment has a share that goes like the root of its length.
    times : tuple of float
        Years from now, increasing: when to look at the exercise region; at the end of a segment just before the event.
    directions : tuple of Direction
        The parameters whose derivatives are carried along.
    """
    sign, strike, nodes = 1.0 if schedule.is_put else -1.0, schedule.strike, grid.nodes
    watched = (1.0, schedule.spot / strike)
    after: ValueFunction = Payoff(sign)
    at_zero = max(sign, 0.0)
    steps, residual, fitted, stored = 0, 0.0, False, 0
    found: dict[float, ExerciseRegion] = {}
    region = EMPTY_REGION
    contact: BoolVector | None = None
    weights: SlopeWeights | None = None
    tangents: Tangents | None = Tangents.nothing(len(directions), nodes.size) if directions else None
    for number, segment in reversed([*enumerate(schedule.segments)]):
        event = before_event(after, at_zero, segment, sign, strike, nodes)
        before = event.region if _pays(segment) or not segment.exercisable else region
        found.update((t, before) for t in times if t == segment.end)
        form = SegmentForm.discretise(
            segment, grid, sign=sign, strike=strike, values=event.values, watched=watched
        )
        following = None
        if tangents is not None:
            tangents = tangents_before_event(
                tangents, after, event, segment, event_changes(directions, number), sign, strike, nodes
            )
            following = kernel_arguments(form, tangents, directions, number)
        wanted = [t for t in times if segment.start <= t < segment.end]
        run = march_segment(
            form,
            event.values,
            _steps(resolution.steps, segment, schedule.segments[-1].end),
            resolution,
            lcp_method=lcp_method,
            wanted=tuple(segment.end - t for t in wanted),
            tangents=following,
            interrupt=interrupt,
        )
        if run is None:
            return None
        values, contact, region = run.values, run.contact, run.region
        at_zero = _held_at_zero(event.at_zero, form)
        if run.tangents is None or tangents is None or following is None:
            tangents = None
        else:
            tangents = tangents.at_start(run.tangents, form, following[2], event.at_zero)
        if nodes[0] == 0.0:
            values[0] = at_zero
        found.update(zip(wanted, run.regions, strict=True))
        steps += run.steps
        residual, stored = max(residual, run.residual), max(stored, run.stored)
        fitted |= form.fitted
        if segment.start > schedule.segments[0].start:
            weights = SlopeWeights.of(nodes) if weights is None else weights
            after = GridFunction.through(nodes, values, at_zero, weights)
    assert contact is not None
    regions = tuple(found.get(t, EMPTY_REGION) for t in times)
    found_tangents = None if tangents is None else tangents.values
    return Sweep(
        grid, values, at_zero, contact, region, regions, steps, residual, fitted, stored, found_tangents
    )


def _steps(steps: int, segment: Segment, expiry: float) -> int:
    share = max(math.sqrt(segment.duration / expiry), SMALLEST_SHARE)
    return math.ceil(steps * math.ceil(SHARES * share) / SHARES)


def _held_at_zero(at_end: float, form: SegmentForm) -> float:
    """Return the value at s = 0 at the segment's start: exercise pays best at one of its ends, or at none."""
    duration = form.segment.duration
    held = at_end * math.exp(-form.segment.rate * duration)
    return max(held, float(form.obstacle(duration, np.zeros(1))[0])) if form.segment.exercisable else held


def _pays(segment: Segment) -> bool:
    """Whether a dividend is due at the segment's end."""
    return segment.fraction > 0.0 or segment.due > 0.0
