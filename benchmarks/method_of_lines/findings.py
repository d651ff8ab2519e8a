"""What the comparison of methods found, in sentences that are computed from the measurements."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from benchmarks.measuring.frontier import Point, time_at
from benchmarks.method_of_lines.accuracy_study import (
    CRANK_NICOLSON_METHODS,
    EXTRAPOLATED,
    EXTRAPOLATED_METHODS,
    LCS_METHODS,
    Run,
)
from benchmarks.method_of_lines.lcp_study import ELIMINATION, PROJECTION, RelaxationRun, SolverRun
from benchmarks.method_of_lines.order_study import Refinement
from benchmarks.method_of_lines.stepping_methods import Method

LEVELS: Mapping[str, tuple[float, ...]] = {
    "price": (1e-3, 1e-4, 1e-5, 1e-6),
    "delta": (1e-2, 1e-3, 1e-4, 1e-5),
    "gamma": (1e-1, 1e-2, 1e-3),
    "boundary": (1e-2, 1e-3, 1e-4),
}
LCS, CRANK_NICOLSON = "the LCS method of lines", "Crank-Nicolson"
EVEN = 1.1  # times as fast: less is called even
TIME_ERRORS = {"price": 1e-6, "delta": 1e-5}  # at which time steps are compared on one grid
MESHES = ("square-root", "uniform", "adaptive")


def _labels(methods: Sequence[Method]) -> set[str]:
    extrapolated = {method.label + EXTRAPOLATED for method in methods if method in EXTRAPOLATED_METHODS}
    return {method.label for method in methods} | extrapolated


FAMILIES = {LCS: _labels(LCS_METHODS), CRANK_NICOLSON: _labels(CRANK_NICOLSON_METHODS)}


class Best(NamedTuple):
    """The method of a family that needs the least for an error, and what it needs."""

    method: str | None
    cost: float | None


class Verdict(NamedTuple):
    """Who reaches an error of one output first; a cost of None where a family does not reach it at all."""

    output: str
    rmse: float
    lcs: Best
    crank_nicolson: Best

    @property
    def ratio(self) -> float | None:
        """The cost of Crank-Nicolson over that of the method of lines."""
        first, second = self.lcs.cost, self.crank_nicolson.cost
        return None if first is None or second is None else second / first

    def words(self) -> str:
        """Return who is how many times as fast."""
        at, ratio = f"at {self.rmse:.0e}", self.ratio
        if ratio is None:
            there = [
                name for name, one in zip(FAMILIES, (self.lcs, self.crank_nicolson), strict=True) if one.cost
            ]
            return f"{at} only {there[0]} gets there" if there else f"{at} neither gets there"
        if 1.0 / EVEN <= ratio <= EVEN:
            return f"{at} both are even"
        return f"{at} {LCS if ratio > 1.0 else CRANK_NICOLSON} is {max(ratio, 1.0 / ratio):.2g} times as fast"


def verdicts(runs: Sequence[Run], cost: Callable[[Run], float]) -> tuple[Verdict, ...]:
    """Compare the best of both families for every output and error."""
    return tuple(
        Verdict(output, level, *(best(runs, output, level, family, cost) for family in FAMILIES.values()))
        for output, levels in LEVELS.items()
        for level in levels
    )


def best(
    runs: Sequence[Run], output: str, level: float, methods: Collection[str], cost: Callable[[Run], float]
) -> Best:
    """Return the cheapest of the methods for an error, each by its own lower envelope."""
    found = [Best(None, None)]
    for method in sorted(methods):
        points = [Point(run.errors[output].rmse, cost(run)) for run in runs if run.method == method]
        needed = time_at(points, level)
        if needed is not None and (found[0].cost is None or needed < found[0].cost):
            found[0] = Best(method, needed)
    return found[0]


def winner_sentences(found: Sequence[Verdict]) -> list[str]:
    """Say for every output who wins at which error."""
    words = {output: [one.words() for one in found if one.output == output] for output in LEVELS}
    return [f"{output.capitalize()}: {'; '.join(parts)}." for output, parts in words.items()]


def mesh_sentence(refinements: Sequence[Refinement], scheme: str, output: str) -> str:
    """Say how many implicit solves a scheme needs with each kind of steps, for an error in time on one grid."""
    levels, words = {one.method: one.levels for one in refinements}, []
    for mesh in MESHES:
        points = [Point(one.errors[output].rmse, one.work) for one in levels[f"{scheme}, {mesh} steps"]]
        solves = time_at(points, TIME_ERRORS[output])
        words.append(f"{'more than were tried' if solves is None else f'{solves:.0f}'} with {mesh} steps")
    needs = f"{scheme[0].upper()}{scheme[1:]} needs this many solves"
    return f"{needs} for an error of {TIME_ERRORS[output]:.0e} of {output}: {', '.join(words)}."


def projection_sentences(
    solvers: Sequence[SolverRun], runs: Sequence[Run], refinements: Sequence[Refinement]
) -> list[str]:
    """Say what explicit projection saves in a step, and what it costs for an accuracy."""
    finest = max(run.intervals for run in solvers)
    cost = {run.solver: run.microseconds for run in solvers if run.intervals == finest}
    exact, projected = ("Crank-Nicolson, uniform steps" + end for end in ("", ", explicit projection"))
    orders = {one.method: one.order("price") for one in refinements}
    sentences = [
        f"On {finest} cells one step costs {cost[ELIMINATION]:.2g} microseconds by elimination, which solves the "
        f"complementarity problem exactly, and {cost[PROJECTION]:.2g} by a linear solve and the maximum.",
        f"The order of Crank-Nicolson's price with equal steps is {orders[projected]:.1f} with projection and "
        f"{orders[exact]:.1f} with the exact problem.",
    ]
    for level in LEVELS["price"]:
        first, second = (
            best(runs, "price", level, {label}, lambda run: run.milliseconds).cost
            for label in (exact, projected)
        )
        if first and second:
            sentences.append(
                f"For a price error of {level:.0e} projection takes {second / first:.2g} times as long."
            )
    return sentences


def relaxation_sentences(runs: Sequence[RelaxationRun], solvers: Sequence[SolverRun]) -> list[str]:
    """Say with which parameter PSOR needs the fewest sweeps, and how far it then is from elimination."""
    elimination = {run.intervals: run.microseconds for run in solvers if run.solver == ELIMINATION}
    sentences = []
    for intervals in sorted({run.intervals for run in runs}):
        on_grid = [run for run in runs if run.intervals == intervals]
        chosen = min(on_grid, key=lambda run: run.sweeps)
        sentences.append(
            f"PSOR needs the fewest sweeps on {intervals} cells, {chosen.sweeps:.0f} a step, with the relaxation "
            f"parameter {chosen.relaxation:g}."
        )
        if intervals in elimination:
            ratio = chosen.microseconds / elimination[intervals]
            sentences.append(f"It then takes {ratio:.2g} times as long as elimination.")
    return sentences
