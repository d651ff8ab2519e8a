"""Residuation: the largest x with A x <= b, and the largest X with X A <= B."""

from __future__ import annotations

from fractions import Fraction
from typing import cast

import numpy as np
from scipy.sparse import csr_array

from pricing_core.errors import InfeasibleError, InvalidInputError, Told
from pricing_core.max_plus.algebra import multiply, product
from pricing_core.max_plus.matrices import (
    EPSILON,
    TOP,
    Numbers,
    Stored,
    alike,
    as_matrix,
    as_vector,
    dense,
    in_range,
    is_exact,
    is_vector,
)
from pricing_core.max_plus.scalars import UNIT, as_tolerance


def residuate_left(A: object, b: object) -> Numbers:
    r"""Return A \ b, the greatest sub-solution: the largest x with A x <= b.

    x_j is the least of b_i - A_ij; top where column j has no entry that binds, as nothing then limits x_j.
    b may be a matrix, each column for itself.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, m)
        Top is allowed, here and in b.
    b : array_like, shape (n,) or (n, k)

    Returns
    -------
    array, shape (m,) or (m, k)

    Raises
    ------
    InvalidInputError
        The sizes differ, an argument is empty, or an entry is NaN.

    Notes
    -----
    A x = b has a solution if and only if this is one (Cuninghame-Green 1979). Cost: O(n m k).
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 4.4.4, Theorem 3.21.

    Examples
    --------
    >>> residuate_left([[2.0, 3.0, 1.0], [4.0, 1.0, 5.0]], [7.0, 6.0])
    array([2., 4., 1.])
    """
    left, right = alike(as_matrix("A", A), _operand("b", b))
    if left.shape[0] != right.shape[0]:
        raise InvalidInputError(
            "b", Told(f"shape {right.shape}"), f"of {left.shape[0]} rows, as many as A has"
        )
    if isinstance(left, csr_array) and right.ndim == 1:
        return _sparse_residual(left, right)
    columns = right.reshape(right.shape[0], -1)
    result = np.full((left.shape[1], columns.shape[1]), TOP, dtype=right.dtype)
    for row, limit in zip(dense(left), columns, strict=True):
        np.minimum(result, _difference(limit, row[:, None]), out=result)
    return in_range(result.reshape(left.shape[1], *right.shape[1:]))


def residuate_right(b: object, A: object) -> Numbers:
    """Return b / A, the largest x with x A <= b, x and b being rows: the mirror image of `residuate_left`.

    Parameters
    ----------
    b : array_like, shape (m,) or (k, m)
    A : array_like or scipy.sparse, shape (n, m)

    Returns
    -------
    array, shape (n,) or (k, n)

    Raises
    ------
    InvalidInputError
        The sizes differ, an argument is empty, or an entry is NaN.

    Examples
    --------
    >>> residuate_right([7.0, 6.0], [[2.0, 4.0], [3.0, 1.0], [1.0, 5.0]])
    array([2., 4., 1.])
    """
    row, matrix = _operand("b", b), as_matrix("A", A)
    if matrix.shape[1] != row.shape[-1]:
        raise InvalidInputError(
            "b", Told(f"shape {row.shape}"), f"of {matrix.shape[1]} columns, as many as A has"
        )
    return residuate_left(matrix.T, row.T).T


def solution_of_equation(A: object, b: object, *, tolerance: float | None = None) -> Numbers:
    """Return the largest x with A x = b, within the tolerance, where there is one.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, m)
    b : array_like, shape (n,)
    tolerance : float, optional
        By how much a row of A x may stay below b. Default: 0 for exact data, and for floats what rounding may do to
        b_i - A_ij and to A_ij + x_j.

    Raises
    ------
    InfeasibleError
        There is none: a row of A x stays below b, and is named.
    InvalidInputError
        The sizes differ, an argument is empty, or an entry is NaN; `tolerance` is no number >= 0.

    Examples
    --------
    >>> solution_of_equation([[2.0, 3.0, 1.0], [4.0, 1.0, 5.0]], [7.0, 6.0])
    array([2., 4., 1.])
    """
    allowed = as_tolerance("tolerance", tolerance)
    matrix, limit = alike(as_matrix("A", A), as_vector("b", b))
    x = residuate_left(matrix, limit)
    reached = np.asarray(multiply(matrix, x))
    if allowed is None:
        upper = np.asarray(product(_raised(matrix), _raised(x)))
    else:
        upper = reached + (Fraction(allowed) if is_exact(reached) else allowed)
    below = np.flatnonzero(upper < limit)
    if below.size:
        i = int(below[0])
        raise InfeasibleError(
            f"A x = b has no solution: row {i} of A x is at most {reached[i]} where A x <= b, and b asks for {limit[i]}"
        )
    return x


def _raised(values: Stored) -> Stored:
    """Return floats with what rounding may take of a sum that they are in."""
    if is_exact(values):
        return values
    raised = cast(Stored, values.copy())
    stored = raised.data if isinstance(raised, csr_array) else raised
    finite = np.isfinite(stored)
    stored[finite] += UNIT * np.abs(stored[finite])
    return raised


def _difference(limit: Numbers, weight: Numbers) -> Numbers:
    """Return limit - weight, top where nothing binds: where the weight is epsilon or the limit is top."""
    with np.errstate(invalid="ignore"):
        found = limit - weight
    return np.where((weight == EPSILON) | (limit == TOP), TOP, found)


def _sparse_residual(A: csr_array, b: Numbers) -> Numbers:
    row = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    result = np.full(A.shape[1], TOP)
    np.minimum.at(result, A.indices, _difference(b[row], A.data))
    return in_range(result)


def _operand(field: str, value: object) -> Numbers:
    return as_vector(field, value) if is_vector(value) else dense(as_matrix(field, value))
