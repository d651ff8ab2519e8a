"""The star A* = I + A + A^2 + ... and the plus A+ = A + A^2 + ..., with top where they diverge."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.algebra import times
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.divergence import diverging
from pricing_core.max_plus.matrices import (
    EPSILON,
    TOP,
    MaxPlusMatrix,
    Numbers,
    as_square,
    dense,
    in_range,
    sparse,
    zero_like,
)
from pricing_core.max_plus.scalars import as_tolerance


def star(A: object, *, tolerance: float | None = None) -> MaxPlusMatrix:
    """Return A* = I + A + A^2 + ...: the largest weights of paths of any length from j to i.

    Where a path may run through a circuit of positive weight the sum diverges and the entry is top, +inf;
    all other entries are finite or epsilon, and right.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
    tolerance : float, optional
        A circuit diverges if its mean weight is larger. Default: 0 for an exact A, and for floats what rounding
        may make of a circuit of weight zero, n 2**-52 times the mean size of its own weights.

    Returns
    -------
    array, shape (n, n); csr_array where A is sparse

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN; `tolerance` is no number >= 0.

    Notes
    -----
    Kleene's elimination: A_ij becomes max(A_ij, A_ik + (A_kk)* + A_kj) for k = 1 ... n, with 0 or top for the
    star of a number. Cost: O(n**3), also for a sparse A; see `least_solution` for one column.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, sections 2.3 and 3.2.3 (Theorem 3.20: A* converges
    if and only if no circuit has a positive weight).

    Examples
    --------
    >>> star([[-1.0, 2.0], [-np.inf, -3.0]])
    array([[  0.,   2.],
           [-inf,   0.]])

    The first node's circuit diverges, and no path leads from it to the second:

    >>> star([[2.0, 3.0], [-np.inf, -1.0]])
    array([[ inf,  inf],
           [-inf,   0.]])
    """
    matrix, table, endless = _parts(A, tolerance)
    found = dense_star(table, endless)
    return sparse(found) if isinstance(matrix, csr_array) else found


def plus(A: object, *, tolerance: float | None = None) -> MaxPlusMatrix:
    """Return A+ = A + A^2 + ...: the largest weights of paths of at least one arc; see `star`.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN; `tolerance` is no number >= 0.

    Examples
    --------
    >>> plus([[-1.0, 2.0], [-np.inf, -3.0]])
    array([[ -1.,   2.],
           [-inf,  -3.]])
    """
    matrix, table, endless = _parts(A, tolerance)
    found = _dense_plus(table, endless)
    return sparse(found) if isinstance(matrix, csr_array) else found


def dense_star(A: Numbers, endless: BoolVector) -> Numbers:
    """Return the star where it is known which nodes lie in classes with a circuit that diverges."""
    found = _dense_plus(A, endless)
    own = np.diagonal(found)
    np.fill_diagonal(found, [TOP if entry == TOP else zero_like(found) for entry in own])
    return found


def _parts(A: object, tolerance: float | None) -> tuple[MaxPlusMatrix, Numbers, BoolVector]:
    """Return the matrix, the same dense, and the nodes of classes that diverge."""
    matrix = as_square("A", A)
    table = dense(matrix)
    return matrix, table, diverging(arcs_of(table), tolerance=as_tolerance("tolerance", tolerance))


def _dense_plus(A: Numbers, endless: BoolVector) -> Numbers:
    table = A.copy()
    for k in range(len(table)):
        if not endless[k]:
            table[k, k] = min(table[k, k], zero_like(table))
        through = times(table[:, k, None], table[k])
        if endless[k]:
            through = np.where(through == EPSILON, EPSILON, TOP)
        np.maximum(table, through, out=table)
    return in_range(table)
