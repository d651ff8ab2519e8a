"""Which method reaches an error of each output first, of the method of lines and of Crank-Nicolson."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from benchmarks.measuring.frontier import Point, time_at
from benchmarks.method_of_lines.accuracy_study import CRANK_NICOLSON_METHODS, EXTRAPOLATED, LCS_METHODS, Run

LEVELS: Mapping[str, tuple[float, ...]] = {
    "price": (1e-3, 1e-4, 1e-5, 1e-6),
    "delta": (1e-2, 1e-3, 1e-4, 1e-5),
    "gamma": (1e-1, 1e-2, 1e-3),
    "boundary": (1e-2, 1e-3, 1e-4),
}
LCS, CRANK_NICOLSON = "the LCS method of lines", "Crank-Nicolson"
FAMILIES = {LCS: LCS_METHODS, CRANK_NICOLSON: CRANK_NICOLSON_METHODS}
EVEN = 1.1  # times as fast: less is called even


class Best(NamedTuple):
    """The method of a family that needs the least for an error, and what it needs; None where none gets there."""

    method: str | None = None
    cost: float | None = None


class Verdict(NamedTuple):
    """The best of both families for an error of one output."""

    output: str
    rmse: float
    lcs: Best
    crank_nicolson: Best

    @property
    def ratio(self) -> float | None:
        """The cost of Crank-Nicolson over that of the method of lines."""
        first, second = self.lcs.cost, self.crank_nicolson.cost
        return second / first if first and second else None

    def words(self) -> str:
        """Return who is how many times as fast."""
        at, ratio = f"at {self.rmse:.0e}", self.ratio
        if ratio is None:
            there = LCS if self.lcs.cost else CRANK_NICOLSON if self.crank_nicolson.cost else None
            return f"{at} only {there} gets there" if there else f"{at} neither gets there"
        if 1.0 / EVEN <= ratio <= EVEN:
            return f"{at} both are even"
        return f"{at} {LCS if ratio > 1.0 else CRANK_NICOLSON} is {max(ratio, 1.0 / ratio):.2g} times as fast"


def verdicts(runs: Sequence[Run], cost: Callable[[Run], float]) -> list[Verdict]:
    """Compare the best of both families for every output and error."""
    return [
        Verdict(output, level, *(best(runs, output, level, family, cost) for family in FAMILIES))
        for output, levels in LEVELS.items()
        for level in levels
    ]


def best(runs: Sequence[Run], output: str, level: float, family: str, cost: Callable[[Run], float]) -> Best:
    """Return the cheapest method of a family for an error, each by its own lower envelope."""
    found = []
    for method in {run.method for run in runs} & _labels(family):
        points = [Point(run.errors[output].rmse, cost(run)) for run in runs if run.method == method]
        if (needed := time_at(points, level)) is not None:
            found.append((needed, method))
    return Best(*min(found)[::-1]) if found else Best()


def _labels(family: str) -> set[str]:
    labels = {method.label for method in FAMILIES[family]}
    return labels | {label + EXTRAPOLATED for label in labels}


def winner_sentences(found: Sequence[Verdict]) -> list[str]:
    """Say for every output who wins at which error."""
    words = {output: [one.words() for one in found if one.output == output] for output in LEVELS}
    return [f"{output.capitalize()}: {'; '.join(parts)}." for output, parts in words.items()]
