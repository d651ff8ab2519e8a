"""Kernel, image and solution in floating point by QR factorisations with column pivoting.

As `subspaces`, a little less sharp about ranks and for a fifth of the cost: where the linear algebra library runs
threads on a busy machine, singular values of matrices of order 40 to 80 cost eighty times as much.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from pricing_core.arrays import Matrix


def pivoted_kernel(M: Matrix, tolerance: float) -> Matrix:
    """Return an orthonormal basis of {x : M x = 0}, shape (n, n - rank).

    Pivots up to `tolerance` times the larger of 1 and the largest one count as zero: M is to be scaled so that its
    data are of order 1.

    Examples
    --------
    >>> pivoted_kernel(np.array([[3.0, 0.0], [0.0, 1e-14]]), 1e-10).ravel()
    array([0., 1.])
    """
    basis, rank = _range_and_rest(M.T, tolerance)
    return basis[:, rank:] + 0.0


def pivoted_image(M: Matrix, tolerance: float) -> Matrix:
    """Return an orthonormal basis of the range of M, shape (m, rank); the rank as in `pivoted_kernel`.

    Examples
    --------
    >>> np.abs(pivoted_image(np.array([[3.0, 6.0], [0.0, 0.0]]), 1e-10)).ravel()
    array([1., 0.])
    """
    basis, rank = _range_and_rest(M, tolerance)
    return basis[:, :rank]


def pivoted_solution(M: Matrix, R: Matrix, tolerance: float) -> Matrix:
    """Return an X that makes M X - R least, with as many rows other than zero as M has rank.

    Examples
    --------
    >>> pivoted_solution(np.array([[2.0, 1.0], [4.0, 2.0]]), np.array([[2.0], [4.0]]), 1e-10).ravel()
    array([1., 0.])
    """
    Q, upper, order = qr(M, mode="economic", pivoting=True, check_finite=False)
    rank = _rank(upper, tolerance)
    X = np.zeros((M.shape[1], R.shape[1]))
    X[order[:rank]] = np.linalg.solve(upper[:rank, :rank], Q[:, :rank].T @ R)
    return X


def _range_and_rest(M: Matrix, tolerance: float) -> tuple[Matrix, int]:
    """Return an orthogonal matrix whose first columns, as many as the rank, span the range of M, and the rank."""
    if not M.size:
        return np.eye(M.shape[0]), 0
    Q, upper, _ = qr(M, pivoting=True, check_finite=False)
    return np.asarray(Q), _rank(upper, tolerance)


def _rank(upper: NDArray[Any], tolerance: float) -> int:
    pivots = np.abs(np.diagonal(upper))
    return int(np.count_nonzero(pivots > tolerance * max(1.0, float(pivots.max(initial=0.0)))))
