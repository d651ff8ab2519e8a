"""Definiteness of symmetric rational matrices, decided exactly."""

from __future__ import annotations

import numpy as np
from flint import fmpq

from pricing_core.linalg.rational import RationalMatrix, exact_rank, rounded

SMALLEST = 1e-290  # from which on rounding is relative
ROUNDING = float(np.finfo(np.float64).eps)


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
    return None if is_clearly_positive_definite(M) else _by_elimination(M)


def _by_elimination(M: RationalMatrix) -> RationalMatrix | None:
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
    smaller = _by_elimination(M[np.ix_(rest, rest)] - np.outer(row, row) / diagonal[i])
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
    return is_clearly_positive_definite(M) or (_by_elimination(M) is None and exact_rank(M) == len(M))


def is_clearly_positive_definite(M: RationalMatrix) -> bool:
    """Prove definiteness by one Cholesky factorisation in floating point; False says nothing.

    The rows are scaled by powers of two to a diagonal between 1/4 and 4. Where the factorisation of the rounded matrix
    less a multiple of the identity that covers all rounding errors runs to its end, M is positive definite (Rump 2006).
    """
    n = len(M)
    try:
        numbers = rounded(M)
        diagonal = numbers.diagonal()
        if not np.isfinite(numbers).all() or not (diagonal > SMALLEST).all():
            return False
        powers = -np.rint(0.5 * np.log2(diagonal)).astype(int)
        scaled = np.ldexp(numbers, powers[:, None] + powers)
        if not np.isfinite(scaled).all():
            return False
        margin = (
            4.0 * (n + 4) * n * ROUNDING
        )  # of the trace, and of the entries' own rounding; underflow included
        np.linalg.cholesky(scaled - margin * max(float(np.abs(scaled).max(initial=0.0)), 1.0) * np.eye(n))
    except (np.linalg.LinAlgError, OverflowError):
        return False
    return True
