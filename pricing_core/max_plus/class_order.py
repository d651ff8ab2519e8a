"""Sweeps over the classes of a graph, each after all those from which a path leads to it."""

from __future__ import annotations

import numpy as np

from pricing_core.max_plus.arcs import Arcs, IntVector
from pricing_core.max_plus.matrices import Numbers, zero_like


def longest_between_classes(graph: Arcs, label: IntVector, start: Numbers) -> Numbers:
    """Return for each class the largest start + weights of arcs between classes on a way to it.

    Parameters
    ----------
    graph : Arcs
        Arcs inside a class are not looked at.
    label : array, shape (n,)
        `graph.classes()`
    start : array, shape (number of classes,)

    Notes
    -----
    A class is done when all arcs into it are. Cost: O(m), in as many steps as the longest chain of classes.

    Examples
    --------
    >>> chain = Arcs(3, np.array([1, 2]), np.array([0, 1]), np.array([4.0, -1.0]))
    >>> longest_between_classes(chain, np.arange(3), np.zeros(3))
    array([0., 4., 3.])
    """
    head, tail = label[graph.head], label[graph.tail]
    crossing = head != tail
    classes = Arcs(start.size, head[crossing], tail[crossing], graph.weight[crossing])
    found, left = start.copy(), np.bincount(classes.head, minlength=start.size)
    ready = np.flatnonzero(left == 0)
    while ready.size:
        arcs = classes.out_of(ready)
        heads = classes.head[arcs]
        np.maximum.at(found, heads, found[classes.tail[arcs]] + classes.weight[arcs])
        np.subtract.at(left, heads, 1)
        ready = np.unique(heads[left[heads] == 0])
    return found


def largest_upstream(graph: Arcs, label: IntVector, ratio: Numbers) -> Numbers:
    """Return for each node the largest ratio among the nodes from which a path leads to it, shape (n,).

    The nodes of a class have one ratio.
    """
    own = np.empty(label.max() + 1, dtype=ratio.dtype)
    own[label] = ratio
    unweighted = graph.with_weights(np.full(graph.head.size, zero_like(ratio)))
    return np.asarray(longest_between_classes(unweighted, label, own)[label])
