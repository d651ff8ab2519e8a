"""The precedence graph of a matrix: an arc from j to i of weight A_ij wherever A_ij is not epsilon."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.matrices import EPSILON, MaxPlusMatrix, Numbers

IntVector = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Arcs:
    """The arcs of a graph with nodes 0 ... size - 1, sorted by head and then by tail.

    An arc from j to i stands for x_i(k+1) >= weight + x_j(k): the head waits for the tail.
    """

    size: int
    head: IntVector  # (m,): i, the row
    tail: IntVector  # (m,): j, the column
    weight: Numbers  # (m,)

    @cached_property
    def _first(self) -> IntVector:
        """The first arc of every head that has one."""
        return first_of_runs(self.head)

    @cached_property
    def by_tail(self) -> tuple[IntVector, IntVector]:
        """The arcs in the order of their tails, and where each tail's begin."""
        order = np.argsort(self.tail, kind="stable")
        return order, np.searchsorted(self.tail[order], np.arange(self.size + 1))

    def out_of(self, nodes: IntVector) -> IntVector:
        """Return the indices of the arcs that begin at these nodes; the cost is their number."""
        order, start = self.by_tail
        count = start[nodes + 1] - start[nodes]
        ends = np.cumsum(count)
        first = np.repeat(start[nodes] - (ends - count), count)
        return np.asarray(order[first + np.arange(first.size)])

    def largest_by_head(self, values: Numbers) -> Numbers:
        """Return for every node the largest value of the arcs into it, epsilon where there is none, shape (n,)."""
        largest = np.full(self.size, EPSILON, dtype=values.dtype)
        if self.head.size:
            largest[self.head[self._first]] = np.maximum.reduceat(values, self._first)
        return largest

    def image(self, x: Numbers) -> Numbers:
        """Return A x for a vector without top, shape (n,)."""
        return self.largest_by_head(self.weight + x[self.tail])

    def classes(self) -> IntVector:
        """Return a label for each node: two have the same if each can be reached from the other, shape (n,)."""
        start = np.searchsorted(self.head, np.arange(self.size + 1))
        graph = graph_of_rows(start, self.tail)
        return connected_components(graph, directed=True, connection="strong")[1].astype(np.int64)

    def inside_classes(self) -> Arcs:
        """Return the graph of those arcs that lie on some circuit."""
        label = self.classes()
        return self.only(label[self.head] == label[self.tail])

    def only(self, kept: BoolVector) -> Arcs:
        """Return the graph with all nodes and these arcs."""
        return Arcs(self.size, self.head[kept], self.tail[kept], self.weight[kept])

    def among(self, nodes: BoolVector) -> Arcs:
        """Return the graph with all nodes and the arcs between these."""
        return self.only(nodes[self.head] & nodes[self.tail])

    def with_weights(self, weight: Numbers) -> Arcs:
        """Return the graph with other weights."""
        return replace(self, weight=weight)

    def reversed(self) -> Arcs:
        """Return the graph with every arc turned round."""
        order = np.lexsort((self.head, self.tail))
        return Arcs(self.size, self.tail[order], self.head[order], self.weight[order])

    def reached_from(self, start: BoolVector) -> BoolVector:
        """Return which nodes a path leads to from one of `start`, themselves among them, shape (n,)."""
        reached = start.copy()
        waiting = np.flatnonzero(start)
        while waiting.size:
            heads = self.head[self.out_of(waiting)]
            waiting = np.unique(heads[~reached[heads]])
            reached[waiting] = True
        return reached


def first_of_runs(values: IntVector) -> IntVector:
    """Return where runs of equal numbers begin.

    Examples
    --------
    >>> first_of_runs(np.array([4, 4, 7, 7, 7, 5]))
    array([0, 2, 5])
    """
    first = np.ones(values.size, dtype=np.bool_)
    np.not_equal(values[1:], values[:-1], out=first[1:])
    return np.flatnonzero(first).astype(np.int64, copy=False)


def graph_of_rows(start: IntVector, neighbours: IntVector) -> csr_array:
    """Return a graph for SciPy, as it wants it: those of node i are neighbours[start[i] : start[i + 1]]."""
    arcs = np.ones(neighbours.size), neighbours.astype(np.int32), start.astype(np.int32)
    graph = csr_array(arcs, shape=(start.size - 1, start.size - 1))
    graph.sum_duplicates()  # connected_components does not return where arcs are parallel
    return graph


def arcs_of(A: MaxPlusMatrix) -> Arcs:
    """Return the precedence graph of a square matrix without top.

    Examples
    --------
    >>> graph = arcs_of(np.array([[3.0, -np.inf], [2.0, 4.0]]))
    >>> graph.head, graph.tail, graph.weight
    (array([0, 1, 1]), array([0, 0, 1]), array([3., 2., 4.]))
    """
    n = A.shape[0]
    if isinstance(A, csr_array):
        head = np.repeat(np.arange(n), np.diff(A.indptr))
        return Arcs(n, head, A.indices.astype(np.int64), np.asarray(A.data))
    head, tail = np.nonzero(A != EPSILON)
    return Arcs(n, head, tail, A[head, tail])
