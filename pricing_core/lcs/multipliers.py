"""The multipliers of least norm along a trajectory of a system whose inputs are not unique."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix
from pricing_core.lcp import LCP, least_norm_solution
from pricing_core.lcs.system import LCS

# Share of the largest entry by which an eigenvalue may be negative from rounding.
ROUNDING = 1e-12
# Share of the largest multiplier, slack or singular value below which one may be zero.
NOTHING = 1e-9


def least_norm_multipliers(system: LCS, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
    """Return u of least Euclidean norm among those with the same x', in the units given, and the y that goes with it.

    Where D + D^T is positive semidefinite the u with u _|_ y >= 0 and the same B u form a polyhedron. Elsewhere, and
    where that is a point, u and y are returned as they are.

    Parameters
    ----------
    system : LCS
    u, y : Matrix, shape (m, k)
        Multipliers and slacks at m times.

    Notes
    -----
    Cost: a quadratic programme for each time at which u is open, and one singular value decomposition for each mode.
    Source: Han, Tiwari, Camlibel, Pang 2009.
    """
    B, D = system.B, system.D
    symmetric = 0.5 * D + 0.5 * D.T
    stacked = np.vstack([B / max(float(np.abs(B).max(initial=0.0)), 1e-300), symmetric])
    if not u.size or np.linalg.matrix_rank(stacked) == D.shape[0]:
        return u, y
    if np.linalg.eigvalsh(symmetric).min() < -ROUNDING * np.abs(symmetric).max():
        return u, y
    inputs, slacks = u.copy(), y.copy()
    for i in _possibly_open(system, u, y).tolist():
        free = y[i] - D @ u[i]
        inputs[i] = np.maximum(least_norm_solution(LCP(D, free), u[i], kept=B), 0.0)
        slack = free + D @ inputs[i]
        rounding = NOTHING * (np.abs(free) + np.abs(D) @ inputs[i])
        slacks[i] = np.where((slack < 0.0) & (slack >= -rounding), 0.0, slack)
    return inputs, slacks


def _possibly_open(system: LCS, u: Matrix, y: Matrix) -> NDArray[np.intp]:
    """Return the rows in which the multipliers may be others as well.

    Two solutions of a monotone problem satisfy u'_i y_i = 0 = u_i y'_i. What is added to u therefore vanishes where
    y_i > 0, and changes no y_i where u_i > 0: there is nothing to add where [B; D] has full rank in these.
    """
    held = u > NOTHING * np.abs(u).max(axis=1, initial=0.0)[:, None]
    closed = y <= NOTHING * np.abs(y).max(axis=1, initial=0.0)[:, None]
    patterns, which = np.unique(np.hstack([held, closed]), axis=0, return_inverse=True)
    k = u.shape[1]
    is_open = np.array([_has_kernel(system, row[:k], row[k:]) for row in patterns], dtype=bool)
    return np.flatnonzero(is_open[which.ravel()])


def _has_kernel(system: LCS, held: NDArray[np.bool_], closed: NDArray[np.bool_]) -> bool:
    both = held | closed
    rows = np.vstack([system.B[:, both], system.D[np.ix_(held, both)]])
    if rows.shape[1] == 0:
        return False
    largest = np.abs(rows).max(axis=1, keepdims=True)
    scaled = rows[largest.ravel() > 0.0] / largest[largest.ravel() > 0.0]
    if scaled.shape[0] < scaled.shape[1]:
        return True
    columns = np.abs(scaled).max(axis=0)
    if not columns.all():
        return True
    values = np.linalg.svd(scaled / columns, compute_uv=False)
    return bool(values[-1] <= NOTHING * values[0])
