"""Solves of schedules, each at one resolution, by the compiled kernel, all in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.resolution import Scheme
from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.exercise_region import ExerciseRegion
from pricing_core.american.engines.method_of_lines.node_volatility import NodeVolatility
from pricing_core.american.engines.method_of_lines.sweep_problem import (
    SegmentRegions,
    Sweep,
    SweepProblem,
    regions_at,
)
from pricing_core.american.engines.method_of_lines.tangents import TERMS, Direction
from pricing_core.american.engines.method_of_lines.time_mesh import prescribed_mesh
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.stepping import SDIRK2

# Number of arrays over the nodes that the kernel works with, and that it needs for each derivative; counted.
WORKING_ARRAYS, TANGENT_ARRAYS = 40, 14
RIGHTS = slice(7, 9)  # The columns of a segment that say whether the holder may exercise.
# The kernel's number of a scheme, and the scheme's implicit weight.
KERNEL_SCHEMES: dict[Scheme, tuple[int, float]] = {
    "implicit-euler": (0, 1.0),
    "sdirk2": (1, SDIRK2.a[0][0]),
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
    numbers = [_Numbers.of(problems[0])]
    for before, problem in pairwise(problems):
        same = problem.parts is before.parts
        numbers.append(numbers[-1] if same else _Numbers.of(problem))
    arguments = [n.arguments(problem) for n, problem in zip(numbers, problems, strict=True)]
    found = kernel.sweep_schedules(arguments, interrupt)
    if found is None:
        return [None] * len(problems)
    return [
        NumericalError("a pivot is zero: take more time steps") if swept is None else n.sweep(problem, swept)
        for n, problem, swept in zip(numbers, problems, found, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Numbers:
    """What the kernel asks of the parts of a problem.

    Parameters
    ----------
    segments : Matrix, shape (M, 9)
    times : Vector, shape (T,)
        The meshes of all segments, one after the other.
    first : int array, shape (M + 1,)
        Where each begins.
    variances : array, shape (S, m, N)
        Variances of a local volatility at its times, those of the schedule and then of the directions that move it.
    weights : Matrix, shape (R, m)
        What each time counts for in every step, or in all steps of a segment.
    first_row : int array, shape (M + 1,)
        Where the rows of each segment begin.
    reference : float
        As in `LocalTerms`.
    """

    segments: Matrix
    times: Vector
    first: NDArray[np.int64]
    variances: NDArray[np.float64]
    weights: Matrix
    first_row: NDArray[np.int64]
    reference: float

    @classmethod
    def of(cls, problem: SweepProblem) -> _Numbers:
        """Return those of a problem."""
        strike, (times, first) = problem.schedule.strike, _meshes(problem)
        rows = [[*_terms(s, strike), 0, *_rights(s)] for s in problem.schedule.segments]
        return cls(np.array(rows), times, first, *_local(problem, times, first))

    def arguments(self, problem: SweepProblem) -> tuple[Any, ...]:
        """Return what the kernel asks for one sweep."""
        request, segments = problem.request, self.segments
        if request.never_exercised:
            segments = segments.copy()
            segments[:, RIGHTS] = 0.0
        return (
            request.grid.nodes,
            segments,
            self.times,
            self.first,
            KERNEL_SCHEMES[request.resolution.scheme or "sdirk2"][0],
            problem.sign,
            np.array(problem.watched),
            _direction_columns(request.directions, len(segments)),
            np.array([direction.step for direction in request.directions]),
            (self.variances, self.weights, self.first_row, self.reference),
        )

    def sweep(self, problem: SweepProblem, swept: tuple[Any, ...]) -> Sweep:
        """Return what the kernel found."""
        values, at_zero, contact, after_steps, before_events, residual, fitted, tangents = swept
        request = problem.request
        regions: tuple[ExerciseRegion, ...] = ()
        if request.times:
            seen = self._regions_seen(problem, after_steps, before_events)
            regions = regions_at(request.times, request.schedule, seen)
        return Sweep(
            request.grid,
            values,
            at_zero,
            contact,
            ExerciseRegion(*after_steps[self.first.item(1) - 2].tolist()),
            regions,
            self.times.size - len(problem.parts),
            residual,
            fitted,
            values.size * (WORKING_ARRAYS + TANGENT_ARRAYS * len(request.directions)) + self.variances.size,
            tangents if request.directions else None,
        )

    def _regions_seen(
        self, problem: SweepProblem, after_steps: Matrix, before_events: Matrix
    ) -> list[SegmentRegions]:
        """Return what was seen in every segment, from the regions after all steps and those before the events."""
        seen, rows = [], after_steps.tolist()
        spans = zip(problem.parts, pairwise(self.first.tolist()), before_events.tolist(), strict=True)
        for number, (part, (start, end), before) in enumerate(spans):
            mesh, after = self.times[start + 1 : end], rows[start - number : end - number - 1]
            wanted = [ExerciseRegion(*after[int(np.argmin(np.abs(mesh - t)))]) for t in part.wanted]
            seen.append(SegmentRegions(ExerciseRegion(*before), wanted, ExerciseRegion(*after[-1])))
        return seen


def _meshes(problem: SweepProblem) -> tuple[Vector, NDArray[np.int64]]:
    """Return the times of all segments, one after the other, and where those of each begin."""
    kind = problem.resolution.time_mesh
    meshes = [prescribed_mesh(kind, p.segment.duration, p.steps, p.wanted) for p in problem.parts]
    return np.concatenate(meshes), np.cumsum([0, *map(len, meshes)])


def _terms(segment: Segment, strike: float) -> tuple[float, ...]:
    """Return the numbers of a segment that a parameter may change, amounts in strikes."""
    rates = segment.rate, segment.dividend_yield, segment.volatility
    return *rates, segment.amount / strike, segment.escrow / strike


def _rights(segment: Segment) -> tuple[float, bool, bool]:
    return segment.fraction, segment.exercisable, segment.exercise_at_end


def _direction_columns(directions: tuple[Direction, ...], segments: int) -> NDArray[np.float64]:
    """Return the segments' numbers with more and with less of each of P parameters, shape (P, M, 2, 6)."""
    columns = np.zeros((len(directions), segments, 2, TERMS + 1))
    moving = 0
    for own, direction in zip(columns, directions, strict=True):
        own[..., :TERMS] = direction.terms
        if direction.surfaces:
            own[..., TERMS] = 1 + 2 * moving, 2 + 2 * moving
            moving += 1
    return columns


def _local(
    problem: SweepProblem, times: Vector, first: NDArray[np.int64]
) -> tuple[NDArray[np.float64], Matrix, NDArray[np.int64], float]:
    """Return the variances of the schedule and of the directions that move it, weights, first rows and reference."""
    request, schedule = problem.request, problem.schedule
    if schedule.local is None:
        return np.zeros((1, 0, 0)), np.zeros((0, 0)), np.zeros(first.size, dtype=np.int64), 0.0
    terms = (schedule.local, *(each for direction in request.directions for each in direction.surfaces))
    surfaces = [NodeVolatility.of(each, request.grid, schedule.strike) for each in terms]
    spans = zip(schedule.segments, pairwise(first.tolist()), strict=True)
    rows = [surfaces[0].weights_of_steps(segment, times[start:end]) for segment, (start, end) in spans]
    variances = np.array([surface.variance for surface in surfaces])
    return variances, np.concatenate(rows), np.cumsum([0, *map(len, rows)]), schedule.local.reference
