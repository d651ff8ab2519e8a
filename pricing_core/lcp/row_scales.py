"""The sizes of the terms of each row; a row whose terms are all rounding is measured by the rows coupled to it."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.linalg.coefficients import Coefficients, sparse
from pricing_core.linalg.equilibration import equilibration

FLOOR = 1e-6  # share of what reaches a row below which its own terms are no measure
STEPS = 6  # from row to row


def floored(M: Coefficients, z: Vector, sizes: Vector) -> Vector:
    """Return the sizes of the terms of each row, at least 1e-6 of what reaches the row through the couplings.

    With the rows and columns of M scaled to largest entries near 1, row i is reached by |m_ij| times what reaches row
    j where z_j is not 0, along up to six couplings: such a z_j carries the rounding of row j into row i.

    Examples
    --------
    The second row has terms of 1e-30 only, and depends on the first unknown:

    >>> floored(np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([1e-30, 0.0]), np.array([4.0, 1e-30]))
    array([4.e+00, 2.e-06])
    """
    magnitude = abs(sparse(M))
    rows = np.repeat(np.arange(sizes.size), np.diff(magnitude.indptr))
    columns = magnitude.indices
    row, column = equilibration(M if isinstance(M, np.ndarray) else magnitude)
    scaled = np.minimum(row[rows] * magnitude.data * column[columns], 1.0) * (z[columns] != 0.0)
    reach = row * sizes
    for _ in range(STEPS):
        further = reach.copy()
        np.maximum.at(further, rows, scaled * reach[columns])
        if np.array_equal(further, reach):
            break
        reach = further
    return np.asarray(np.maximum(sizes, FLOOR * reach / row))
