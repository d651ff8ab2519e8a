"""One solve of a schedule at one resolution: backward in time, by the compiled kernel or segment by segment."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.method_of_lines.compiled_sweep import kernel_sweeps, sweep_by_kernel
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
from pricing_core.american.engines.method_of_lines.sweep_problem import (
    Part,
    SegmentRegions,
    Sweep,
    SweepProblem,
    regions_at,
)
from pricing_core.american.engines.method_of_lines.tangents import Direction
from pricing_core.arrays import BoolVector

SMALLEST_SHARE = 0.125  # Smallest share of the steps, for a segment however short; calibrated.
SHARES = 16  # Number of parts that a segment's share of the steps is counted in, so that halves and doubles are exact.


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

    The kernel does it where it was compiled, unless `kernel_sweeps` says that it does not.

    Parameters
    ----------
    resolution : Resolution
        `steps` are those of an option without events; a segment has a share that goes like the root of its length.
    times : tuple of float
        Years from now, increasing: when to look at the exercise region; at the end of a segment just before the event.
    directions : tuple of Direction
        The parameters whose derivatives the kernel carries along.
    interrupt : callable, optional
        Asked by the kernel at the beginning and every few milliseconds, before every step otherwise.

    Raises
    ------
    NumericalError
        The matrix of a stage is singular, which it cannot be for an M-matrix.
    """
    last = schedule.segments[-1].end
    parts = tuple(
        Part(
            segment,
            _steps(resolution.steps, segment, last),
            tuple(segment.end - t for t in times if segment.start <= t < segment.end),
        )
        for segment in schedule.segments
    )
    problem = SweepProblem(schedule, parts, grid, resolution)
    if lcp_method == "tridiagonal" and kernel_sweeps(problem):
        return sweep_by_kernel(problem, times, directions, interrupt)
    return _segment_by_segment(problem, times, lcp_method, interrupt)


def _segment_by_segment(
    problem: SweepProblem,
    times: tuple[float, ...],
    lcp_method: LCPMethod,
    interrupt: Callable[[], bool] | None,
) -> Sweep | None:
    schedule, grid = problem.schedule, problem.grid
    sign, strike, nodes = problem.sign, schedule.strike, grid.nodes
    after: ValueFunction = Payoff(sign)
    at_zero = max(sign, 0.0)
    steps, residual, fitted, stored = 0, 0.0, False, 0
    seen: list[SegmentRegions] = []
    contact: BoolVector | None = None
    weights: SlopeWeights | None = None
    for part in reversed(problem.parts):
        segment = part.segment
        event = before_event(after, at_zero, segment, sign, strike, nodes)
        form = SegmentForm.discretise(
            segment, grid, sign=sign, strike=strike, values=event.values, watched=problem.watched
        )
        run = march_segment(form, event.values, part, problem.resolution, lcp_method, interrupt)
        if run is None:
            return None
        values, contact = run.values, run.contact
        at_zero = _held_at_zero(event.at_zero, form)
        if nodes[0] == 0.0:
            values[0] = at_zero
        seen.append(SegmentRegions(event.region, run.regions, run.region))
        steps += run.steps
        residual, stored = max(residual, run.residual), max(stored, run.stored)
        fitted |= form.fitted
        if segment.start > schedule.segments[0].start:
            weights = SlopeWeights.of(nodes) if weights is None else weights
            after = GridFunction.through(nodes, values, at_zero, weights)
    assert contact is not None
    regions = regions_at(times, schedule, seen[::-1])
    return Sweep(grid, values, at_zero, contact, seen[-1].at_start, regions, steps, residual, fitted, stored)


def _steps(steps: int, segment: Segment, expiry: float) -> int:
    share = max(math.sqrt(segment.duration / expiry), SMALLEST_SHARE)
    return math.ceil(steps * math.ceil(SHARES * share) / SHARES)


def _held_at_zero(at_end: float, form: SegmentForm) -> float:
    """Return the value at s = 0 at the segment's start: exercise pays best at one of its ends, or at none."""
    duration = form.segment.duration
    held = at_end * math.exp(-form.segment.rate * duration)
    return max(held, float(form.obstacle(duration, np.zeros(1))[0])) if form.segment.exercisable else held
