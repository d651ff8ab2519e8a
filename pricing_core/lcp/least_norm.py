"""The solution of least Euclidean norm of a monotone LCP."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector, as_vector, check_type
from pricing_core.errors import NumericalError
from pricing_core.lcp.lemke import follow_path
from pricing_core.lcp.problem import LCP
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.coefficients import dense

EPSILON = float(np.finfo(np.float64).eps)
# Share of the terms of a row by which a slack is more than rounding, so that z is zero there in every solution.
POSITIVE = 1e-9
# Share of the largest terms by which a solution may miss an inequality; beyond it nothing is sought.
INEXACT = 1e-6
# Share of the largest singular value, of equilibrated rows, below which one counts as zero.
SINGULAR = 1e-12
CLEARLY_REGULAR = (
    1e-6  # smallest singular value above which no equilibration is needed to see that all are positive
)
# Length of a part of a unit direction, or share of a row of M, below which it is zero: what it moves is then fixed.
FIXED = 1e-10
# Share of the terms of a row by which the point found may miss an inequality.
FEASIBLE = 1e-10
ROUNDING = 16.0 * EPSILON  # share of the terms of a component of z below which it is rounding alone


def least_norm_solution(problem: LCP, solution: Vector, kept: Matrix | None = None) -> Vector:
    """Return the solution of least norm, given one, for a positive semidefinite M.

    The solutions are the z >= 0 with M z + q >= 0, (M + M^T)(z - z0) = 0 and q^T (z - z0) = 0, a polyhedron. Where
    z0 has a positive slack every solution is zero. The least of the others is that of a quadratic programme in
    coordinates of the polyhedron's affine hull, whose dual is an LCP; indices that nothing couples are treated apart.

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
        Zero exactly where it is zero but for rounding. `solution` itself where it is the only one, where it is none,
        and where the quadratic programme was not solved to rounding.

    Notes
    -----
    Cost: a singular value decomposition, and where there are several solutions Lemke's method with at most 2 n pairs.
    Source: Cottle, Pang, Stone 1992, theorem 3.1.7.

    Examples
    --------
    Two legs carry a load between them; how they share it is open:

    >>> least_norm_solution(LCP([[1, 1], [1, 1]], [-2, -2]), np.array([2.0, 0.0]))
    array([1., 1.])
    """
    check_type("problem", problem, LCP)
    if not as_vector("solution", solution, problem.size).any():
        return solution
    solution = np.asarray(solution, dtype=np.float64)
    M = dense(problem.M)
    slack = M @ solution + problem.q
    sizes = np.abs(M) @ np.abs(solution) + np.abs(problem.q)
    if solution.min() < -INEXACT * np.abs(solution).max() or slack.min() < -INEXACT * sizes.max():
        return solution
    free = np.flatnonzero(slack <= POSITIVE * sizes)  # elsewhere z is zero in every solution
    if free.size == 0 or _is_clearly_unique(_common_rows(M, problem.q, kept, free)):
        return solution
    least, changed = np.zeros_like(solution), False
    for block in _blocks(M, kept, free):
        known = np.maximum(solution[block], 0.0)
        directions = _directions(_common_rows(M, problem.q, kept, block))
        found = (
            _least(M[:, block], np.maximum(slack, 0.0), sizes, known, directions) if directions.size else None
        )
        if found is not None and found @ found <= known @ known:
            least[block], changed = found, True
        else:
            least[block] = known
    return least if changed else solution


def _blocks(M: Matrix, kept: Matrix | None, free: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the free indices in groups of which no row of M, M' or `kept` couples two."""
    coupled = (M[:, free] != 0.0) | (M.T[:, free] != 0.0)
    if kept is not None:
        coupled = np.vstack([coupled, kept[:, free] != 0.0])
    near = (coupled.T.astype(np.float64) @ coupled > 0.0) | np.eye(free.size, dtype=np.bool_)
    while not np.array_equal(further := near.astype(np.float64) @ near > 0.0, near):
        near = further
    first = np.argmax(near, axis=1)  # the least member of each group
    return [free[first == member] for member in np.unique(first)]


def _common_rows(M: Matrix, q: Vector, kept: Matrix | None, free: NDArray[np.intp]) -> Matrix:
    """Return the rows whose products with z, zero elsewhere, are the same for all solutions."""
    symmetric = M[:, free] + M.T[:, free]
    symmetric = np.where(np.abs(symmetric) > 4.0 * EPSILON * np.abs(M[:, free]), symmetric, 0.0)
    return np.vstack([symmetric, q[None, free], *([] if kept is None else [kept[:, free]])])


def _is_clearly_unique(rows: Matrix) -> bool:
    """Tell at once that rows, scaled to largest entries of 1, leave no direction."""
    largest = np.abs(rows).max(axis=1, keepdims=True)
    singular = np.linalg.svd(rows / np.where(largest > 0.0, largest, 1.0), compute_uv=False)
    return bool(len(rows) >= rows.shape[1] and singular[-1] > CLEARLY_REGULAR)


def _directions(rows: Matrix) -> Matrix:
    """Return an orthonormal basis of the directions in which solutions differ, on the free indices, as columns."""
    for axis in (1, 0, 1):
        largest = np.max(np.abs(rows), axis=axis, keepdims=True, initial=0.0)
        inverse = 1.0 / np.where(largest > 0.0, largest, 1.0)
        rows = rows * inverse
        if axis == 0:
            column = inverse[0]
    _, singular, bases = np.linalg.svd(rows)
    rank = np.count_nonzero(singular > SINGULAR * max(rows.shape))
    if rank == bases.shape[1]:
        return np.zeros((bases.shape[1], 0))
    directions, _ = np.linalg.qr(column[:, None] * bases[rank:].T)
    fixed = np.linalg.norm(directions, axis=1) <= FIXED
    if fixed.any():
        directions, _ = np.linalg.qr(np.where(fixed[:, None], 0.0, directions))
        directions[fixed] = 0.0
    return np.asarray(directions)


def _least(M: Matrix, slack: Vector, sizes: Vector, known: Vector, directions: Matrix) -> Vector | None:
    """Minimise |z| over z = known + directions t with z >= 0 and slack + M directions t >= 0; None if that fails."""
    change = M @ directions
    moves = np.linalg.norm(change, axis=1) > FIXED * np.linalg.norm(M, axis=1)
    varies = directions.any(axis=1)
    rows = np.vstack([directions[varies], change[moves]])
    heights = np.concatenate([known[varies], slack[moves]])
    lengths = np.linalg.norm(rows, axis=1)
    rows, heights = rows / lengths[:, None], heights / lengths
    t = -(directions.T @ known)
    at_foot = rows @ t + heights
    tight, length = np.zeros(len(rows), dtype=np.bool_), float(np.linalg.norm(t))
    at_foot = np.where(np.abs(at_foot) > ROUNDING * (heights + length), at_foot, 0.0)
    if (at_foot < 0.0).any():
        try:
            products = rows @ rows.T
            products[np.abs(products) <= ROUNDING] = 0.0  # of rows that have nothing to do with each other
            dual = follow_path(LCP(products, at_foot), None, None, FEASIBLE, TimeLimit(None)).z
        except NumericalError:
            return None
        t, tight = t + rows.T @ dual, dual > 0.0
        length += float(np.sum(dual))
    z = known + directions @ t
    z[np.abs(z) <= ROUNDING * (known + np.linalg.norm(directions, axis=1) * length)] = 0.0
    z[np.flatnonzero(varies)[tight[: np.count_nonzero(varies)]]] = 0.0
    reached, terms = (slack + change @ t)[moves], (sizes + np.linalg.norm(M, axis=1) * length)[moves]
    if (z < -FEASIBLE * np.max(known)).any() or (reached < -FEASIBLE * terms).any():
        return None
    return np.maximum(z, 0.0)
