"""Eigenvalues: the largest circuit mean, and for a reducible matrix all of them."""

from __future__ import annotations

from fractions import Fraction
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.errors import InvalidInputError
from pricing_core.max_plus.arcs import Arcs, arcs_of
from pricing_core.max_plus.class_order import largest_upstream
from pricing_core.max_plus.howard import HowardSolution, howard
from pricing_core.max_plus.karp import karp
from pricing_core.max_plus.matrices import EPSILON, Numbers, Scalar, as_square

MeanMethod: TypeAlias = Literal["howard", "karp"]


def eigenvalue(A: object, *, method: MeanMethod = "howard") -> Scalar:
    """Return the largest mean weight of a circuit, which is the largest eigenvalue; -inf without a circuit.

    A x = lambda + x has a solution x other than epsilon for this lambda, and for no larger one. An irreducible
    matrix has no other eigenvalue.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    method : "howard" or "karp"
        Howard's policy iteration, some tens of sweeps over the arcs, or Karp's algorithm, O(n m) time and
        O(n**2) memory per class.

    Returns
    -------
    float, or Fraction for an exact A

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.

    Notes
    -----
    Howard's is the mean of a circuit, and that of no circuit is larger by more than the rounding of the numbers on
    it. Karp's compares sums of n weights, and is as exact as the largest of them.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.23; Karp 1978; Cochet-Terrasson et al. 1998.

    Examples
    --------
    >>> eigenvalue([[3.0, 7.0], [2.0, 4.0]])
    4.5
    >>> eigenvalue([[-np.inf, 1.0], [-np.inf, -np.inf]])
    -inf
    """
    graph = arcs_of(as_square("A", A, top=False))
    if method == "karp":
        return plain(karp(graph))
    if method != "howard":
        raise InvalidInputError("method", method, '"howard" or "karp"')
    return plain(mean_of_circuits(graph).ratio.max())


def eigenvalues(A: object) -> Numbers:
    """Return all eigenvalues, largest first, each once: shape (k,).

    The mean of a class is an eigenvalue if no class to which a path leads from it has a larger one.
    -inf is an eigenvalue if a column is epsilon. Everything else is not.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.

    Returns
    -------
    array of float, or of Fraction for an exact A

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.

    Notes
    -----
    Means of floats closer than rounding are one. Source: Butkovič 2010, Theorem 4.5.4.

    Examples
    --------
    An arc leads from the second node to the first. If the first has the smaller mean, nothing forbids a vector with
    epsilon at the second node; if it has the larger one, no vector finite at the second could grow by 3 at both:

    >>> eigenvalues([[3.0, 0.0], [-np.inf, 5.0]])
    array([5., 3.])
    >>> eigenvalues([[5.0, 0.0], [-np.inf, 3.0]])
    array([5.])
    """
    graph = arcs_of(as_square("A", A, top=False))
    solution = mean_of_circuits(graph)
    spectral = spectral_nodes(graph, solution)
    order = np.flatnonzero(spectral)[np.argsort(-solution.ratio[spectral], kind="stable")]
    found, error = solution.ratio[order], solution.error[order]
    apart = np.full(found.size, True)
    apart[1:] = found[:-1] - found[1:] > error[:-1] + error[1:]
    without_arcs = np.setdiff1d(np.arange(graph.size), graph.tail).size > 0
    return np.append(found[apart], [EPSILON] if without_arcs else [])


def mean_of_circuits(graph: Arcs) -> HowardSolution:
    """Return Howard's solution with one unit of holding on each arc."""
    return howard(graph, np.ones(graph.head.size, dtype=graph.weight.dtype))


def spectral_nodes(graph: Arcs, solution: HowardSolution) -> BoolVector:
    """Return which nodes lie on circuits in a class whose mean is an eigenvalue, shape (n,)."""
    largest_downstream = largest_upstream(graph.reversed(), solution.label, solution.ratio - solution.error)
    return np.asarray((solution.ratio != EPSILON) & (largest_downstream <= solution.ratio + solution.error))


def plain(value: Scalar) -> Scalar:
    """Return a number of NumPy as one of Python."""
    return value if isinstance(value, Fraction) else float(value)
