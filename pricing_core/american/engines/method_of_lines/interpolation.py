"""Value and derivatives of a grid function at one point, from nodes on one side of the exercise boundary."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector

STENCIL = 6  # Number of nodes of the interpolating polynomial; chosen.


def local_derivatives(nodes: Vector, values: Matrix, x: float) -> Matrix:
    """Return (f, f', f'', f''') at x from the polynomial through the nearest six nodes.

    Parameters
    ----------
    nodes : Vector, shape (n,)
        On the same smooth piece as x.
    values : Matrix, shape (m, n)
    x : float
        Between the nodes, or at most about a cell beyond them.

    Returns
    -------
    Matrix, shape (m, 4)
    """
    width = min(STENCIL, nodes.size)
    first = max(0, min(int(np.searchsorted(nodes, x)) - width // 2, nodes.size - width))
    near = nodes[first : first + width]
    scale = near.item(-1) - near.item(0) if width > 1 else 1.0
    powers = np.vander((near - x) / scale, width, increasing=True)
    found, known = np.zeros((values.shape[0], 4)), min(4, width)
    found[:, :known] = np.linalg.solve(powers, values[:, first : first + width].T).T[:, :known]
    return found * (1.0, 1.0 / scale, 2.0 / scale**2, 6.0 / scale**3)


def run_around(entries: BoolVector, index: int) -> tuple[int, int]:
    """Return where the run of entries that equal the one at `index` starts, and where it stops."""
    others = np.flatnonzero(entries != entries[index])
    position = int(np.searchsorted(others, index))
    start = others.item(position - 1) + 1 if position > 0 else 0
    return start, others.item(position) if position < others.size else entries.size
