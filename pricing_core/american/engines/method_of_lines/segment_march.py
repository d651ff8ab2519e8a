"""The march over one segment of a schedule: by the compiled kernel where it has one, else stage by stage in Python."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.engines.exercise_region import ExerciseRegion
from pricing_core.american.engines.method_of_lines.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import (
    LCPMethod,
    OptionStage,
    TridiagonalStage,
    UnconstrainedStage,
    start_state,
)
from pricing_core.american.engines.method_of_lines.time_mesh import prescribed_mesh
from pricing_core.american.engines.method_of_lines.time_stepping import integrate_stage
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.stepping.implicit import SDIRK2_THETA

# Number of nodes times steps times right-hand sides of the kernel between two questions whether to stop: about 5 ms on
# a slow processor; chosen.
PORTION = 100_000
# Number of arrays over the nodes that the kernel works with, that it needs for each derivative, and of each state of
# the general time integration, which keeps all of them; counted.
WORKING_ARRAYS, TANGENT_ARRAYS, STATE_ARRAYS = 40, 14, 5
TangentArguments: TypeAlias = tuple[Matrix, Matrix, Matrix, Matrix]
# The kernel's number of a scheme, and the scheme's implicit weight.
KERNEL_SCHEMES: dict[Scheme, tuple[int, float]] = {
    "implicit-euler": (0, 1.0),
    "sdirk2": (1, SDIRK2_THETA),
}


@dataclass(frozen=True, slots=True, eq=False)
class SegmentMarch:
    """The option at the start of a segment, and what was seen on the way from its end.

    Parameters
    ----------
    values : Vector, shape (N + 2,)
        Values at all nodes, in units of the strike.
    contact : BoolVector, shape (N,)
        The interior nodes in the exercise region.
    region : ExerciseRegion
        In s = S/K.
    regions : tuple of ExerciseRegion
        At the times asked for, likewise.
    steps : int
    residual : float
        Largest natural residual of the complementarity problems at the end of a step.
    stored : int
        How many numbers the march held in memory, to within a factor of two.
    tangents : Matrix, shape (P, N + 2), or None
        Derivatives of the values by the parameters; None where they were not asked for, or the kernel did not march.
    """

    values: Vector
    contact: BoolVector
    region: ExerciseRegion
    regions: tuple[ExerciseRegion, ...]
    steps: int
    residual: float
    stored: int
    tangents: Matrix | None = None


def march_segment(
    form: SegmentForm,
    values: Vector,
    steps: int,
    resolution: Resolution,
    *,
    lcp_method: LCPMethod = "tridiagonal",
    wanted: tuple[float, ...] = (),
    tangents: TangentArguments | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> SegmentMarch | None:
    """March from a segment's end, where the option has `values` at the nodes, to its start; None where interrupted.

    The kernel marches where it was compiled, with the direct solution of the complementarity problems on a mesh of
    times that is known beforehand, by schemes without an explicit part, and where 1 + h rate > 0, so that the matrix
    of a stage is an M-matrix: there elimination needs no exchange of rows.

    Parameters
    ----------
    values : Vector, shape (N + 2,)
    steps : int
        Instead of the resolution's own.
    wanted : tuple of float
        Years before the segment's end, 0 < t <= duration: when to look at the exercise region.
    tangents : tuple of (Matrix, Matrix, Matrix, Matrix), optional
        Values, operators, changes and lines of the derivatives by P parameters, shapes (P, N + 2), (P, 3, N), (P, 3)
        and (P, 2, 2), at the segment's end.
    interrupt : callable, optional
        Asked before every portion of the kernel's steps, some milliseconds, before every step otherwise.

    Raises
    ------
    NumericalError
        The matrix of a stage is singular, which it cannot be for an M-matrix.
    """
    times = prescribed_mesh(resolution.time_mesh, form.segment.duration, steps, wanted)
    if _kernel_marches(form, times, resolution, lcp_method):
        return _compiled(form, values, times, resolution, wanted, tangents, interrupt)
    return _stage_by_stage(form, values, steps, resolution, lcp_method, wanted, interrupt)


def _kernel_marches(form: SegmentForm, times: Vector, resolution: Resolution, lcp_method: LCPMethod) -> bool:
    scheme = KERNEL_SCHEMES.get(resolution.scheme or "sdirk2")
    if kernel.march_segment is None or scheme is None:
        return False
    if lcp_method != "tridiagonal" or resolution.time_mesh == "adaptive":
        return False
    return bool(1.0 + scheme[1] * float(np.diff(times).max()) * form.segment.rate > 0.0)


def _compiled(
    form: SegmentForm,
    values: Vector,
    times: Vector,
    resolution: Resolution,
    wanted: tuple[float, ...],
    tangents: TangentArguments | None,
    interrupt: Callable[[], bool] | None,
) -> SegmentMarch | None:
    segment, operator = form.segment, form.operator
    at_left, at_right = form.contact_at_ends().tolist()
    contact, residual = start_state(form, values).contact, 0.0
    after_steps = []
    following, *of_tangents = _no_tangents(form.grid.interior.size) if tangents is None else tangents
    parameters = 1 + following.shape[0]
    portion = max(1, PORTION // (parameters * form.grid.nodes.size))
    for first in range(0, times.size - 1, portion):
        if interrupt is not None and interrupt():
            return None
        try:
            assert kernel.march_segment is not None
            values, _, contact, _, largest, seen, following = kernel.march_segment(
                form.grid.nodes,
                operator.lower,
                operator.diagonal,
                operator.upper,
                values,
                contact,
                times[first : first + portion + 1],
                KERNEL_SCHEMES[resolution.scheme or "sdirk2"][0],
                form.sign,
                form.escrow,
                segment.rate,
                segment.dividend_yield,
                segment.exercisable,
                form.lines,
                at_left,
                at_right,
                following,
                *of_tangents,
            )
        except ZeroDivisionError:
            raise NumericalError("a pivot is zero: take more time steps") from None
        residual = max(residual, largest)
        after_steps.append(seen)
    ends = np.concatenate(after_steps)
    rows = [ends[int(np.argmin(np.abs(times[1:] - t)))] for t in (*wanted, times[-1])]
    found = [ExerciseRegion(*row.tolist()) for row in rows]
    kept = None if tangents is None else following
    stored = values.size * (WORKING_ARRAYS + TANGENT_ARRAYS * following.shape[0])
    return SegmentMarch(values, contact, found[-1], tuple(found[:-1]), times.size - 1, residual, stored, kept)


@cache
def _no_tangents(size: int) -> TangentArguments:
    return np.zeros((0, size + 2)), np.zeros((0, 3, size)), np.zeros((0, 3)), np.zeros((0, 2, 2))


def _stage_by_stage(
    form: SegmentForm,
    values: Vector,
    steps: int,
    resolution: Resolution,
    lcp_method: LCPMethod,
    wanted: tuple[float, ...],
    interrupt: Callable[[], bool] | None,
) -> SegmentMarch | None:
    duration = form.segment.duration
    stage: OptionStage = (
        BoundaryCellStage(TridiagonalStage(form, lcp_method))
        if form.segment.exercisable
        else UnconstrainedStage(form)
    )
    run = integrate_stage(
        stage,
        start_state(form, values),
        duration,
        steps,
        resolution,
        stop_times=[t for t in wanted if t < duration],
        interrupt=interrupt,
    )
    if run.status == "interrupted":
        return None
    state = run.states[-1]
    return SegmentMarch(
        form.everywhere(state.value, duration),
        state.contact,
        region_in_cells(state, form),
        tuple(region_in_cells(run.states[int(np.argmin(np.abs(run.t - t)))], form) for t in wanted),
        run.accepted,
        max(each.residual for each in run.states),
        STATE_ARRAYS * len(run.states) * values.size,
    )
