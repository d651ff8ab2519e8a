"""Subspaces in floating point: kernel, image and solution, with rank decided by singular values."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import Matrix


def kernel(M: Matrix, tolerance: float) -> Matrix:
    """Return an orthonormal basis of {x : M x = 0}, shape (n, n - rank).

    Singular values up to `tolerance` times the larger of 1 and the largest one count as zero: M is to be
    scaled so that its data are of order 1.

    Examples
    --------
    >>> kernel(np.array([[3.0, 0.0], [0.0, 1e-14]]), 1e-10).ravel()
    array([0., 1.])
    """
    _, values, right = np.linalg.svd(M)
    rank = _rank(values, tolerance)
    return np.asarray(right[rank:].T) + 0.0


def image(M: Matrix, tolerance: float) -> Matrix:
    """Return an orthonormal basis of the range of M, shape (m, rank); the rank as in `kernel`.

    Examples
    --------
    >>> np.abs(image(np.array([[3.0, 6.0], [0.0, 0.0]]), 1e-10)).ravel()
    array([1., 0.])
    """
    left, values, _ = np.linalg.svd(M, full_matrices=False)
    return np.asarray(left[:, : _rank(values, tolerance)])


def _rank(values: Matrix, tolerance: float) -> int:
    largest = max(1.0, float(np.max(values, initial=0.0)))
    return int(np.count_nonzero(values > tolerance * largest))
