"""The march over one segment of a schedule, stage by stage in Python: any scheme, any solver, any mesh of times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.american.book.resolution import Resolution
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
from pricing_core.american.engines.method_of_lines.sweep_problem import Part
from pricing_core.american.engines.method_of_lines.time_stepping import integrate_stage
from pricing_core.arrays import BoolVector, Vector

# Number of arrays over the nodes of each state of the general time integration, which keeps all of them; counted.
STATE_ARRAYS = 5


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
    """

    values: Vector
    contact: BoolVector
    region: ExerciseRegion
    regions: tuple[ExerciseRegion, ...]
    steps: int
    residual: float
    stored: int


def march_segment(
    form: SegmentForm,
    values: Vector,
    part: Part,
    resolution: Resolution,
    lcp_method: LCPMethod = "tridiagonal",
    interrupt: Callable[[], bool] | None = None,
) -> SegmentMarch | None:
    """March from a segment's end, where the option has `values` at the nodes, to its start; None where interrupted.

    Parameters
    ----------
    values : Vector, shape (N + 2,)
    part : Part
        The segment of `form`, its steps, instead of the resolution's own, and when to look at the exercise region.
    interrupt : callable, optional
        Asked before every step.
    """
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
        part.steps,
        resolution,
        stop_times=[t for t in part.wanted if t < duration],
        interrupt=interrupt,
    )
    if run.status == "interrupted":
        return None
    state = run.states[-1]
    return SegmentMarch(
        form.everywhere(state.value, duration),
        state.contact,
        region_in_cells(state, form.at(duration)),
        tuple(
            region_in_cells(run.states[int(np.argmin(np.abs(run.t - t)))], form.at(t)) for t in part.wanted
        ),
        run.accepted,
        max(each.residual for each in run.states),
        STATE_ARRAYS * len(run.states) * values.size,
    )
