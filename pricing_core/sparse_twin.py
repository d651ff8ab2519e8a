"""The kernel's sweeps over sparse matrices in plain Python and NumPy: what takes their place, and tests them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector


def sparse_sweeps(
    indptr: NDArray[np.int64],
    indices: NDArray[np.int64],
    data: Vector,
    q: Vector,
    lower: Vector,
    upper: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    alternating: bool,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[Vector, int]:
    """Return (z, sweeps) of projected Gauss-Seidel sweeps over the rows of a sparse matrix, between bounds.

    Each sweep, every second one backward where `alternating`, sets z_i <- mid(lower_i, z_i - relaxation w_i / m_ii,
    upper_i) with the newest z. sweeps is max_sweeps + 1 where no sweep left all entries within `tolerance`, or
    `interrupt` ended the work.

    Raises
    ------
    ZeroDivisionError
        A diagonal entry is zero.

    Examples
    --------
    >>> one, at = np.ones(1), np.array([0, 1])
    >>> sparse_sweeps(at, at[:1], 2.0 * one, -4.0 * one, 0.0 * one, np.inf * one, 0.0 * one, 1.0, 1e-12, 9, False)
    (array([2.]), 2)
    """
    x, n = z.copy(), q.size
    rows = [slice(first, end) for first, end in zip(indptr[:-1].tolist(), indptr[1:].tolist(), strict=True)]
    pivots = [float(data[row][indices[row] == i].sum()) for i, row in enumerate(rows)]
    if 0.0 in pivots:
        raise ZeroDivisionError(f"pivot {pivots.index(0.0)} is zero")
    with np.errstate(over="ignore", invalid="ignore"):  # where the sweeps diverge
        for sweep in range(1, max_sweeps + 1):
            settled = True
            for i in range(n) if sweep % 2 or not alternating else range(n - 1, -1, -1):
                slack = q[i] + data[rows[i]] @ x[indices[rows[i]]]
                moved = x[i] - relaxation * (slack / pivots[i])
                following = lower[i] if moved < lower[i] else upper[i] if moved > upper[i] else moved
                settled &= bool(abs(following - x[i]) <= tolerance)  # False for NaN
                x[i] = following
            if settled:
                return x, sweep
            if interrupt is not None and interrupt():
                break
    return x, max_sweeps + 1
