"""A graph whose arcs have weights of at most zero, and the potential that makes it so; the longest paths in it."""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.arcs import Arcs, IntVector
from pricing_core.max_plus.class_order import longest_between_classes
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.matrices import EPSILON, Numbers, in_range, is_exact, zero_like
from pricing_core.max_plus.policies import follow


def normal_form(
    graph: Arcs, solution: HowardSolution, rate: Numbers, kept: BoolVector
) -> tuple[Arcs, Numbers]:
    """Return the kept arcs with weight - rate_head + p_tail - p_head <= 0, and p.

    The weight of a path from j to i is p_j - p_i more than with weight - rate, that of a circuit the same. No sum of
    such weights loses digits, as all of them have one sign.

    Parameters
    ----------
    graph : Arcs
        n nodes, m arcs.
    solution : HowardSolution
        The solution for this graph, with one unit of holding on each arc.
    rate : array, shape (n,)
        For each node at least the ratio of its class.
    kept : array of bool, shape (m,)
    """
    part, inner = graph.only(kept), solution.inner[kept]
    pace, p = rate[part.head], solution.potential
    zero = zero_like(graph.weight)
    between = part.weight - pace + (p[part.tail] - p[part.head])
    weight = np.where(inner, solution.reduced[kept] + (solution.ratio[part.head] - pace), between)
    crossing = part.with_weights(weight).only(~inner)
    later = longest_between_classes(crossing, solution.label, np.full(solution.label.max() + 1, zero))
    later = later[solution.label]
    weight = weight + (later[part.tail] - later[part.head])
    weight[weight > 0] = zero
    return part.with_weights(weight), p + later


def longest_in_normal_form(graph: Arcs, start: Numbers) -> tuple[Numbers, IntVector]:
    """Return the largest weights of paths from weighted starts, where no weight of an arc is above zero; shape (n,).

    Beside them the last arc of a best path to each node, -1 where it begins there or there is none.

    Notes
    -----
    Dijkstra 1959: the node with the largest value that is left cannot gain. Cost: O(m log m).

    Examples
    --------
    >>> ring = Arcs(2, np.array([0, 1]), np.array([1, 0]), np.array([-1.0, 0.0]))
    >>> longest_in_normal_form(ring, np.array([0.0, -np.inf]))
    (array([0., 0.]), array([-1,  1]))
    """
    arcs = graph.out_of(np.arange(graph.size))
    heads, weights = graph.head[arcs].tolist(), graph.weight[arcs].tolist()
    first = np.searchsorted(graph.tail[arcs], np.arange(graph.size + 1)).tolist()
    found = start.tolist()
    waiting = [(-value, node) for node, value in enumerate(found) if value != EPSILON]
    heapify(waiting)
    done, last = [False] * graph.size, [-1] * graph.size
    while waiting:
        value, node = heappop(waiting)
        if done[node]:
            continue
        done[node] = True
        for arc in range(first[node], first[node + 1]):
            reached = weights[arc] - value
            if reached > found[heads[arc]]:
                found[heads[arc]], last[heads[arc]] = reached, arc
                heappush(waiting, (-reached, heads[arc]))
    by_arc = np.append(arcs, -1)
    return np.array(found, dtype=start.dtype), by_arc[np.array(last)]


def longest_paths_at(
    graph: Arcs, solution: HowardSolution, rate: Numbers, kept: BoolVector, start: BoolVector
) -> Numbers:
    """Return largest weights of paths from the nodes of `start` along the kept arcs, with weight - rate; shape (n,).

    They begin with a potential. The largest of them is 0, and the others are as exact as their distance from it is:
    what their best paths miss is summed up and added.
    """
    normal, p = normal_form(graph, solution, rate, kept)
    zero = np.full(graph.size, EPSILON, dtype=graph.weight.dtype)
    zero[start] = zero_like(zero)
    found, arc = longest_in_normal_form(normal, zero)
    found = np.asarray(found + p)
    found = np.asarray(found - found.max())
    if is_exact(found):
        return in_range(found)
    on = np.flatnonzero(arc >= 0)
    before, missed = np.arange(graph.size), np.zeros(graph.size)
    part = graph.only(kept)
    before[on] = part.tail[arc[on]]
    missed[on] = part.weight[arc[on]] - rate[on] + (found[before[on]] - found[on])
    found = found + follow(before, missed)[1]
    return in_range(np.asarray(found - found.max()))
