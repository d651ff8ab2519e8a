"""Observed orders: how the error in time falls with the steps on one grid, and the error in space with the cells."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.method_of_lines.accuracy import OUTPUTS, Error, errors, outputs_of
from benchmarks.method_of_lines.stepping_methods import STEPPER_NAMES, Method, span_of
from benchmarks.problems.classic_sets import Outputs, Problem
from pricing_core.american.book.resolution import Scheme, TimeMesh

FITTED = 3  # the finest runs, for the order
SCHEMES: tuple[Scheme, ...] = ("implicit-euler", "sdirk2", "crank-nicolson")
MESHES: tuple[TimeMesh, ...] = ("uniform", "square-root", "adaptive")
PROJECTED: tuple[Scheme, ...] = ("implicit-euler", "crank-nicolson")
REFERENCE = Method("reference", "sdirk2", "square-root")
STEPPING_METHODS = (
    *(
        Method(f"{STEPPER_NAMES[scheme]}, {mesh} steps", scheme, mesh)
        for scheme in SCHEMES
        for mesh in MESHES
    ),
    Method("Crank-Nicolson without damping, uniform steps", "crank-nicolson", "uniform", damped=False),
    *(
        Method(
            f"{STEPPER_NAMES[scheme]}, uniform steps, explicit projection", scheme, "uniform", "projection"
        )
        for scheme in PROJECTED
    ),
)
SPACE_METHODS = (
    Method("at a node", "sdirk2", "square-root"),
    Method("in its cell", "sdirk2", "square-root", "cell"),
)


class Level(NamedTuple):
    """One refinement; `work` is implicit solves per problem for steps, or cells."""

    work: float
    errors: dict[str, Error]


@dataclass(frozen=True, slots=True)
class Refinement:
    """One method, refined."""

    method: str
    levels: tuple[Level, ...]

    def order(self, output: str) -> float:
        """Return the slope of log error against log work over the finest levels, as a positive number."""
        finest = self.levels[-FITTED:]
        work = np.log([level.work for level in finest])
        error = np.log([level.errors[output].rmse for level in finest])
        return -float(np.polyfit(work, error, 1)[0])


@dataclass(frozen=True, slots=True)
class StepCounts:
    """Steps on one grid; with adaptive steps they set the local tolerance, and more steps are taken."""

    intervals: int
    prescribed: tuple[int, ...]
    adaptive: tuple[int, ...]
    reference: int


def refine_steps(problems: Sequence[Problem], counts: StepCounts) -> tuple[Refinement, ...]:
    """Refine the steps of every method on one grid; errors are the distance to very many steps on that grid."""
    reference, _ = _solve(REFERENCE, problems, counts.intervals, counts.reference)
    refinements = []
    for method in STEPPING_METHODS:
        levels = []
        for steps in counts.adaptive if method.time_mesh == "adaptive" else counts.prescribed:
            outputs, solves = _solve(method, problems, counts.intervals, steps)
            levels.append(Level(solves, errors(outputs, reference)))
        refinements.append(Refinement(method.label, tuple(levels)))
    return tuple(refinements)


def refine_cells(problems: Sequence[Problem], intervals: Sequence[int], steps: int) -> tuple[Refinement, ...]:
    """Refine the grid at very many steps, the boundary at a node or in its cell; errors are against true values."""
    true = [problem.true for problem in problems]
    return tuple(
        Refinement(
            method.label,
            tuple(
                Level(cells, errors(_solve(method, problems, cells, steps)[0], true)) for cells in intervals
            ),
        )
        for method in SPACE_METHODS
    )


def order_row(refinement: Refinement) -> tuple[str | float, ...]:
    """Return the method, and for every output the error of the finest level and the order."""
    finest = refinement.levels[-1]
    cells = ((finest.errors[name].rmse, refinement.order(name)) for name in OUTPUTS)
    return (refinement.method, finest.work, *(cell for pair in cells for cell in pair))


def _solve(
    method: Method, problems: Sequence[Problem], intervals: int, steps: int
) -> tuple[list[Outputs], float]:
    """Return the outputs of every problem, and the implicit solves of one on average."""
    solutions = [method.solve(problem, span_of(problem), intervals, steps) for problem in problems]
    solves = sum(method.implicit_solves(solution) for solution in solutions) / len(problems)
    return [outputs_of(*pair) for pair in zip(solutions, problems, strict=True)], solves
