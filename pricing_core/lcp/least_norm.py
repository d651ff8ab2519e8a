"""The solution of least Euclidean norm of a monotone LCP."""

import clarabel
import numpy as np
from scipy.sparse import csc_array, eye_array

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp.problem import LCP
from pricing_core.linalg.coefficients import dense

ACTIVE = 1e-7  # of the solution's size: below, the interior-point solution stands for zero
FEASIBLE = 1e-11
SINGULAR = 1e-12  # of the largest singular value


def least_norm_solution(problem: LCP, solution: Vector, kept: Matrix | None = None) -> Vector:
    """Return the solution of least norm, given one, for a positive semidefinite M.

    The solutions are the z >= 0 with M z + q >= 0, (M + M^T)(z - z0) = 0 and q^T (z - z0) = 0, a polyhedron.

    Parameters
    ----------
    problem : LCP
        M positive semidefinite, not necessarily symmetric.
    solution : Vector, shape (n,)
        z0, any solution.
    kept : Matrix, shape (m, n), optional
        Only solutions with kept z = kept z0 are looked at.

    Returns
    -------
    Vector, shape (n,)
        `solution` itself where it is the only one.

    Notes
    -----
    Cost: a singular value decomposition, and where there are several solutions a quadratic programme.
    Source: Cottle, Pang, Stone 1992, theorem 3.1.7.

    Examples
    --------
    Two legs carry a load between them; how they share it is open:

    >>> least_norm_solution(LCP([[1, 1], [1, 1]], [-2, -2]), np.array([2.0, 0.0]))
    array([1., 1.])
    """
    M, q = dense(problem.M), problem.q
    if q.size == 0:
        return solution
    rows = np.vstack([M + M.T, q[None, :], *([] if kept is None else [kept])])
    rows = rows / np.maximum(np.max(np.abs(rows), axis=1, keepdims=True), 1e-300)
    if np.linalg.matrix_rank(rows, tol=SINGULAR * max(rows.shape)) == q.size:
        return solution
    return _polished(rows, rows @ solution, M, q, _interior(rows, rows @ solution, M, q), solution)


def _interior(rows: Matrix, values: Vector, M: Matrix, q: Vector) -> Vector:
    """Minimise |z|^2/2 subject to rows z = values, z >= 0 and M z + q >= 0."""
    n = q.size
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    constraints = csc_array(np.vstack([rows, -np.eye(n), -M]))
    bounds = np.concatenate([values, np.zeros(n), q])
    cones = [clarabel.ZeroConeT(rows.shape[0]), clarabel.NonnegativeConeT(2 * n)]
    solver = clarabel.DefaultSolver(
        csc_array(eye_array(n)), np.zeros(n), constraints, bounds, cones, settings
    )
    return np.array(solver.solve().x)


def _polished(rows: Matrix, values: Vector, M: Matrix, q: Vector, near: Vector, solution: Vector) -> Vector:
    """Return the least z with the same active constraints, solved directly; `solution` where that is not feasible."""
    size = max(float(np.max(np.abs(solution), initial=0.0)), 1e-300)
    slack_size = max(float(np.max(np.abs(M @ solution), initial=0.0)), float(np.max(np.abs(q), initial=0.0)))
    zero = np.flatnonzero(near <= ACTIVE * size)
    tight = np.flatnonzero(M @ near + q <= ACTIVE * slack_size)
    equations = np.vstack([rows, np.eye(q.size)[zero], M[tight]])
    z = np.linalg.lstsq(equations, np.concatenate([values, np.zeros(zero.size), -q[tight]]), rcond=SINGULAR)[
        0
    ]
    feasible = np.all(z >= -FEASIBLE * size) and np.all(M @ z + q >= -FEASIBLE * max(slack_size, 1e-300))
    return np.maximum(z, 0.0) if feasible else solution
