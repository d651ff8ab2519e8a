"""A square matrix in any of three storages, dense array, sparse rows, tridiagonal bands; or a linear operator."""

from __future__ import annotations

from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, issparse
from scipy.sparse.linalg import LinearOperator

from pricing_core.arrays import Matrix, Vector, as_square_matrix
from pricing_core.errors import InvalidInputError
from pricing_core.linalg.tridiagonal import Tridiagonal

SYMMETRIC = 1e-14  # relative: entries that differ by less are taken to be equal

Coefficients: TypeAlias = Matrix | csr_array | Tridiagonal


def as_coefficients(field: str, M: object) -> Coefficients:
    """Return M as a read-only array, as a `csr_array` of its own, or the Tridiagonal it is.

    Parameters
    ----------
    field : str
        Name of the argument in the error.
    M : array_like (n, n), scipy.sparse matrix or array (n, n), or Tridiagonal

    Raises
    ------
    InvalidInputError
        M is not square, or an entry is not a finite real number.
    """
    if isinstance(M, Tridiagonal):
        return M
    if not issparse(M):
        return as_square_matrix(field, cast(ArrayLike, M))
    sparse = cast(csr_array, M)
    if sparse.dtype.kind not in "fiu" or sparse.ndim != 2 or sparse.shape[0] != sparse.shape[1]:
        raise InvalidInputError(
            field, f"a {sparse.dtype} matrix of shape {sparse.shape}", "square, of real numbers"
        )
    own: csr_array = sparse.tocsr().astype(np.float64, copy=True)
    own = csr_array(own)
    own.sum_duplicates()
    if not np.isfinite(own.data).all():
        raise InvalidInputError(field, M, "finite")
    return own


def as_coefficients_or_operator(field: str, M: object) -> Coefficients:
    """Return what `as_coefficients` does, or the SciPy linear operator that M is.

    An operator has a shape and products. Where more is asked of it, it is made dense, by n products.
    """
    if not isinstance(M, LinearOperator):
        return as_coefficients(field, M)
    if M.shape[0] != M.shape[1] or np.dtype(M.dtype).kind not in "fiu":
        raise InvalidInputError(field, f"a {M.dtype} operator of shape {M.shape}", "square, of real numbers")
    return cast(csr_array, M)


def is_operator(M: Coefficients) -> bool:
    """Tell whether M is known by its products alone."""
    return isinstance(M, LinearOperator)


def dense(M: Coefficients) -> Matrix:
    """Return the matrix as an array, shape (n, n)."""
    if isinstance(M, Tridiagonal):
        return M.dense()
    if isinstance(M, LinearOperator):
        return np.asarray(M @ np.eye(M.shape[0]), dtype=np.float64)
    return np.asarray(M.toarray()) if isinstance(M, csr_array) else M


def sparse(M: Coefficients) -> csr_array:
    """Return the matrix by sparse rows; one that is stored so is returned as it is."""
    if isinstance(M, csr_array):
        return M
    if not isinstance(M, Tridiagonal):
        return csr_array(dense(M))
    n = M.shape[0]
    places = np.arange(n)
    rows = np.concatenate([places[1:], places, places[:-1]])
    columns = np.concatenate([places[:-1], places, places[1:]])
    return csr_array((np.concatenate([M.lower, M.diagonal, M.upper]), (rows, columns)), shape=(n, n))


def is_symmetric(M: Coefficients) -> bool:
    """Tell whether M equals its transpose, each pair of entries to within rounding of the larger diagonal entry."""
    if isinstance(M, Tridiagonal):
        difference, size = np.abs(M.lower - M.upper), np.abs(M.diagonal).max(initial=0.0)
    elif isinstance(M, csr_array):
        difference, size = np.abs((M - M.T).data), np.abs(M.diagonal()).max(initial=0.0)
    else:
        A = dense(M)
        difference, size = np.abs(A - A.T), np.abs(np.diagonal(A)).max(initial=0.0)
    return bool(difference.max(initial=0.0) <= SYMMETRIC * size)


def absolute(M: Coefficients) -> Coefficients:
    """Return the entrywise absolute value, in the same storage."""
    if isinstance(M, Tridiagonal):
        return Tridiagonal(np.abs(M.lower), np.abs(M.diagonal), np.abs(M.upper))
    return csr_array(abs(M)) if isinstance(M, csr_array) else np.abs(dense(M))


def diagonal_of(M: Coefficients) -> Vector:
    """Return the diagonal, shape (n,)."""
    if isinstance(M, Tridiagonal):
        return M.diagonal
    return np.asarray(M.diagonal() if isinstance(M, csr_array) else np.diagonal(dense(M)))


def off_diagonal_entries(M: Coefficients) -> Vector:
    """Return the stored entries off the diagonal, in no particular order, shape (m,)."""
    if isinstance(M, Tridiagonal):
        return np.concatenate([M.lower, M.upper])
    if isinstance(M, csr_array):
        rows = np.repeat(np.arange(M.shape[0]), np.diff(M.indptr))
        return np.asarray(M.data[rows != M.indices])
    return dense(M)[~np.eye(M.shape[0], dtype=np.bool_)]
