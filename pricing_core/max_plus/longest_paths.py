"""The largest weights of paths from weighted starts: the least solution of x = A x + b, by sweeps over the arcs."""

import numpy as np

from pricing_core.max_plus.arcs import Arcs, arcs_of, rounding_of
from pricing_core.max_plus.matrices import EPSILON, TOP, Numbers, alike, as_square, as_vector
from pricing_core.max_plus.spectrum import mean_of_circuits


def least_solution(A: object, b: object, *, tolerance: float | None = None) -> Numbers:
    """Return the least x with x = A x + b, which is A* b: x_i is the largest of A_ij + x_j and b_i.

    Where a circuit of positive weight is heard that itself hears of b, x is top. The solution is the only
    one if every circuit has a negative weight.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    b : array_like, shape (n,)
        Top is allowed.
    tolerance : float, optional
        A circuit diverges if its mean weight is larger. Default: 0 for exact data, and for floats what
        rounding may make of zero, n max |A| 2**-52.

    Raises
    ------
    InvalidInputError
        A is not square, b has another length, an entry is NaN, or one of A is +inf.

    Notes
    -----
    Cost: Howard's iteration, and at most O(m) for each arc of the longest of the best paths; only arcs out of
    nodes that have just changed are looked at (Bellman 1958, Ford 1956).
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.17.

    Examples
    --------
    >>> least_solution([[-1.0, 2.0], [-np.inf, -3.0]], [0.0, 5.0])
    array([7., 5.])
    """
    matrix = as_square("A", A, top=False)
    matrix, start = alike(matrix, as_vector("b", b, matrix.shape[0]))
    graph = arcs_of(matrix)
    allowed = rounding_of(graph) if tolerance is None else tolerance
    rising = mean_of_circuits(graph).ratio > allowed
    heard = graph.reached_from(np.asarray(start != EPSILON))
    endless = graph.reached_from((rising & heard) | np.asarray(start == TOP))
    start = np.where(endless, EPSILON, start)
    found = longest_paths(graph.among(~endless), start, graph.size * allowed)
    return np.where(endless, TOP, found)


def longest_paths(graph: Arcs, start: Numbers, tolerance: float) -> Numbers:
    """Return A* start for a graph without circuits heavier than the tolerance, shape (n,).

    A path is longer than another if it weighs more by the tolerance: so that circuits of weight zero, rounded,
    are left.
    """
    found = start.copy()
    waiting = np.flatnonzero(start != EPSILON)
    while waiting.size:
        arcs = graph.out_of(waiting)
        head, reached = graph.head[arcs], graph.weight[arcs] + found[graph.tail[arcs]]
        longer = np.asarray(reached > found[head] + tolerance)
        np.maximum.at(found, head[longer], reached[longer])
        waiting = np.unique(head[longer])
    return found
