"""Definiteness of symmetric rational matrices, decided exactly."""

import numpy as np
from flint import fmpq

from pricing_core.linalg.rational import RationalMatrix, exact_rank


def negative_vector(M: RationalMatrix) -> RationalMatrix | None:
    """Return v with v^T M v < 0, shape (n,), or None: M is positive semidefinite.

    Symmetric elimination: a vector of the Schur complement is completed by the variables that were eliminated,
    at their minimum. Cost: O(n**3) rational operations.

    Examples
    --------
    >>> from pricing_core.linalg.rational import rational_array
    >>> negative_vector(rational_array(np.array([[1, 2], [2, 1]]))).tolist()
    [-2, 1]
    >>> negative_vector(rational_array(np.array([[1, 1], [1, 1]]))) is None
    True
    """
    n = M.shape[0]
    diagonal = M.diagonal()
    v = np.full(n, fmpq(0), dtype=object)
    for i in range(n):
        if diagonal[i] < 0:
            v[i] = fmpq(1)
            return v
        if not diagonal[i]:
            partners = np.flatnonzero(M[i])
            if partners.size:
                j = partners[0]
                v[i], v[j] = -(diagonal[j] + 1) / (2 * M[i, j]), fmpq(1)
                return v
    pivots = np.flatnonzero(diagonal)
    if not pivots.size:
        return None
    i, rest = pivots[0], np.delete(np.arange(n), pivots[0])
    row = M[i, rest]
    smaller = negative_vector(M[np.ix_(rest, rest)] - np.outer(row, row) / diagonal[i])
    if smaller is None:
        return None
    v[rest] = smaller
    v[i] = -(row @ smaller) / diagonal[i]
    return v


def is_exactly_positive_definite(M: RationalMatrix) -> bool:
    """Tell whether v^T M v > 0 for all v != 0.

    Examples
    --------
    >>> from pricing_core.linalg.rational import rational_array
    >>> is_exactly_positive_definite(rational_array(np.array([[1, 1], [1, 1]])))
    False
    """
    return negative_vector(M) is None and exact_rank(M) == len(M)
