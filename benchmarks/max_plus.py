"""The largest circuit mean of a graph: Howard's policy iteration or Karp's algorithm, and how far does each scale?"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.sparse import csr_array

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table
from benchmarks.reporting.scaling import exponent
from pricing_core.max_plus import eigenvalue
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.matrices import rows_of
from pricing_core.max_plus.spectrum import mean_of_circuits

Kind: TypeAlias = Literal["hidden ring", "random", "long ring"]
METHODS = ("howard", "karp")
KINDS: tuple[Kind, ...] = ("hidden ring", "random", "long ring")
DEGREE = 10  # arcs into a node, about
HIDDEN_MEAN = 7.25


@dataclass(frozen=True, slots=True)
class Sizes:
    """Numbers of nodes; Karp's algorithm keeps a table of their square."""

    note: str
    howard: tuple[int, ...]
    karp: tuple[int, ...]
    turns: int


FULL = Sizes("", (100, 1000, 10_000, 100_000), (100, 300, 1000, 3000), 2)
QUICK = Sizes("A quick run on small graphs: it shows that everything works.", (100, 1000), (100, 300), 1)


class MeanRun(NamedTuple):
    """One method on one graph; `error` is the distance from the hidden mean, None where none is hidden."""

    kind: Kind
    method: str
    nodes: int
    arcs: int
    seconds: float
    iterations: int | None
    value: float
    error: float | None


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes small graphs."""
    sizes = QUICK if quick else FULL
    runs = tuple(one for kind in KINDS for one in measure(kind, sizes))
    text = "\n\n".join(filter(None, (sizes.note, *findings(runs))))
    lines = {
        f"{method}, {kind}": [
            (one.nodes, one.seconds) for one in runs if (one.kind, one.method) == (kind, method)
        ]
        for kind in KINDS
        for method in METHODS
    }
    powers = [f"{name} {exponent(pairs, 3):.1f}" for name, pairs in lines.items()]
    text += f"\n\nThe time grows with the nodes to the power of: {', '.join(powers)}."
    return Report(
        name="max-plus",
        title="The largest circuit mean by Howard and by Karp",
        question="How long does the eigenvalue of a sparse max-plus matrix take, by size and by method?",
        sections=(
            Section("Time by size", text, figures={"time": curves({"": lines}, "nodes", "seconds")}),
            Section("The graphs", GRAPHS),
            Section("All measurements", "", (table("runs", runs),)),
        ),
    )


GRAPHS = f"""Hidden ring: about {DEGREE} arcs into each node at random and a ring through all nodes; weights are
{HIDDEN_MEAN} - s + p_i - p_j with whole numbers s >= 0, zero on the ring only, and p up to 1000 in size. The answer
is {HIDDEN_MEAN} by construction, without rounding, and cannot be seen from the weights.

Random: the same arcs with normal weights. Long ring: a ring and chords that skip one node, normal weights: its
paths are as long as the graph is large. There both methods are held against each other."""


def graph_of(kind: Kind, nodes: int) -> csr_array:
    """Return the matrix of one graph, the same at every call."""
    random = np.random.default_rng(nodes)
    number = np.arange(nodes)
    if kind == "long ring":
        head, tail = np.concatenate([np.roll(number, -1), np.roll(number, -2)]), np.tile(number, 2)
        return rows_of((nodes, nodes), head, tail, random.normal(size=head.size))
    order = random.permutation(nodes)
    head = np.concatenate([np.roll(order, -1), random.integers(0, nodes, (DEGREE - 1) * nodes)])
    tail = np.concatenate([order, random.integers(0, nodes, (DEGREE - 1) * nodes)])
    if kind == "random":
        return rows_of((nodes, nodes), head, tail, random.normal(size=head.size))
    slack = np.concatenate([np.zeros(nodes), random.integers(1, 100, head.size - nodes)])
    potential = random.integers(-1000, 1001, nodes)
    return rows_of((nodes, nodes), head, tail, HIDDEN_MEAN - slack + potential[head] - potential[tail])


def measure(kind: Kind, sizes: Sizes) -> list[MeanRun]:
    """Time both methods on the graphs of one kind."""
    pairs: list[tuple[Literal["howard", "karp"], int]] = [("howard", n) for n in sizes.howard]
    pairs += [("karp", n) for n in sizes.karp]
    found = []
    for method, nodes in pairs:
        A = graph_of(kind, nodes)
        call = partial(eigenvalue, A, method=method)
        (seconds,) = least_seconds([Task((call,))], sizes.turns)
        value = float(call())
        iterations = mean_of_circuits(arcs_of(A)).iterations if method == "howard" else None
        error = abs(value - HIDDEN_MEAN) if kind == "hidden ring" else None
        found.append(MeanRun(kind, method, nodes, int(A.nnz), seconds, iterations, value, error))
    return found


def findings(runs: Sequence[MeanRun]) -> list[str]:
    """Return what the measurements say."""
    largest = max(runs, key=lambda r: (r.method == "howard", r.arcs))
    seconds = {r.kind: r.seconds for r in runs if r.method == "howard" and r.nodes == largest.nodes}
    times = ", ".join(f"{seconds[kind]:.2g} s ({kind})" for kind in KINDS)
    errors = max(r.error for r in runs if r.error is not None)
    by_key = {(r.kind, r.method, r.nodes): r for r in runs}
    both = [(r, by_key.get((r.kind, "karp", r.nodes))) for r in runs if r.method == "howard"]
    apart = max(abs(a.value - b.value) for a, b in both if b is not None)
    first, second = max(((a, b) for a, b in both if b is not None), key=lambda pair: pair[0].nodes)
    return [
        f"Howard's iteration takes {times} for {largest.nodes} nodes and up to {largest.arcs} arcs, with "
        f"at most {max(r.iterations or 0 for r in runs)} evaluations of a policy.",
        f"At {first.nodes} nodes ({first.kind}) it is {second.seconds / first.seconds:.0f} times faster than Karp's "
        "algorithm, which takes time as nodes times arcs and memory as nodes squared.",
        f"The hidden mean is found to {errors:.1g}; where both methods ran they differ by at most {apart:.1g}.",
    ]
