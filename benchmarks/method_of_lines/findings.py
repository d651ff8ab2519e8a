"""What the comparison of methods found, in sentences that are computed from the measurements."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

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
from benchmarks.method_of_lines.profiles import Profile
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

    method: str
    cost: float


class Verdict(NamedTuple):
    """Who reaches an error of one output first; None where a family does not reach it at all."""

    output: str
    rmse: float
    lcs: Best | None
    crank_nicolson: Best | None

    @property
    def ratio(self) -> float | None:
        """The cost of Crank-Nicolson over that of the method of lines."""
        if self.lcs is None or self.crank_nicolson is None:
            return None
        return self.crank_nicolson.cost / self.lcs.cost


def verdicts(runs: Sequence[Run], cost: Callable[[Run], float]) -> tuple[Verdict, ...]:
    """Compare the best of both families for every output and error."""
    return tuple(
        Verdict(output, level, *(best(runs, output, level, family, cost) for family in FAMILIES.values()))
        for output, levels in LEVELS.items()
        for level in levels
    )


def best(
    runs: Sequence[Run], output: str, level: float, methods: Collection[str], cost: Callable[[Run], float]
) -> Best | None:
    """Return the cheapest of the methods for an error, each by its own lower envelope."""
    candidates = []
    for method in sorted(methods):
        points = [Point(run.errors[output].rmse, cost(run)) for run in runs if run.method == method]
        needed = time_at(points, level)
        if needed is not None:
            candidates.append(Best(method, needed))
    return min(candidates, key=lambda candidate: candidate.cost, default=None)


def winner_sentences(found: Sequence[Verdict]) -> list[str]:
    """Say for every output who wins at which error."""
    return [
        f"{output.capitalize()}: "
        + "; ".join(_verdict_words(verdict) for verdict in found if verdict.output == output)
        + "."
        for output in LEVELS
    ]


def _verdict_words(verdict: Verdict) -> str:
    at, ratio = f"at {verdict.rmse:.0e}", verdict.ratio
    if ratio is None:
        if verdict.lcs is None and verdict.crank_nicolson is None:
            return f"{at} neither gets there"
        return f"{at} only {LCS if verdict.lcs is not None else CRANK_NICOLSON} gets there"
    if 1.0 / EVEN <= ratio <= EVEN:
        return f"{at} both are even"
    name = LCS if ratio > 1.0 else CRANK_NICOLSON
    return f"{at} {name} is {max(ratio, 1.0 / ratio):.2g} times as fast"


def mesh_sentence(refinements: Sequence[Refinement], scheme: str, output: str) -> str:
    """Say how many implicit solves a scheme needs with each kind of steps, for an error in time on one grid."""
    level, name = TIME_ERRORS[output], scheme[0].upper() + scheme[1:]
    needed = {}
    for mesh in MESHES:
        (levels,) = (one.levels for one in refinements if one.method == f"{scheme}, {mesh} steps")
        needed[mesh] = time_at([Point(one.errors[output].rmse, one.work) for one in levels], level)
    words = (
        f"{'more than were tried' if solves is None else f'{solves:.0f}'} with {mesh} steps"
        for mesh, solves in needed.items()
    )
    if all(solves is None for solves in needed.values()):
        return f"{name} needs more solves than were tried for an error of {level:.0e} of {output}."
    return f"{name} needs this many solves for an error of {level:.0e} of {output}: {', '.join(words)}."


def profile_sentence(profiles: Sequence[Profile], what: str) -> str:
    """List the root mean square of every profile."""
    sizes = (f"{one.label} {np.sqrt(np.mean(np.square(one.y))):.1e}" for one in profiles)
    return f"Root mean square of the error of {what}: {'; '.join(sizes)}."


def projection_sentences(
    solvers: Sequence[SolverRun], runs: Sequence[Run], refinements: Sequence[Refinement]
) -> list[str]:
    """Say what explicit projection saves in a step, and what it costs for an accuracy."""
    finest = max(run.intervals for run in solvers)
    cost = {run.solver: run.microseconds for run in solvers if run.intervals == finest}
    sentences = [
        f"On {finest} cells one step costs {cost[ELIMINATION]:.2g} microseconds by elimination, which solves the "
        f"complementarity problem exactly, and {cost[PROJECTION]:.2g} by a linear solve and the maximum."
    ]
    exact, projected = ("Crank-Nicolson, uniform steps" + end for end in ("", ", explicit projection"))
    orders = {one.method: one.order("price") for one in refinements}
    sentences.append(
        f"The order of Crank-Nicolson's price with equal steps is {orders[projected]:.1f} with projection and "
        f"{orders[exact]:.1f} with the exact problem."
    )
    for level in LEVELS["price"]:
        times = [
            best(runs, "price", level, {label}, lambda run: run.milliseconds) for label in (exact, projected)
        ]
        if times[0] is not None and times[1] is not None:
            ratio = times[1].cost / times[0].cost
            sentences.append(f"For a price error of {level:.0e} projection takes {ratio:.2g} times as long.")
    return sentences


def relaxation_sentences(runs: Sequence[RelaxationRun], solvers: Sequence[SolverRun]) -> list[str]:
    """Say with which parameter PSOR needs the fewest sweeps, and how far it then is from elimination."""
    elimination = {run.intervals: run.microseconds for run in solvers if run.solver == ELIMINATION}
    best_at, against = [], []
    for intervals in sorted({run.intervals for run in runs}):
        on_grid = [run for run in runs if run.intervals == intervals]
        chosen = min(on_grid, key=lambda run: run.sweeps)
        plain = min(on_grid, key=lambda run: abs(run.relaxation - 1.0))
        best_at.append(
            f"{chosen.relaxation:g} on {intervals} cells ({chosen.sweeps:.0f} sweeps a step; {plain.sweeps:.0f} "
            f"with {plain.relaxation:g})"
        )
        if intervals in elimination:
            ratio = chosen.microseconds / elimination[intervals]
            against.append(f"On {intervals} cells it then takes {ratio:.2g} times as long as elimination.")
    first = f"PSOR needs the fewest sweeps with the relaxation parameter {', '.join(best_at)}."
    return [first, *against]
