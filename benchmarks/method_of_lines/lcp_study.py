"""The complementarity problems of all steps of one solve: what each solver costs, and how PSOR is relaxed."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.method_of_lines.explicit_projection import projected
from benchmarks.method_of_lines.stepping_methods import Method, span_of
from benchmarks.problems.classic_sets import Problem
from pricing_core.american.engines.method_of_lines.stage import StageProblem
from pricing_core.arrays import Vector
from pricing_core.kernel import brennan_schwartz
from pricing_core.lcp import (
    LCP,
    LCPSolution,
    solve_brennan_schwartz,
    solve_lemke,
    solve_policy_iteration,
    solve_psor,
)

EULER = Method("implicit Euler, uniform steps", "implicit-euler", "uniform")
ELIMINATION, PSOR, LEMKE = "elimination (Brennan-Schwartz)", "PSOR, relaxation 1.2", "Lemke"
PROJECTION = "explicit projection (linear solve and max)"
LARGEST_FOR_LEMKE = 256  # cells: every pivot updates a dense tableau


class Step(NamedTuple):
    """The problem of one step of (11.65), for z = v - g, also as one of the library, and z at its beginning."""

    stage: StageProblem
    problem: LCP
    start: Vector


Solver: TypeAlias = Callable[[Step], tuple[Vector, int]]


def _elimination(step: Step) -> tuple[Vector, int]:
    M = step.stage.M
    return np.asarray(brennan_schwartz(M.lower[1:], M.diagonal, M.upper[:-1], step.stage.q, True)), 1


def _projection(step: Step) -> tuple[Vector, int]:
    return projected(step.stage), 1


def _of_library(solve: Callable[[Step], LCPSolution]) -> Solver:
    def solver(step: Step) -> tuple[Vector, int]:
        solution = solve(step)
        return solution.z, solution.iterations

    return solver


SOLVERS: Mapping[str, Solver] = {
    ELIMINATION: _elimination,
    "elimination, checked by the library": _of_library(
        lambda step: solve_brennan_schwartz(step.problem, contact="first")
    ),
    "policy iteration": _of_library(lambda step: solve_policy_iteration(step.problem, start=step.start)),
    PSOR: _of_library(lambda step: solve_psor(step.problem, start=step.start)),
    LEMKE: _of_library(lambda step: solve_lemke(step.problem)),
    PROJECTION: _projection,
}


class SolverRun(NamedTuple):
    """Means per step, but for the two last: the largest over all steps and nodes, in strikes.

    `iterations` are linear systems, sweeps or pivots; `difference` is from elimination.
    """

    solver: str
    intervals: int
    steps: int
    microseconds: float
    iterations: float
    residual: float
    difference: float


class RelaxationRun(NamedTuple):
    """PSOR with one relaxation parameter; means per step."""

    intervals: int
    steps: int
    relaxation: float
    sweeps: float
    microseconds: float


def put_steps(problem: Problem, intervals: int, steps: int) -> list[Step]:
    """Return the steps of one solve of a put by (11.65) with equal steps."""
    solution = EULER.solve(problem, span_of(problem), intervals, steps)
    run, found = solution.integration, []
    for before, t, h in zip(run.states[:-1], run.t[1:].tolist(), np.diff(run.t).tolist(), strict=True):
        stage = StageProblem.of(solution.form, t, before.value, h)
        found.append(Step(stage, LCP(stage.M.matrix, stage.q), before.slack))
    return found


def compare_solvers(
    problem: Problem, resolutions: Sequence[tuple[int, int]], turns: int
) -> tuple[SolverRun, ...]:
    """Solve the steps at every (cells, steps) by every solver, and by explicit projection."""
    return tuple(
        run
        for intervals, steps in resolutions
        for run in _compare(put_steps(problem, intervals, steps), turns)
    )


def _compare(steps: Sequence[Step], turns: int) -> list[SolverRun]:
    intervals = steps[0].start.size + 1
    solvers = {
        name: solve for name, solve in SOLVERS.items() if name != LEMKE or intervals <= LARGEST_FOR_LEMKE
    }
    times = least_seconds(
        [Task(tuple(partial(solve, step) for step in steps)) for solve in solvers.values()], turns
    )
    exact = [_elimination(step)[0] for step in steps]
    runs = []
    for (name, solve), seconds in zip(solvers.items(), times, strict=True):
        found, iterations = zip(*(solve(step) for step in steps), strict=True)
        residuals = [np.minimum(z, step.problem.slack(z)) for z, step in zip(found, steps, strict=True)]
        differences = [z - true for z, true in zip(found, exact, strict=True)]
        means = (1e6 * seconds / len(steps), sum(iterations) / len(steps))
        runs.append(
            SolverRun(name, intervals, len(steps), *means, _largest(residuals), _largest(differences))
        )
    return runs


def _largest(vectors: Sequence[Vector]) -> float:
    return max(float(np.max(np.abs(vector))) for vector in vectors)


def sweep_relaxation(
    problem: Problem, resolutions: Sequence[tuple[int, int]], relaxations: Sequence[float], turns: int
) -> tuple[RelaxationRun, ...]:
    """Solve all steps by PSOR, each from the value before it, for every relaxation parameter."""
    runs = []
    for intervals, count in resolutions:
        steps = put_steps(problem, intervals, count)
        solvers = [partial(_sweeps, steps, relaxation) for relaxation in relaxations]
        times = least_seconds([Task((solver,)) for solver in solvers], turns)
        runs += [
            RelaxationRun(intervals, count, relaxation, solver() / count, 1e6 * seconds / count)
            for relaxation, solver, seconds in zip(relaxations, solvers, times, strict=True)
        ]
    return tuple(runs)


def _sweeps(steps: Sequence[Step], relaxation: float) -> int:
    return sum(solve_psor(step.problem, relaxation=relaxation, start=step.start).iterations for step in steps)
