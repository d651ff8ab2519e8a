"""One solve of a schedule at one resolution: backward in time, by the compiled kernel or segment by segment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.method_of_lines.compiled_sweep import kernel_sweeps, sweep_by_kernel
from pricing_core.american.engines.method_of_lines.event_transfer import (
    GridFunction,
    Payoff,
    SlopeWeights,
    ValueFunction,
    before_event,
)
from pricing_core.american.engines.method_of_lines.limits import without_exercise
from pricing_core.american.engines.method_of_lines.node_volatility import NodeVolatility
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.segment_march import march_segment
from pricing_core.american.engines.method_of_lines.sweep_problem import (
    Part,
    SegmentRegions,
    Sweep,
    SweepProblem,
    SweepRequest,
    regions_at,
)
from pricing_core.arrays import BoolVector
from pricing_core.errors import PricingCoreError

# What a sweep may raise for numerical reasons.
FAILURES = (PricingCoreError, ArithmeticError, np.linalg.LinAlgError)
SMALLEST_SHARE = 0.125  # Smallest share of the steps, for a segment however short; calibrated.
SHARES = 16  # Number of parts that a segment's share of the steps is counted in, so that halves and doubles are exact.


def sweep_schedule(request: SweepRequest, interrupt: Callable[[], bool] | None = None) -> Sweep | None:
    """Solve from expiry to now; None where interrupted.

    Parameters
    ----------
    interrupt : callable, optional
        See `sweep_together`.

    Raises
    ------
    NumericalError
        The matrix of a stage is singular, which it cannot be for an M-matrix.
    """
    found = sweep_together([request], interrupt)[0]
    if isinstance(found, Exception):
        raise found
    return found


def sweep_together(
    requests: Sequence[SweepRequest], interrupt: Callable[[], bool] | None = None
) -> list[Sweep | Exception | None]:
    """Return each sweep, what it raised, or None where interrupted.

    The kernel does them in one call where it was compiled, but for those that it does not do (`kernel_sweeps`). None
    depends on the others.

    Parameters
    ----------
    interrupt : callable, optional
        Asked by the kernel at the beginning and every few milliseconds, before every step otherwise.
    """
    found: list[Sweep | Exception | None] = [None] * len(requests)
    compiled: list[int] = []
    problems: list[SweepProblem] = []
    for place, request in enumerate(requests):
        before = problems[-1] if problems else None
        # Neighbours are often one contract with and without exercise.
        same = before is not None and before.has_the_parts_of(request)
        problems.append(SweepProblem(request, before.parts if before and same else _parts(request)))
        if request.lcp_method == "tridiagonal" and kernel_sweeps(problems[-1]):
            compiled.append(place)
        else:
            try:
                found[place] = _segment_by_segment(_as_stated(request), interrupt)
            except FAILURES as error:
                found[place] = error
    swept = sweep_by_kernel([problems[place] for place in compiled], interrupt)
    for place, sweep in zip(compiled, swept, strict=True):
        found[place] = sweep
    return found


def _as_stated(request: SweepRequest) -> SweepProblem:
    """Return a problem whose schedule says itself that it is never exercised."""
    if request.never_exercised:
        request = replace(request, schedule=without_exercise(request.schedule))
    return SweepProblem(request, _parts(request))


def _parts(request: SweepRequest) -> tuple[Part, ...]:
    schedule, times = request.schedule, request.times
    last = schedule.segments[-1].end
    return tuple(
        Part(
            segment,
            _steps(request.resolution.steps, segment, last),
            tuple(segment.end - t for t in times if segment.start <= t < segment.end) if times else (),
        )
        for segment in schedule.segments
    )


def _segment_by_segment(problem: SweepProblem, interrupt: Callable[[], bool] | None) -> Sweep | None:
    schedule, grid, times = problem.schedule, problem.grid, problem.request.times
    sign, strike, nodes = problem.sign, schedule.strike, grid.nodes
    after: ValueFunction = Payoff(sign)
    at_zero = max(sign, 0.0)
    steps, residual, fitted, stored = 0, 0.0, False, 0
    seen: list[SegmentRegions] = []
    contact: BoolVector | None = None
    weights: SlopeWeights | None = None
    local = None if schedule.local is None else NodeVolatility.of(schedule.local, grid, strike)
    for part in reversed(problem.parts):
        segment = part.segment
        event = before_event(after, at_zero, segment, sign, strike, nodes)
        form = SegmentForm.discretise(
            segment,
            grid,
            sign=sign,
            strike=strike,
            values=event.values,
            watched=problem.watched,
            local=local,
        )
        run = march_segment(
            form, event.values, part, problem.resolution, problem.request.lcp_method, interrupt
        )
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
