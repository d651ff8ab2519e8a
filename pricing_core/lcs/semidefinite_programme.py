"""The semidefinite programme behind the passivity test, solved by Clarabel's interior-point method."""

from typing import NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csc_matrix

from pricing_core.arrays import Matrix, Vector

SOLVED = ("Solved", "AlmostSolved")


class Margin(NamedTuple):
    """The largest t <= 1 with S(theta) >= t I and Q(theta) >= t I."""

    value: float
    theta: Vector  # (parameters,)
    multiplier: Matrix  # (m, m): of S; where t = 0, S(theta) vanishes on its range for every feasible theta


def largest_margin(S: NDArray[np.float64], Q: NDArray[np.float64]) -> Margin | None:
    """Maximise t, for affine families given by their constant part and the coefficients of theta.

    Parameters
    ----------
    S : array, shape (1 + parameters, m, m)
    Q : array, shape (1 + parameters, n, n)

    Returns
    -------
    Margin or None
        None where the solver failed.

    Examples
    --------
    S = 2 - theta, Q = theta:

    >>> margin = largest_margin(np.array([[[2.0]], [[-1.0]]]), np.array([[[0.0]], [[1.0]]]))
    >>> round(margin.value, 6), margin.theta.round(6)
    (1.0, array([1.]))
    """
    blocks = [block for block in (S, Q) if block.shape[1]]
    unknowns = len(S)  # theta and t
    rows = [_svec(np.concatenate([-block[1:], np.eye(block.shape[1])[None]])).T for block in blocks]
    right = [_svec(block[:1])[0] for block in blocks]
    limit = np.zeros((1, unknowns))
    limit[0, -1] = 1.0
    cones = [clarabel.PSDTriangleConeT(block.shape[1]) for block in blocks]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        csc_matrix((unknowns, unknowns)),
        -limit[0],
        csc_matrix(csc_array(np.vstack([*rows, limit]))),
        np.concatenate([*right, [1.0]]),
        [*cones, clarabel.NonnegativeConeT(1)],
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in SOLVED:
        return None
    x = np.array(solution.x)
    m = S.shape[1]
    return Margin(float(x[-1]), x[:-1], _smat(np.array(solution.z)[: m * (m + 1) // 2], m))


def _svec(M: NDArray[np.float64]) -> Matrix:
    """Return the upper triangles by columns, off-diagonal entries times sqrt 2, shape (count, m (m + 1) / 2)."""
    columns, rows = np.tril_indices(M.shape[1])
    weights = np.where(rows == columns, 1.0, np.sqrt(2.0))
    return np.asarray(M[:, rows, columns] * weights)


def _smat(v: Vector, m: int) -> Matrix:
    columns, rows = np.tril_indices(m)
    M = np.zeros((m, m))
    M[rows, columns] = M[columns, rows] = v * np.where(rows == columns, 1.0, np.sqrt(0.5))
    return M
