"""Factors of rows and columns that bring the largest entries of a matrix near one (Ruiz 2001)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pricing_core import kernel
from pricing_core.arrays import Vector

ROUNDS = 6  # of a sparse matrix: each halves the logarithm of what is left


def equilibration(M: np.ndarray | csr_array) -> tuple[Vector, Vector]:
    """Return the diagonals of R and C for which R M C has its largest entries near one: powers of two of a dense M.

    The factor of an empty row or column is one. Cost: some passes over the entries.

    Examples
    --------
    >>> equilibration(np.diag([4.0, 64.0]))
    (array([0.5  , 0.125]), array([0.5  , 0.125]))
    >>> row, column = equilibration(csr_array(np.diag([4.0, 64.0])))
    >>> row * [4.0, 64.0] * column
    array([1., 1.])
    """
    if isinstance(M, np.ndarray):
        row, column = kernel.equilibrate(M)
        return row, column
    n = M.shape[0]
    rows, columns, sizes = np.repeat(np.arange(n), np.diff(M.indptr)), M.indices, np.abs(M.data)
    row, column = np.ones(n), np.ones(M.shape[1])
    for _ in range(ROUNDS):
        scaled = row[rows] * sizes * column[columns]
        row = row / np.sqrt(_largest(rows, scaled, n))
        column = column / np.sqrt(_largest(columns, scaled, column.size))
    return row, column


def _largest(index: NDArray[np.integer], values: Vector, n: int) -> Vector:
    """Return the largest value of each index, 1 where it has none above zero."""
    largest = np.zeros(n)
    np.maximum.at(largest, index, values)
    return np.where(largest > 0.0, largest, 1.0)
