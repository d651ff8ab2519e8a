"""The multipliers of least norm along a trajectory of a system whose inputs are not unique."""

import numpy as np

from pricing_core.arrays import Matrix
from pricing_core.lcp import LCP, least_norm_solution
from pricing_core.lcs.system import LCS

# Share of the largest entry by which an eigenvalue may be negative from rounding.
ROUNDING = 1e-12


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
    Cost: a quadratic programme for each time, if [B; D + D^T] has a kernel.
    Source: Han, Tiwari, Camlibel, Pang 2009.
    """
    B, D = system.B, system.D
    symmetric = 0.5 * D + 0.5 * D.T
    stacked = np.vstack([B / max(float(np.abs(B).max(initial=0.0)), 1e-300), symmetric])
    if np.linalg.matrix_rank(stacked) == D.shape[0]:
        return u, y
    if np.linalg.eigvalsh(symmetric).min() < -ROUNDING * np.abs(symmetric).max():
        return u, y
    inputs, slacks = u.copy(), y.copy()
    for i, (held, slack) in enumerate(zip(u, y, strict=True)):
        free = slack - D @ held
        inputs[i] = least_norm_solution(LCP(D, free), held, kept=B)
        slacks[i] = free + D @ inputs[i]
    return inputs, slacks
