"""Error of price, delta, gamma and boundary against work, for every method over grids and step counts."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.method_of_lines.accuracy import OUTPUTS, Error, errors, extrapolated, outputs_of
from benchmarks.method_of_lines.stepping_methods import Method, span_of
from benchmarks.problems.classic_sets import Outputs, Problem
from pricing_core.american.engines.method_of_lines.grid import SpotRange

LEAST_STEPS = 6
EXTRAPOLATED = ", extrapolated"

LCS_METHODS = (
    Method("implicit Euler, uniform steps", "implicit-euler", "uniform"),
    Method("SDIRK2, square-root steps", "sdirk2", "square-root"),
    Method("SDIRK2, square-root steps, boundary in its cell", "sdirk2", "square-root", "cell"),
)
CRANK_NICOLSON_METHODS = (
    Method("Crank-Nicolson, uniform steps, explicit projection", "crank-nicolson", "uniform", "projection"),
    Method("Crank-Nicolson, uniform steps", "crank-nicolson", "uniform"),
    Method("Crank-Nicolson, square-root steps", "crank-nicolson", "square-root"),
    Method(
        "Crank-Nicolson, square-root steps, boundary in its cell", "crank-nicolson", "square-root", "cell"
    ),
)
METHODS = LCS_METHODS + CRANK_NICOLSON_METHODS
# What the engine does with either method: two resolutions, each cell and step of one halved in the other.
EXTRAPOLATED_METHODS = (LCS_METHODS[-1], CRANK_NICOLSON_METHODS[-1])


class Run(NamedTuple):
    """One method at one grid and step count over all problems; work and time are those of one problem.

    Parameters
    ----------
    node_steps : float
        Unknowns times implicit solves.
    errors : dict
        The error of every output, by name.
    """

    method: str
    intervals: int
    steps: int
    node_steps: float
    milliseconds: float
    errors: dict[str, Error]

    def row(self) -> tuple[str | float | int, ...]:
        """Return the cells of a table with the columns `COLUMNS`."""
        work = (self.method, self.intervals, self.steps, self.node_steps, self.milliseconds)
        return (*work, *(value for name in OUTPUTS for value in self.errors[name]))


COLUMNS = (
    "method",
    "cells",
    "steps",
    "node-steps",
    "milliseconds",
    *(f"{name} {measure}" for name in OUTPUTS for measure in ("RMSE", "largest")),
)


class _Solved(NamedTuple):
    """What one setting found, and the calls to time."""

    method: Method
    intervals: int
    steps: int
    node_steps: float
    outputs: tuple[Outputs, ...]
    task: Task


def study_accuracy(
    problems: Sequence[Problem], intervals: Sequence[int], steps_per_interval: Sequence[float], turns: int
) -> tuple[Run, ...]:
    """Solve every problem by every method at all grids and step counts; time them in turn."""
    spans = [span_of(problem) for problem in problems]
    solved = [
        _solve(method, problems, spans, cells, int(cells * ratio))
        for method in METHODS
        for ratio in steps_per_interval
        for cells in intervals
        if int(cells * ratio) >= LEAST_STEPS
    ]
    times = least_seconds([one.task for one in solved], turns)
    true = [problem.true for problem in problems]
    runs = [
        Run(
            one.method.label,
            one.intervals,
            one.steps,
            one.node_steps,
            1e3 * seconds / len(problems),
            errors(one.outputs, true),
        )
        for one, seconds in zip(solved, times, strict=True)
    ]
    return (*runs, *_extrapolations(solved, runs, true))


def _solve(
    method: Method, problems: Sequence[Problem], spans: Sequence[SpotRange], intervals: int, steps: int
) -> _Solved:
    calls = tuple(
        partial(method.solve, problem, span, intervals, steps)
        for problem, span in zip(problems, spans, strict=True)
    )
    solutions = [call() for call in calls]
    solves = sum(method.implicit_solves(solution) for solution in solutions) / len(problems)
    outputs = tuple(outputs_of(*pair) for pair in zip(solutions, problems, strict=True))
    return _Solved(method, intervals, steps, (intervals - 1) * solves, outputs, Task(calls))


def _extrapolations(solved: Sequence[_Solved], runs: Sequence[Run], true: Sequence[Outputs]) -> list[Run]:
    """Combine each setting with that of twice its cells and steps; both are paid for."""
    by_setting = {(one.method, one.intervals, one.steps): i for i, one in enumerate(solved)}
    combined = []
    for (method, intervals, steps), i in by_setting.items():
        j = by_setting.get((method, 2 * intervals, 2 * steps))
        if method in EXTRAPOLATED_METHODS and j is not None:
            outputs = [extrapolated(*pair) for pair in zip(solved[i].outputs, solved[j].outputs, strict=True)]
            combined.append(
                Run(
                    method.label + EXTRAPOLATED,
                    2 * intervals,
                    2 * steps,
                    runs[i].node_steps + runs[j].node_steps,
                    runs[i].milliseconds + runs[j].milliseconds,
                    errors(outputs, true),
                )
            )
    return combined
