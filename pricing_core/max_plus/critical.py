"""The critical graph: the circuits whose mean is the largest, and its cyclicity."""

from dataclasses import dataclass
from math import gcd, lcm

import numpy as np

from pricing_core.max_plus.arcs import Arcs, arcs_of, rounding_of
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.matrices import Scalar, as_square
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
        rounding may do. Circuits that tie in theory may be parted by it: `exact` data decide.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.

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
    largest = solution.ratio.max()
    own = np.asarray((solution.ratio >= largest - 2 * solution.tolerance) & (solution.ratio > -np.inf))
    critical = critical_arcs(graph.among(own), solution, tolerance)
    components = critical_components(critical)
    pairs = sorted(zip(critical.tail.tolist(), critical.head.tolist(), strict=True))
    return CriticalGraph(
        plain(largest), tuple(pairs), components, tuple(_cyclicity(critical, nodes) for nodes in components)
    )


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


def critical_arcs(graph: Arcs, solution: HowardSolution, tolerance: float | None = None) -> Arcs:
    """Return those arcs that lie on circuits of the largest mean of their class."""
    inner = graph.inside_classes()
    missing = (
        solution.ratio[inner.head]
        + solution.potential[inner.head]
        - inner.weight
        - solution.potential[inner.tail]
    )
    allowed = 2 * solution.tolerance + rounding_of(graph) if tolerance is None else tolerance
    return inner.only(np.asarray(missing <= allowed)).inside_classes()


def critical_components(critical: Arcs) -> tuple[tuple[int, ...], ...]:
    """Return the nodes of each component, in the order of their first nodes."""
    label = critical.classes()
    nodes = np.unique(critical.head)
    order = nodes[np.argsort(label[nodes], kind="stable")]
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return tuple(sorted(tuple(part.tolist()) for part in parts if part.size))


def _cyclicity(critical: Arcs, nodes: tuple[int, ...]) -> int:
    """Return the greatest common divisor of circuit lengths: of level(tail) + 1 - level(head) over the arcs."""
    inside = np.zeros(critical.size, dtype=np.bool_)
    inside[list(nodes)] = True
    arcs = critical.among(inside)
    level = np.full(critical.size, -1)
    level[nodes[0]] = depth = 0
    waiting = np.array([nodes[0]])
    while waiting.size:
        heads = arcs.head[arcs.out_of(waiting)]
        waiting = np.unique(heads[level[heads] < 0])
        depth += 1
        level[waiting] = depth
    return gcd(*np.unique(np.abs(level[arcs.tail] + 1 - level[arcs.head])).tolist())
