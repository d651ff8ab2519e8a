"""The largest weights of paths from weighted starts: the least solution of x = A x + b, by sweeps over the arcs."""

from __future__ import annotations

import numpy as np

from pricing_core.max_plus.arcs import Arcs, arcs_of
from pricing_core.max_plus.divergence import diverging
from pricing_core.max_plus.matrices import (
    EPSILON,
    TOP,
    Numbers,
    alike,
    as_square,
    as_vector,
    in_range,
    is_exact,
    zero_like,
)
from pricing_core.max_plus.scalars import UNIT, as_tolerance


def least_solution(A: object, b: object, *, tolerance: float | None = None) -> Numbers:
    """Return the least x with x = A x + b, which is A* b: x_i is the largest of A_ij + x_j and b_i.

    Where a path from b leads through a circuit of positive weight, x is top. The solution is the only
    one if every circuit has a negative weight.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    b : array_like, shape (n,)
        Top is allowed.
    tolerance : float, optional
        A circuit diverges if its mean weight is larger. Default: 0 for exact data, and for floats what rounding
        may make of a circuit of weight zero, n 2**-52 times the mean size of its own weights.

    Raises
    ------
    InvalidInputError
        A is not square, b has another length, an entry is NaN, or one of A is +inf; `tolerance` is no
        number >= 0.
    NumericalError
        A sum is beyond 1e150 in size.

    Notes
    -----
    Cost: Howard's iteration, and at most O(m) for each arc of the longest of the best paths; only arcs out of
    nodes that have just changed are looked at (Bellman 1958, Ford 1956). Each sum is rounded by its own size.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.17.

    Examples
    --------
    >>> least_solution([[-1.0, 2.0], [-np.inf, -3.0]], [0.0, 5.0])
    array([7., 5.])
    """
    matrix = as_square("A", A, top=False)
    matrix, start = alike(matrix, as_vector("b", b, matrix.shape[0]))
    graph = arcs_of(matrix)
    rising = diverging(graph, tolerance=as_tolerance("tolerance", tolerance))
    reached = graph.reached_from(np.asarray(start != EPSILON))
    endless = graph.reached_from((rising & reached) | np.asarray(start == TOP))
    start = np.where(endless, EPSILON, start)
    found = longest_paths(graph.among(~endless), start)
    return np.where(endless, TOP, in_range(found))


def longest_paths(graph: Arcs, start: Numbers) -> Numbers:
    """Return A* start for a graph without circuits of positive weight but for rounding, shape (n,).

    Notes
    -----
    No best path has as many arcs as there are nodes: after so many sweeps only rounding could still gain. Inside
    classes, where it could run round, a gain counts if it is larger than the rounding of the sum that it comes from.
    """
    found = start.copy()
    label = graph.classes()
    unit = zero_like(start) if is_exact(start) else UNIT
    circling = np.full(graph.head.size, zero_like(start))
    circling[label[graph.head] == label[graph.tail]] = unit
    waiting = np.flatnonzero(start != EPSILON)
    for _ in range(graph.size):
        if not waiting.size:
            break
        arcs = graph.out_of(waiting)
        head, weight, before = graph.head[arcs], graph.weight[arcs], found[graph.tail[arcs]]
        reached = weight + before
        allowed = circling[arcs] * (np.abs(weight) + np.abs(before))
        longer = np.asarray(reached > found[head] + allowed)
        np.maximum.at(found, head[longer], reached[longer])
        waiting = np.unique(head[longer])
    return found
