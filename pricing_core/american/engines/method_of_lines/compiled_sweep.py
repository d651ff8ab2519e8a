"""A solve of a schedule at one resolution by the compiled kernel, in one call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.resolution import Scheme
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
    if kernel.sweep_schedule is None or scheme is None or resolution.time_mesh == "adaptive":
        return False
    if all(part.segment.rate >= 0.0 for part in problem.parts):
        return True
    longest = [float(np.diff(mesh).max()) for mesh in _meshes(problem)]
    return all(
        1.0 + scheme[1] * h * p.segment.rate > 0.0 for h, p in zip(longest, problem.parts, strict=True)
    )


def sweep_by_kernel(
    problem: SweepProblem,
    times: tuple[float, ...],
    directions: tuple[Direction, ...],
    interrupt: Callable[[], bool] | None,
) -> Sweep | None:
    """Solve from expiry to now, see `sweep_schedule`."""
    if interrupt is not None and interrupt():
        return None
    schedule, nodes, meshes = problem.schedule, problem.grid.nodes, _meshes(problem)
    first = np.cumsum([0, *(mesh.size for mesh in meshes)])
    segments = schedule.segments
    assert kernel.sweep_schedule is not None
    try:
        found = kernel.sweep_schedule(
            nodes,
            np.array([[*_terms(s, schedule.strike), *_rights(s)] for s in segments]),
            np.concatenate(meshes),
            first,
            KERNEL_SCHEMES[problem.resolution.scheme or "sdirk2"][0],
            problem.sign,
            np.array(problem.watched),
            _direction_columns(directions, len(segments)),
            np.array([direction.step for direction in directions]),
            interrupt,
        )
    except ZeroDivisionError:
        raise NumericalError("a pivot is zero: take more time steps") from None
    if found is None:
        return None
    values, at_zero, contact, after_steps, before_events, residual, fitted, tangents = found
    seen = _regions_seen(problem, meshes, after_steps, before_events) if times else []
    return Sweep(
        problem.grid,
        values,
        at_zero,
        contact,
        ExerciseRegion(*after_steps[meshes[0].size - 2].tolist()),
        regions_at(times, schedule, seen) if times else (),
        sum(mesh.size - 1 for mesh in meshes),
        residual,
        fitted,
        nodes.size * (WORKING_ARRAYS + TANGENT_ARRAYS * len(directions)),
        tangents if directions else None,
    )


def _regions_seen(
    problem: SweepProblem, meshes: list[Vector], after_steps: Matrix, before_events: Matrix
) -> list[SegmentRegions]:
    """Return what was seen in every segment, from the regions after all steps and those before the events."""
    seen, first = [], 0
    for part, mesh, before in zip(problem.parts, meshes, before_events.tolist(), strict=True):
        rows = after_steps[first : first + mesh.size - 1].tolist()
        first += len(rows)
        wanted = [ExerciseRegion(*rows[int(np.argmin(np.abs(mesh[1:] - t)))]) for t in part.wanted]
        seen.append(SegmentRegions(ExerciseRegion(*before), wanted, ExerciseRegion(*rows[-1])))
    return seen


def _meshes(problem: SweepProblem) -> list[Vector]:
    kind = problem.resolution.time_mesh
    return [prescribed_mesh(kind, p.segment.duration, p.steps, p.wanted) for p in problem.parts]


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
