"""Growth rates: the cycle-time vector, and the largest ratio of weight to holding."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.arcs import Arcs, arcs_of
from pricing_core.max_plus.circuits import a_circuit, named
from pricing_core.max_plus.class_order import largest_upstream
from pricing_core.max_plus.howard import howard
from pricing_core.max_plus.matrices import (
    MaxPlusMatrix,
    Numbers,
    Scalar,
    alike,
    as_square,
    in_range,
)
from pricing_core.max_plus.scalars import LARGEST
from pricing_core.max_plus.spectrum import mean_of_circuits, plain


def cycle_time(A: object) -> Numbers:
    """Return lim x(k) / k of x(k+1) = A x(k), whatever the finite x(0): one number per node, shape (n,).

    A node's cycle time is the largest mean of the circuits from which a path leads to it, -inf without such a circuit.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.

    Notes
    -----
    Source: Heidergott, Olsder, van der Woude 2006, Theorem 3.17; Gunawardena 2003.

    Examples
    --------
    >>> cycle_time([[3.0, -np.inf], [2.0, 4.0]])
    array([3., 4.])
    """
    graph = arcs_of(as_square("A", A, top=False))
    solution = mean_of_circuits(graph)
    return largest_upstream(graph, solution.label, solution.ratio)


def cycle_ratio(A: object, holding: object) -> Scalar:
    """Return the largest ratio of sum A to sum `holding` over all circuits; -inf without a circuit.

    With one unit of holding on each arc this is `eigenvalue`. In a timed event graph A holds the times of
    the places and `holding` their tokens, and the ratio is the time between two firings.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    holding : array_like or scipy.sparse, shape (n, n)
        Numbers >= 0 where A has entries; others are not looked at. Sparse: what is not stored is 0.

    Returns
    -------
    float, or Fraction where both are exact

    Raises
    ------
    InvalidInputError
        A circuit has no holding at all, and is named; or shapes, NaN, +inf, a negative holding.

    Notes
    -----
    Policy iteration for semi-Markov problems; cost as for `eigenvalue`.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 2.5; Dasdan 2004.

    Examples
    --------
    The circuit of both nodes has the ratio 9/3, the first one's loop 3/2:

    >>> cycle_ratio([[3.0, 7.0], [2.0, -np.inf]], [[2, 1], [2, 0]])
    3.0
    """
    matrix, times = alike(as_square("A", A, top=False), as_square("holding", holding))
    if matrix.shape != times.shape:
        raise InvalidInputError("holding", Told(f"shape {times.shape}"), f"of the shape {matrix.shape} of A")
    graph = arcs_of(matrix)
    return largest_ratio(graph, _at(times, graph))


def largest_ratio(graph: Arcs, holding: Numbers) -> Scalar:
    """Return the largest ratio of weight to holding, both per arc; raises as `cycle_ratio` does."""
    if (holding < 0).any() or not (holding < np.inf).all():
        raise InvalidInputError("holding", plain(holding.min()), "finite and >= 0 where A has an entry")
    tiny = holding[(holding > 0) & (holding * LARGEST < 1)]
    if tiny.size:
        raise InvalidInputError("holding", plain(tiny[0]), f"0, or at least {1 / LARGEST:g}")
    circuit = a_circuit(graph.only(holding == 0))
    if circuit:
        raise InvalidInputError("holding", 0.0, f"positive somewhere on the circuit {named(circuit)}")
    return plain(in_range(howard(graph, holding).ratio).max())


def _at(times: MaxPlusMatrix, graph: Arcs) -> Numbers:
    """Return the entries at the arcs; 0 for what a sparse matrix does not store."""
    if not isinstance(times, csr_array):
        return np.asarray(times[graph.head, graph.tail])
    stored = arcs_of(times)
    n = graph.size
    place, wanted = stored.head * n + stored.tail, graph.head * n + graph.tail
    nearest = np.minimum(np.searchsorted(place, wanted), max(place.size - 1, 0))
    found = np.zeros(wanted.size)
    if place.size:
        there = place[nearest] == wanted
        found[there] = stored.weight[nearest[there]]
    return found
