"""Karp's algorithm for the largest cycle mean of a strongly connected graph."""

from __future__ import annotations

import numpy as np

from pricing_core.max_plus.arcs import Arcs, first_of_runs
from pricing_core.max_plus.matrices import EPSILON, Numbers, Scalar, is_exact, zero_like


def karp(graph: Arcs) -> Scalar:
    """Find the largest mean weight of a circuit: max over v of min over k of (D_n(v) - D_k(v)) / (n - k).

    D_k(v) is the largest weight of a path of k arcs to v from one node of its class. Returns -inf where there
    is no circuit.

    Notes
    -----
    Cost: O(n m) time and O(n**2) memory for a class of n nodes and m arcs; no decision depends on rounding.
    Source: Karp 1978; Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 2.19.

    Examples
    --------
    >>> from pricing_core.max_plus.arcs import arcs_of
    >>> float(karp(arcs_of(np.array([[3.0, 7.0], [2.0, 4.0]]))))
    4.5
    """
    label = graph.classes()
    inner = graph.only(label[graph.head] == label[graph.tail])
    order = np.argsort(label[inner.head], kind="stable")
    first = first_of_runs(label[inner.head][order])
    means = [_mean_of_class(inner, members) for members in np.split(order, first[1:]) if members.size]
    return max(means, default=EPSILON)


def _mean_of_class(inner: Arcs, members: Numbers) -> Scalar:
    nodes, ends = np.unique(np.concatenate([inner.head[members], inner.tail[members]]), return_inverse=True)
    head, tail = np.split(ends, 2)
    graph, n = Arcs(nodes.size, head, tail, inner.weight[members]), nodes.size
    weights = np.full((n + 1, n), EPSILON, dtype=graph.weight.dtype)  # D_k(v)
    weights[0, 0] = zero_like(weights)
    for k in range(n):
        weights[k + 1] = graph.image(weights[k])
    ends_of_walks = np.flatnonzero(weights[n] != EPSILON)
    last, earlier = weights[n, ends_of_walks], weights[:n, ends_of_walks]
    counts = np.arange(n, 0, -1)
    if is_exact(weights):
        counts = counts.astype(object)
    means = (last - earlier) / counts[:, None]  # inf where there is no path of k arcs
    found: Scalar = means.min(axis=0).max()
    return found
