"""Solves of schedules, each at one resolution, by the compiled kernel, all in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.resolution import Scheme, TimeMesh
from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.exercise_region import ExerciseRegion
from pricing_core.american.engines.method_of_lines.sweep_problem import (
    SegmentRegions,
    Sweep,
    SweepProblem,
    regions_at,
)
from pricing_core.american.engines.method_of_lines.tangents import Direction
from pricing_core.american.engines.method_of_lines.time_mesh import prescribed_mesh
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.stepping.implicit import SDIRK2_THETA

# Number of arrays over the nodes that the kernel works with, and that it needs for each derivative; counted.
WORKING_ARRAYS, TANGENT_ARRAYS = 40, 14
# The kernel's number of a scheme, and the scheme's implicit weight.
KERNEL_SCHEMES: dict[Scheme, tuple[int, float]] = {
    "implicit-euler": (0, 1.0),
    "sdirk2": (1, SDIRK2_THETA),
}


def kernel_sweeps(problem: SweepProblem) -> bool:
    """Whether the kernel solves this, if the complementarity problems may be solved directly.

    It takes schemes without an explicit part on a mesh of times that is known beforehand, where 1 + h rate > 0 in every
    step h, so that the matrix of a stage is an M-matrix: there elimination needs no exchange of rows.
    """
    resolution = problem.resolution
    scheme = KERNEL_SCHEMES.get(resolution.scheme or "sdirk2")
    if kernel.sweep_schedules is None or scheme is None or resolution.time_mesh == "adaptive":
        return False
    if all(part.segment.rate >= 0.0 for part in problem.parts):
        return True
    times, first = _meshes(problem)
    longest = [float(np.diff(times[start:end]).max()) for start, end in pairwise(first.tolist())]
    return all(
        1.0 + scheme[1] * h * p.segment.rate > 0.0 for h, p in zip(longest, problem.parts, strict=True)
    )


def sweep_by_kernel(
    problems: Sequence[SweepProblem], interrupt: Callable[[], bool] | None
) -> list[Sweep | NumericalError | None]:
    """Solve from expiry to now, see `sweep_together`."""
    if not problems or (interrupt is not None and interrupt()):
        return [None] * len(problems)
    assert kernel.sweep_schedules is not None
    found = kernel.sweep_schedules([_arguments(problem) for problem in problems], interrupt)
    if found is None:
        return [None] * len(problems)
    return [
        NumericalError("a pivot is zero: take more time steps") if swept is None else _sweep(problem, swept)
        for problem, swept in zip(problems, found, strict=True)
    ]


def _arguments(problem: SweepProblem) -> tuple[Any, ...]:
    """Return what the kernel asks for one sweep."""
    schedule, directions = problem.schedule, problem.request.directions
    segments = schedule.segments
    times, first = _meshes(problem)
    return (
        problem.grid.nodes,
        np.array([[*_terms(s, schedule.strike), *_rights(s)] for s in segments]),
        times,
        first,
        KERNEL_SCHEMES[problem.resolution.scheme or "sdirk2"][0],
        problem.sign,
        np.array(problem.watched),
        _direction_columns(directions, len(segments)),
        np.array([direction.step for direction in directions]),
    )


def _sweep(problem: SweepProblem, swept: tuple[Any, ...]) -> Sweep:
    """Return what the kernel found."""
    values, at_zero, contact, after_steps, before_events, residual, fitted, tangents = swept
    request, (times, first) = problem.request, _meshes(problem)
    seen = _regions_seen(problem, after_steps, before_events) if request.times else []
    return Sweep(
        request.grid,
        values,
        at_zero,
        contact,
        ExerciseRegion(*after_steps[first.item(1) - 2].tolist()),
        regions_at(request.times, request.schedule, seen) if request.times else (),
        times.size - len(problem.parts),
        residual,
        fitted,
        values.size * (WORKING_ARRAYS + TANGENT_ARRAYS * len(request.directions)),
        tangents if request.directions else None,
    )


def _regions_seen(problem: SweepProblem, after_steps: Matrix, before_events: Matrix) -> list[SegmentRegions]:
    """Return what was seen in every segment, from the regions after all steps and those before the events."""
    times, first = _meshes(problem)
    seen, rows = [], after_steps.tolist()
    spans = zip(problem.parts, pairwise(first.tolist()), before_events.tolist(), strict=True)
    for number, (part, (start, end), before) in enumerate(spans):
        mesh, after = times[start + 1 : end], rows[start - number : end - number - 1]
        wanted = [ExerciseRegion(*after[int(np.argmin(np.abs(mesh - t)))]) for t in part.wanted]
        seen.append(SegmentRegions(ExerciseRegion(*before), wanted, ExerciseRegion(*after[-1])))
    return seen


def _meshes(problem: SweepProblem) -> tuple[Vector, NDArray[np.int64]]:
    """Return the times of all segments, one after the other, and where those of each begin."""
    parts = tuple((part.segment.duration, part.steps, part.wanted) for part in problem.parts)
    return _joined_meshes(problem.resolution.time_mesh, parts)


@lru_cache(maxsize=256)  # a contract with and without exercise has the same
def _joined_meshes(
    kind: TimeMesh, parts: tuple[tuple[float, int, tuple[float, ...]], ...]
) -> tuple[Vector, NDArray[np.int64]]:
    meshes = [prescribed_mesh(kind, *part) for part in parts]
    return np.concatenate(meshes), np.cumsum([0, *(mesh.size for mesh in meshes)])


def _terms(segment: Segment, strike: float) -> tuple[float, ...]:
    """Return the numbers of a segment that a parameter may change."""
    amounts = segment.amount / strike, segment.escrow / strike
    return segment.rate, segment.dividend_yield, segment.volatility, *amounts


def _rights(segment: Segment) -> tuple[float, bool, bool]:
    return segment.fraction, segment.exercisable, segment.exercise_at_end


def _direction_columns(directions: tuple[Direction, ...], segments: int) -> NDArray[np.float64]:
    """Return the segments' numbers with more and with less of each of P parameters, shape (P, M, 2, 5)."""
    rows = [
        [[_terms(s, d.up.strike) for s in pair] for pair in zip(d.up.segments, d.down.segments, strict=True)]
        for d in directions
    ]
    return np.array(rows).reshape(len(directions), segments, 2, 5)
