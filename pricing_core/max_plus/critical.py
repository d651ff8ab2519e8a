"""The critical graph: the circuits whose mean is the largest, and its cyclicity."""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.arcs import Arcs, IntVector, arcs_of, first_of_runs
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.matrices import EPSILON, Scalar, as_square
from pricing_core.max_plus.scalars import as_tolerance
from pricing_core.max_plus.spectrum import mean_of_circuits, plain


@dataclass(frozen=True, slots=True)
class CriticalGraph:
    """The nodes and arcs on circuits whose mean weight is the eigenvalue.

    Parameters
    ----------
    eigenvalue : float or Fraction
        -inf where there is no circuit.
    arcs : tuple of (int, int)
        (tail, head): (j, i) for the entry A_ij.
    components : tuple of tuples of int
        The nodes of each strongly connected component; sorted.
    cyclicities : tuple of int
        For each component the greatest common divisor of the lengths of its circuits.
    """

    eigenvalue: Scalar
    arcs: tuple[tuple[int, int], ...]
    components: tuple[tuple[int, ...], ...]
    cyclicities: tuple[int, ...]

    @property
    def nodes(self) -> tuple[int, ...]:
        """All critical nodes, sorted."""
        return tuple(sorted(node for component in self.components for node in component))

    @property
    def cyclicity(self) -> int:
        """The least common multiple of the components' cyclicities; 1 where there is no circuit."""
        return lcm(*self.cyclicities)


def critical_graph(A: object, *, tolerance: float | None = None) -> CriticalGraph:
    """Find the circuits of the largest mean weight: the bottleneck that sets the pace.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    tolerance : float, optional
        By how much an arc of a critical circuit may miss equality. Default: 0 for an exact A, for floats what
        rounding may do to the arc's own weight and to the mean of its class. Circuits that tie in theory may be
        parted by it: `exact` data decide.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf; `tolerance` is no number >= 0.

    Notes
    -----
    With a potential x of Howard's iteration an arc is critical if A_ij + x_j = lambda + x_i and it lies on a
    circuit of such arcs. Cost: that of `eigenvalue`.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Definition 3.94.

    Examples
    --------
    >>> critical_graph([[3.0, 7.0], [2.0, 4.0]])
    CriticalGraph(eigenvalue=4.5, arcs=((0, 1), (1, 0)), components=((0, 1),), cyclicities=(2,))
    """
    graph = arcs_of(as_square("A", A, top=False))
    solution = mean_of_circuits(graph)
    return critical_graph_of(graph, solution, as_tolerance("tolerance", tolerance))


def cyclicity(A: object) -> int:
    """Return the cyclicity of the critical graph: the period of A^k - k lambda for irreducible A and large k.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.

    Notes
    -----
    1 where there is no circuit. Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.112.

    Examples
    --------
    >>> cyclicity([[2.0, 5.0], [3.0, 3.0]])
    2
    """
    return critical_graph(A).cyclicity


def critical_graph_of(graph: Arcs, solution: HowardSolution, tolerance: float | None = None) -> CriticalGraph:
    """Return the critical graph that Howard's solution shows; see `critical_graph`."""
    largest = (solution.ratio - solution.error).max()
    own = np.asarray((solution.ratio + solution.error >= largest) & (solution.ratio > EPSILON))
    critical = critical_arcs(graph, solution, own, tolerance)
    components = critical_components(critical)
    pairs = sorted(zip(critical.tail.tolist(), critical.head.tolist(), strict=True))
    return CriticalGraph(
        plain(solution.ratio.max()), tuple(pairs), components, _cyclicities(critical, components)
    )


def critical_arcs(
    graph: Arcs, solution: HowardSolution, own: BoolVector, tolerance: float | None = None
) -> Arcs:
    """Return those arcs that lie on circuits of the largest mean of their class, in the classes of `own` nodes."""
    allowed = solution.slack if tolerance is None else tolerance
    tight = solution.inner & own[graph.head] & (solution.reduced >= -allowed)
    return graph.only(np.asarray(tight)).inside_classes()


def critical_components(critical: Arcs) -> tuple[tuple[int, ...], ...]:
    """Return the nodes of each component, in the order of their first nodes."""
    label = critical.classes()
    nodes = np.unique(critical.head)
    order = nodes[np.argsort(label[nodes], kind="stable")]
    parts = np.split(order, first_of_runs(label[order])[1:])
    return tuple(sorted(tuple(part.tolist()) for part in parts if part.size))


def _cyclicities(critical: Arcs, components: tuple[tuple[int, ...], ...]) -> tuple[int, ...]:
    """Return for each component the greatest common divisor of level(tail) + 1 - level(head) over its arcs."""
    level = _levels(critical, np.array([nodes[0] for nodes in components], dtype=np.int64))
    component = np.empty(critical.size, dtype=np.int64)
    for k, nodes in enumerate(components):
        component[list(nodes)] = k
    order = np.argsort(component[critical.head], kind="stable")
    steps = np.abs(level[critical.tail] + 1 - level[critical.head])[order]
    first = first_of_runs(component[critical.head][order])
    return tuple(np.gcd.reduceat(steps, first).tolist()) if steps.size else ()


def _levels(graph: Arcs, start: IntVector) -> IntVector:
    """Return the least number of arcs from a start to each node, -1 where there is no path."""
    level = np.full(graph.size, -1)
    level[start] = depth = 0
    waiting = start
    while waiting.size:
        heads = graph.head[graph.out_of(waiting)]
        waiting = np.unique(heads[level[heads] < 0])
        depth += 1
        level[waiting] = depth
    return level
