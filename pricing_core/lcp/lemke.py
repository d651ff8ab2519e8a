"""Lemke's complementary pivoting with a covering vector and the lexicographic ratio test."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector, as_vector
from pricing_core.errors import (
    InfeasibleError,
    InvalidInputError,
    IterationLimitError,
    NumericalError,
    RayTerminationError,
)
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, scaled_residual, verified
from pricing_core.lcp.scaling import ScaledProblem, equilibrate

SMALLEST_PIVOT = 1e-10  # relative to the largest entry of the entering column
MENDING_PIVOTS = 5
ROUNDING = 1e-13  # relative to the terms that make up a number
REMEDY = "rescale the problem, or use method='murty' or 'enumeration'"


def solve_lemke(
    problem: LCP,
    *,
    covering: ArrayLike | None = None,
    max_pivots: int | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
) -> LCPSolution:
    """Solve any LCP whose path from the covering ray ends in a solution.

    The path of w - M z - d z0 = q is followed from the ray z0 -> infinity, d the covering vector, until z0
    leaves the basis. It does so for every q where M is a P-matrix, or strictly copositive, and, where the
    problem is feasible, for M positive semidefinite or copositive-plus; elsewhere it may end on a second ray,
    which proves nothing by itself.

    Parameters
    ----------
    problem : LCP
        Sparse and tridiagonal matrices are made dense.
    covering : array_like, shape (n,), optional
        d > 0. By default the ones of the equilibrated problem, so that units do not matter. Another d follows
        another path.
    max_pivots : int, optional
        Default 10000 + 100 n. A pivot costs O(n**2).
    tolerance : float
        Largest `scaled_residual` of the answer.

    Returns
    -------
    LCPSolution
        `iterations` counts the pivots. z solves the linear system of the last basis, so that its residual is
        at rounding level whatever the length of the path.

    Raises
    ------
    InfeasibleError
        The path ended on a ray and {z >= 0, M z + q >= 0} is proved empty.
    RayTerminationError
        The path ended on a ray and nothing is proved.
    IterationLimitError
        `max_pivots` were not enough; exponentially long paths exist (Murty 1978).
    NumericalError
        The last basis, chosen in floating point, does not belong to a solution.
    InvalidInputError
        A component of `covering` is not positive.

    Notes
    -----
    Source: Cottle, Pang, Stone 1992, algorithm 4.4.5, with the lexicographic rule of section 4.9.

    Examples
    --------
    >>> solve_lemke(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, -5.0])).z
    array([1., 2.])
    """
    scaled = equilibrate(problem)
    d = np.ones(problem.size)
    if covering is not None:
        d = scaled.row * as_vector("covering", covering, problem.size)
    if not (d > 0.0).all():
        raise InvalidInputError("covering", covering, "positive in every component")
    limit = 10_000 + 100 * problem.size if max_pivots is None else max_pivots
    basic_set, pivots = _follow_path(scaled.M, scaled.q, d, limit)
    if basic_set is None:
        raise _ray_error(problem, pivots)
    z = _point(scaled, basic_set)
    if scaled_residual(problem, np.maximum(z, 0.0)) > tolerance:
        return _mended(problem, basic_set, pivots, tolerance)
    return verified(problem, z, pivots, "lemke", tolerance, REMEDY)


def _mended(problem: LCP, basic_set: BoolVector, pivots: int, tolerance: float) -> LCPSolution:
    """Let a few principal pivots correct a last basis in which rounding decided between nearly equal ratios."""
    try:
        found = solve_policy_iteration(problem, start=basic_set, max_iterations=MENDING_PIVOTS)
    except NumericalError as failure:
        raise NumericalError(
            f"the last basis of Lemke's method does not solve the problem: {REMEDY}"
        ) from failure
    return verified(problem, found.z, pivots + found.iterations, "lemke-mended", tolerance, REMEDY)


def _ray_error(problem: LCP, pivots: int) -> NumericalError:
    if infeasibility_certificate(problem) is not None:
        return InfeasibleError("no z >= 0 has M z + q >= 0: a combination of its rows proves it")
    return RayTerminationError(
        f"Lemke's method ended on a ray after {pivots} pivots, which proves nothing here: "
        "try another covering vector, method='murty' or, for n <= 20, method='enumeration'"
    )


def _point(scaled: ScaledProblem, basic_set: BoolVector) -> Vector:
    """Return the z of the original problem that belongs to the basic set."""
    return scaled.original(basic_point(LCP(scaled.M, scaled.q), basic_set))


def _follow_path(M: Matrix, q: Vector, d: Vector, max_pivots: int) -> tuple[BoolVector | None, int]:
    """Return (basic set of the solution, pivots), the set None where the path ends on a ray."""
    n = q.size
    if (q >= 0.0).all():
        return np.zeros(n, dtype=np.bool_), 0
    artificial = 2 * n  # columns: w, z, z0, right-hand side
    system = np.column_stack([np.eye(n), -M, -d, q])
    tableau, basis = system.copy(), np.arange(n)
    # The lexicographic minimum of (q_i, e_i) / d_i: among equal q_i / d_i the last row.
    row = n - 1 - int(np.argmin((q / d)[::-1]))
    entering = artificial
    for pivot in range(1, max_pivots + 1):
        leaving = int(basis[row])
        _exchange(tableau, basis, row, entering)
        if leaving == artificial:
            return np.isin(np.arange(n, 2 * n), basis), pivot
        if pivot % (50 + n) == 0:
            tableau = _recomputed(system, tableau, basis)
        entering = leaving + n if leaving < n else leaving - n
        next_row = _leaving_row(tableau, entering, np.flatnonzero(basis == artificial)[0], np.abs(q))
        if next_row is None:
            return None, pivot
        row = next_row
    raise IterationLimitError(f"Lemke's method took {max_pivots} pivots without an end: raise max_pivots")


def _recomputed(system: Matrix, tableau: Matrix, basis: NDArray[np.intp]) -> Matrix:
    """Return the tableau of the basis computed from the data, free of the rounding of the pivots before."""
    try:
        return np.asarray(np.linalg.solve(system[:, basis], system))
    except np.linalg.LinAlgError:
        return tableau  # what comes of it is checked at the end


def _exchange(tableau: Matrix, basis: NDArray[np.intp], row: int, entering: int) -> None:
    tableau[row] /= tableau[row, entering]
    column = tableau[:, entering].copy()
    column[row] = 0.0
    tableau -= np.outer(column, tableau[row])
    basis[row] = entering


def _leaving_row(tableau: Matrix, entering: int, artificial_row: int, size: Vector) -> int | None:
    """Return the row of the lexicographically smallest ratio, z0's if it ties; None where there is none."""
    n = size.size
    column, inverse = tableau[:, entering], tableau[:, :n]
    rows = np.flatnonzero(column > max(SMALLEST_PIVOT * float(np.max(np.abs(column))), 1e-300))
    if rows.size == 0:
        return None
    values, slopes = np.maximum(tableau[rows, -1], 0.0), column[rows]
    noise = ROUNDING * (np.abs(inverse[rows]) @ size)
    ties = rows[values / slopes <= np.min((values + noise) / slopes)]
    if artificial_row in ties:
        return int(artificial_row)
    ratios = inverse[ties] / column[ties, None]
    noise = ROUNDING * np.max(np.abs(ratios), axis=1)
    for k in range(n):
        if ties.size == 1:
            break
        least = ratios[:, k] <= np.min(ratios[:, k] + noise)
        ties, ratios, noise = ties[least], ratios[least], noise[least]
    return int(ties[0])
