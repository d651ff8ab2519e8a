"""The solution of least Euclidean norm of a monotone LCP."""

import clarabel
import numpy as np
from scipy.sparse import csc_array, eye_array

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp.problem import LCP
from pricing_core.linalg.coefficients import dense

# Shares of the solution's size below which the interior-point solution stands for zero; the next is tried where one is
# too little, for what is zero by accident is found to the root of the solver's accuracy alone.
ACTIVE = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
FEASIBLE = 1e-11
# Share of its size by which a solution may miss an inequality; beyond it nothing is sought.
INEXACT = 1e-6
# Share of the solution's size by which a candidate may miss what all solutions have in common, as one
# with too many constraints taken for active does.
CONSISTENT = 1e-9
# Share of the largest singular value below which one counts as zero.
SINGULAR = 1e-12
# Share of a row of M below which what is left of it is zero: its product with z is then the same for all.
FIXED = 1e-10


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
        `solution` itself where it is the only one, where it is none, and where no set of active constraints can be
        told that gives a solution to rounding.

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
    size = float(np.max(np.abs(solution), initial=0.0))
    if size == 0.0:
        return solution
    M, q, known = dense(problem.M), problem.q / size, solution / size  # the solver's tolerances are absolute
    slack_size = max(float(np.max(np.abs(M) @ np.abs(known) + np.abs(q))), 1e-300)
    if known.min() < -INEXACT or np.min(M @ known + q) < -INEXACT * slack_size:
        return solution
    rows = np.vstack([M + M.T, q[None, :], *([] if kept is None else [kept])])
    rows = rows / np.maximum(np.max(np.abs(rows), axis=1, keepdims=True), 1e-300)
    _, singular, bases = np.linalg.svd(rows)
    fixed = bases[: np.count_nonzero(singular > SINGULAR * max(rows.shape))]  # directions, orthonormal
    if len(fixed) == q.size:
        return solution
    near = _interior(fixed, fixed @ known, M, q)
    found = (_polished(fixed, M, q, near, known, active, slack_size) for active in ACTIVE)
    return next((size * z for z in found if z is not None), solution)


def _interior(rows: Matrix, values: Vector, M: Matrix, q: Vector) -> Vector:
    """Minimise |z|^2/2 subject to rows z = values, z >= 0 and M z + q >= 0; the rows are orthonormal."""
    # What the rows fix already would leave the inequalities no inside.
    sizes = np.linalg.norm(M, axis=1)
    moves = np.linalg.norm(M - M @ rows.T @ rows, axis=1) > FIXED * np.maximum(sizes, 1e-300)
    M, q, n = M[moves], q[moves], q.size
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    constraints = csc_array(np.vstack([rows, -np.eye(n), -M]))
    bounds = np.concatenate([values, np.zeros(n), q])
    cones = [clarabel.ZeroConeT(rows.shape[0]), clarabel.NonnegativeConeT(n + len(q))]
    solver = clarabel.DefaultSolver(
        csc_array(eye_array(n)), np.zeros(n), constraints, bounds, cones, settings
    )
    return np.array(solver.solve().x)


def _polished(
    rows: Matrix, M: Matrix, q: Vector, near: Vector, solution: Vector, active: float, slack_size: float
) -> Vector | None:
    """Return the least z with the same active constraints, solved directly; None where that is not feasible.

    The known solution's largest entry is 1; `slack_size` is that of the terms of its slacks.
    """
    zero = np.flatnonzero(near <= active)
    tight = np.flatnonzero(M @ near + q <= active * slack_size)
    equations = np.vstack([rows, np.eye(q.size)[zero], M[tight]])
    wanted = np.concatenate([rows @ solution, np.zeros(zero.size), -q[tight]])
    z = np.linalg.lstsq(equations, wanted, rcond=SINGULAR)[0]
    feasible = np.all(z >= -FEASIBLE) and np.all(M @ z + q >= -FEASIBLE * slack_size)
    feasible &= np.all(np.abs(rows @ (z - solution)) <= CONSISTENT)
    return np.maximum(z, 0.0) if feasible else None
