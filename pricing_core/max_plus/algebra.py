"""Sum (max), product (plus) and powers of max-plus matrices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.matrices import (
    EPSILON,
    MaxPlusMatrix,
    Numbers,
    alike,
    as_matrix,
    as_square,
    as_vector,
    dense,
    exact,
    in_range,
    is_exact,
    is_vector,
    rows_of,
)


def add(A: object, B: object) -> MaxPlusMatrix:
    """Return the entrywise maximum, C_ij = max(A_ij, B_ij), of two matrices or of two vectors.

    Parameters
    ----------
    A, B : array_like or scipy.sparse, of one shape (n, m) or (n,)
        Sparse: what is not stored is epsilon.

    Returns
    -------
    array, shape (n, m) or (n,); csr_array where both are sparse

    Raises
    ------
    InvalidInputError
        Shapes differ, an entry is NaN, or an argument is empty.

    Examples
    --------
    >>> add([[3.0, -np.inf], [2.0, 4.0]], [[1.0, 7.0], [5.0, 0.0]])
    array([[3., 7.],
           [5., 4.]])
    """
    left, right = alike(_operand("A", A), _operand("B", B))
    if left.shape != right.shape:
        raise InvalidInputError("B", Told(f"shape {right.shape}"), f"of the shape {left.shape} of A")
    if isinstance(left, csr_array) and isinstance(right, csr_array):
        rows = [np.repeat(np.arange(s.shape[0]), np.diff(s.indptr)) for s in (left, right)]
        column, value = (np.concatenate(pair) for pair in _paired(left, right))
        return rows_of(left.shape, np.concatenate(rows), column, value)
    return np.asarray(np.maximum(_full(left), _full(right)))


def multiply(A: object, B: object) -> MaxPlusMatrix:
    """Return the product, C_ij = max_k A_ik + B_kj; B may be a vector. Epsilon absorbs, even top.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, k)
    B : array_like or scipy.sparse, shape (k, m); or a vector, shape (k,)

    Returns
    -------
    array, shape (n, m) or (n,); csr_array where both are sparse

    Raises
    ------
    InvalidInputError
        The inner sizes differ, an entry is NaN, or an argument is empty.
    NumericalError
        A sum is beyond 1e150 in size.

    Notes
    -----
    Cost: O(n k m) dense, in k vectorised steps; sparse with a vector the number of stored entries; sparse
    with sparse the number of pairs A_ik, B_kj, all of which are held at once.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 3.2.

    Examples
    --------
    >>> multiply([[3.0, 7.0], [2.0, 4.0]], [1.0, 0.0])
    array([7., 4.])
    >>> multiply([[np.inf]], [[-np.inf]])
    array([[-inf]])
    """
    return product(as_matrix("A", A), _operand("B", B))


def product(left: MaxPlusMatrix, right: MaxPlusMatrix) -> MaxPlusMatrix:
    """Return the product of operands that have been checked, see `multiply`."""
    left, right = alike(left, right)
    if left.shape[1] != right.shape[0]:
        raise InvalidInputError(
            "B", Told(f"shape {right.shape}"), f"of {left.shape[1]} rows, as many as A has columns"
        )
    if isinstance(left, csr_array):
        if isinstance(right, csr_array):
            return in_range(_sparse_product(left, right))
        return in_range(_times_dense(left, right))
    if isinstance(right, csr_array):
        return in_range(_times_dense(csr_array(right.T), left.T).T)
    return in_range(_dense_product(left, right))


def power(A: object, k: int) -> MaxPlusMatrix:
    """Return the k-th power, k >= 0, by repeated squaring; the 0-th is the identity.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
    k : int

    Raises
    ------
    InvalidInputError
        A is not square, or k is no whole number >= 0.
    NumericalError
        A sum is beyond 1e150 in size.

    Notes
    -----
    Cost: at most 2 log2(k) products. Entry ij is the largest weight of a path of k arcs from j to i.

    Examples
    --------
    >>> power([[2.0, 5.0], [3.0, 3.0]], 4)
    array([[16., 16.],
           [14., 16.]])
    """
    base = as_square("A", A)
    k = as_whole_number("k", k, 0)
    result: MaxPlusMatrix | None = None
    while k:
        if k & 1:
            result = base if result is None else multiply(result, base)
        k >>= 1
        if k:
            base = multiply(base, base)
    return identity(base.shape[0], like=base) if result is None else result


def identity(n: int, *, like: MaxPlusMatrix | None = None) -> MaxPlusMatrix:
    """Return the identity: zeros on the diagonal and epsilon elsewhere; in the storage of `like`.

    Raises
    ------
    InvalidInputError
        n is no whole number >= 1.

    Examples
    --------
    >>> identity(2)
    array([[  0., -inf],
           [-inf,   0.]])
    """
    n = as_whole_number("n", n, 1)
    if not isinstance(like, np.ndarray | csr_array | None):
        raise InvalidInputError("like", like, "a max-plus matrix")
    if isinstance(like, csr_array):
        return rows_of((n, n), np.arange(n), np.arange(n), np.zeros(n))
    eye = np.where(np.eye(n, dtype=np.bool_), 0.0, EPSILON)
    return exact(eye) if like is not None and is_exact(like) else eye


def times(a: Numbers, b: Numbers) -> Numbers:
    """Return a + b entry by entry, epsilon where either is epsilon."""
    with np.errstate(invalid="ignore"):
        total = a + b
    return np.where((a == EPSILON) | (b == EPSILON), EPSILON, total)


def _operand(field: str, value: object) -> MaxPlusMatrix:
    return as_vector(field, value) if is_vector(value) else as_matrix(field, value)


def _full(operand: MaxPlusMatrix) -> Numbers:
    return dense(operand) if isinstance(operand, csr_array) else operand


def _paired(left: csr_array, right: csr_array) -> tuple[tuple[Numbers, Numbers], ...]:
    return (left.indices, right.indices), (left.data, right.data)


def _dense_product(left: Numbers, right: Numbers) -> Numbers:
    if right.ndim == 1:
        return np.asarray(times(left, right).max(axis=1))
    right_columns = right.reshape(right.shape[0], -1)
    result = np.full((left.shape[0], right_columns.shape[1]), EPSILON, dtype=left.dtype)
    for k in range(right.shape[0]):
        np.maximum(result, times(left[:, k, None], right_columns[k]), out=result)
    return result.reshape(left.shape[0], *right.shape[1:])


def _times_dense(left: csr_array, right: Numbers) -> Numbers:
    result = np.full((left.shape[0], *right.shape[1:]), EPSILON)
    filled = np.flatnonzero(np.diff(left.indptr))
    if filled.size:
        weight = left.data.reshape(-1, *(1,) * (right.ndim - 1))
        result[filled] = np.maximum.reduceat(times(weight, right[left.indices]), left.indptr[filled], axis=0)
    return result


def _sparse_product(left: csr_array, right: csr_array) -> csr_array:
    count = np.diff(right.indptr)[left.indices]  # entries of B that each entry of A meets
    ends = np.cumsum(count)
    total = int(ends[-1]) if ends.size else 0
    offset = np.arange(total) - np.repeat(ends - count, count)
    entry = np.repeat(right.indptr[left.indices], count) + offset
    row = np.repeat(np.repeat(np.arange(left.shape[0]), np.diff(left.indptr)), count)
    value = np.repeat(left.data, count) + right.data[entry]  # no epsilon is stored: no NaN
    return rows_of((left.shape[0], right.shape[1]), row, right.indices[entry], value)
