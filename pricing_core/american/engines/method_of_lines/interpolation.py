"""Value and derivatives of a grid function at one point, from nodes on one side of the exercise boundary."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector

STENCIL = 6  # Number of nodes of the interpolating polynomial; chosen.


def local_derivatives(nodes: Vector, values: Matrix, usable: BoolVector, x: float) -> Matrix:
    """Return (f, f', f'', f''') at x from the polynomial through the nearest six usable neighbouring nodes.

    Parameters
    ----------
    nodes : Vector, shape (n,)
    values : Matrix, shape (m, n)
    usable : BoolVector, shape (n,)
        The nodes on the same smooth piece as x; one run of indices.
    x : float
        Between the nodes, or at most about a cell beyond the usable ones.

    Returns
    -------
    Matrix, shape (m, 4)
    """
    indices = np.flatnonzero(usable)
    width = min(STENCIL, indices.size)
    nearest = int(np.searchsorted(nodes[indices], x)) - width // 2
    chosen = indices[max(0, min(nearest, indices.size - width)) :][:width]
    scale = nodes[chosen[-1]] - nodes[chosen[0]] if width > 1 else 1.0
    powers = np.vander((nodes[chosen] - x) / scale, width, increasing=True)
    coefficients = np.linalg.solve(powers, values[:, chosen].T).T
    padded = np.zeros((values.shape[0], 4))
    padded[:, : min(4, width)] = coefficients[:, :4]
    return np.asarray(padded * np.array([1.0, 1.0 / scale, 2.0 / scale**2, 6.0 / scale**3]))


def run_around(usable: BoolVector, index: int) -> BoolVector:
    """Return the run of True entries that contains `index`."""
    blocked = np.flatnonzero(~usable)
    position = int(np.searchsorted(blocked, index))
    start = blocked[position - 1] + 1 if position > 0 else 0
    stop = blocked[position] if position < blocked.size else usable.size
    inside = np.zeros(usable.size, dtype=bool)
    inside[start:stop] = True
    return inside
