"""Value and derivatives of grid functions at one point each, from nodes on one side of the exercise boundary."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector

STENCIL = 6  # Number of nodes of the interpolating polynomial; chosen.


def nearest(nodes: Vector, x: float) -> slice:
    """Return the six nodes nearest x, or all where there are fewer; x lies at most about a cell beyond them."""
    width = min(STENCIL, nodes.size)
    first = max(0, min(int(nodes.searchsorted(x)) - width // 2, nodes.size - width))
    return slice(first, first + width)


def local_derivatives(nodes: Matrix, values: NDArray[np.float64], x: Vector) -> NDArray[np.float64]:
    """Return (f, f', f'', f''') at a point of each of m grids, from the polynomials through w nodes.

    Parameters
    ----------
    nodes : Matrix, shape (m, w)
        On the same smooth piece as x.
    values : array, shape (m, k, w)
        Values of k functions on each grid.
    x : Vector, shape (m,)

    Returns
    -------
    array, shape (m, k, 4)
        A grid's numbers do not depend on the other grids.

    Raises
    ------
    LinAlgError
        Rounding makes two nodes of a grid one.
    """
    width = nodes.shape[1]
    scale = nodes[:, -1] - nodes[:, 0] if width > 1 else np.ones(x.size)
    powers = np.ones((*nodes.shape, width))
    powers[:, :, 1:] = ((nodes - x[:, None]) / scale[:, None])[:, :, None]
    np.multiply.accumulate(powers[:, :, 1:], axis=2, out=powers[:, :, 1:])
    coefficients = np.linalg.solve(powers, values.transpose(0, 2, 1))
    found, known = np.zeros((*values.shape[:2], 4)), min(4, width)
    found[:, :, :known] = coefficients[:, :known].transpose(0, 2, 1)
    units = np.array([np.ones(x.size), 1.0 / scale, 2.0 / scale**2, 6.0 / scale**3])
    return np.asarray(found * units.T[:, None, :])


def run_around(entries: BoolVector, index: int) -> tuple[int, int]:
    """Return where the run of entries that equal the one at `index` starts, and where it stops."""
    others = np.flatnonzero(entries != entries[index])
    position = int(np.searchsorted(others, index))
    start = others.item(position - 1) + 1 if position > 0 else 0
    return start, others.item(position) if position < others.size else entries.size
