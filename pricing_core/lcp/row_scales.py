"""How large the terms of each row are, where a row whose terms are all rounding is measured by what reaches it."""

import numpy as np
from scipy.sparse import csr_array

from pricing_core.arrays import Vector
from pricing_core.linalg.coefficients import Coefficients, dense

FLOOR = 1e-6  # share of what reaches a row below which its own terms are no measure
ROUNDS = 6  # of scaling, and of steps from row to row


def floored(M: Coefficients, sizes: Vector) -> Vector:
    """Return the sizes of the terms of each row, at least 1e-6 of what reaches the row through the couplings.

    With the rows and columns of M scaled to largest entries near 1, row i is reached by |m_ij| times what reaches row
    j, along up to six couplings: z_j carries the rounding of row j into row i.

    Examples
    --------
    The second row has terms of 1e-30 only, and depends on the first unknown:

    >>> floored(np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([4.0, 1e-30]))
    array([4.e+00, 2.e-06])
    """
    magnitude = csr_array(np.abs(dense(M))) if isinstance(M, np.ndarray) else abs(_sparse(M))
    rows = np.repeat(np.arange(sizes.size), np.diff(magnitude.indptr))
    columns = magnitude.indices
    row, column = np.ones(sizes.size), np.ones(sizes.size)
    for _ in range(ROUNDS):
        scaled = row[rows] * magnitude.data * column[columns]
        row = row / np.sqrt(_largest(rows, scaled, sizes.size))
        column = column / np.sqrt(_largest(columns, scaled, sizes.size))
    scaled = np.minimum(row[rows] * magnitude.data * column[columns], 1.0)
    reach = row * sizes
    for _ in range(ROUNDS):
        further = reach.copy()
        np.maximum.at(further, rows, scaled * reach[columns])
        if np.array_equal(further, reach):
            break
        reach = further
    return np.asarray(np.maximum(sizes, FLOOR * reach / row))


def _sparse(M: Coefficients) -> csr_array:
    if isinstance(M, csr_array):
        return M
    n = M.shape[0]
    bands = [(M.lower, -1), (M.diagonal, 0), (M.upper, 1)]  # type: ignore[union-attr]
    rows = np.concatenate([np.arange(band.size) + max(-k, 0) for band, k in bands])
    columns = np.concatenate([np.arange(band.size) + max(k, 0) for band, k in bands])
    return csr_array((np.concatenate([band for band, _ in bands]), (rows, columns)), shape=(n, n))


def _largest(index: Vector, values: Vector, n: int) -> Vector:
    """Return the largest value of each index, 1 where it has none above zero."""
    largest = np.zeros(n)
    np.maximum.at(largest, index, values)
    return np.where(largest > 0.0, largest, 1.0)
