"""The methods compared: how the option is stepped in time, and how it is kept above the payoff."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.interpolate import PchipInterpolator

from benchmarks.method_of_lines.explicit_projection import ExplicitProjection
from benchmarks.problems.classic_sets import Problem
from pricing_core.american import Resolution
from pricing_core.american.book.resolution import Scheme, TimeMesh
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.method_of_lines.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.engines.method_of_lines.crank_nicolson import DAMPED_STEPS, crank_nicolson
from pricing_core.american.engines.method_of_lines.event_transfer import Payoff, before_event
from pricing_core.american.engines.method_of_lines.grid import SpotRange, even_stretching
from pricing_core.american.engines.method_of_lines.level import make_solver
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import (
    OptionStage,
    OptionState,
    TridiagonalStage,
    start_state,
)
from pricing_core.american.engines.method_of_lines.sweep_problem import Sweep
from pricing_core.american.engines.method_of_lines.time_mesh import graded_mesh
from pricing_core.american.engines.method_of_lines.time_stepping import integrate_stage
from pricing_core.arrays import Vector
from pricing_core.stepping import FixedStep, Integration, integrate

Constraint: TypeAlias = Literal["node", "cell", "projection"]
STEPPER_NAMES: dict[Scheme, str] = {
    "implicit-euler": "implicit Euler",
    "sdirk2": "SDIRK2",
    "crank-nicolson": "Crank-Nicolson",
}
SPAN_TOLERANCE = 1e-8  # Tolerance of a price, in strikes, for which the grids reach far enough; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """One solve of a contract without events, from expiry on, with strike 1."""

    schedule: Schedule
    form: SegmentForm
    integration: Integration[OptionState]

    def now(self) -> Sweep:
        """Return the values after the last step."""
        form, run, state = self.form, self.integration, self.integration.states[-1]
        return Sweep(
            form.grid,
            form.everywhere(state.value, form.segment.duration),
            max(form.sign, 0.0),
            state.contact,
            region_in_cells(state, form),
            (),
            run.accepted,
            max(each.residual for each in run.states),
            form.fitted,
        )

    def boundary(self, tau: Vector) -> Vector:
        """Return the exercise boundary at times to expiry tau, NaN where none was seen.

        It is interpolated between the steps by monotone cubics in sqrt(tau), from its limit at expiry on.
        """
        regions = [region_in_cells(state, self.form) for state in self.integration.states[1:]]
        limit, _ = region_at_expiry(self.schedule).boundaries(self.schedule)
        ends = np.array([limit, *(r.upper if self.schedule.is_put else r.lower for r in regions)])
        seen = np.isfinite(ends)
        through = PchipInterpolator(np.sqrt(self.integration.t[seen]), ends[seen], extrapolate=False)
        return np.asarray(through(np.sqrt(tau)), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Method:
    """One way to step the semidiscrete option through time.

    Parameters
    ----------
    label : str
    scheme, time_mesh
        As in `pricing_core.american.Resolution`.
    constraint : {"node", "cell", "projection"}
        Solve the complementarity problem of every stage as it stands in (11.65), with the exercise boundary at a
        node; place the boundary inside its cell, as the engine does; or project in place of solving the problem.
    damped : bool
        Whether Crank-Nicolson begins with Rannacher's steps; without them it takes equal steps.
    """

    label: str
    scheme: Scheme
    time_mesh: TimeMesh
    constraint: Constraint = "node"
    damped: bool = True

    def solve(self, problem: Problem, span: SpotRange, intervals: int, steps: int) -> Solution:
        """Solve the problem on a grid of `span`, one stage after the other."""
        form, values = semidiscretise(problem, span, intervals)
        stage, start, expiry = self._stage(form), start_state(form, values), problem.option.expiry
        if self.damped:
            resolution = Resolution(intervals, steps, self.time_mesh, self.scheme)
            run = integrate_stage(stage, start, expiry, steps, resolution)
        else:
            run = integrate(
                crank_nicolson(stage, 0.0),
                start,
                (0.0, expiry),
                controller=FixedStep(),
                stop_times=graded_mesh("uniform", expiry, steps)[1:],
            )
        return Solution(problem.schedule, form, run)

    def implicit_solves(self, solution: Solution) -> int:
        """Return how many linear or complementarity problems a solution took.

        Damped steps take two; that is not counted where the steps are adaptive.
        """
        stages = 2 if self.scheme == "sdirk2" else 1
        if self.time_mesh == "adaptive":  # step doubling: one step and its two halves
            return 3 * stages * (solution.integration.accepted + solution.integration.rejected)
        damped = DAMPED_STEPS if self.scheme == "crank-nicolson" and self.damped else 0
        return stages * solution.integration.accepted + damped

    def _stage(self, form: SegmentForm) -> OptionStage:
        if self.constraint == "projection":
            return ExplicitProjection(form)
        exact = TridiagonalStage(form)
        return BoundaryCellStage(exact) if self.constraint == "cell" else exact


def span_of(problem: Problem) -> SpotRange:
    """Return the range of spots on which every method solves the problem."""
    return make_solver(problem.schedule, SPAN_TOLERANCE).span


def semidiscretise(problem: Problem, span: SpotRange, intervals: int) -> tuple[SegmentForm, Vector]:
    """Return the problem on a grid of `span`, and the payoff at its nodes, shape (intervals + 1,)."""
    (segment,) = problem.schedule.segments
    grid, sign = span.grid(intervals, even_stretching(span.spread)), 1.0 if problem.option.is_put else -1.0
    values = before_event(Payoff(sign), max(sign, 0.0), segment, sign, 1.0, grid.nodes).values
    return SegmentForm.discretise(segment, grid, sign=sign, strike=1.0, values=values, watched=(1.0,)), values
