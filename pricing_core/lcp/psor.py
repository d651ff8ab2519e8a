"""Projected successive over-relaxation: Gauss-Seidel sweeps with the projection inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core import kernel
from pricing_core.arrays import Vector, as_number, as_vector, as_whole_number
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp.problem import (
    LCP,
    LCPSolution,
    Problem,
    check_problem,
    inside,
    natural_residual,
    solution_of,
)
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.coefficients import sparse
from pricing_core.linalg.tridiagonal import Tridiagonal


def solve_psor(
    problem: Problem,
    *,
    relaxation: float = 1.2,
    tolerance: float = 1e-12,
    max_sweeps: int = 100_000,
    start: ArrayLike | None = None,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve a problem with a symmetric positive definite or H+ matrix by projected sweeps.

    Each sweep sets z_i <- max(0, z_i - relaxation w_i / m_ii), with other bounds what is nearest between them, for
    i = 0, ..., n - 1, with the newest z.

    Parameters
    ----------
    problem : LCP or MixedLCP
        Positive diagonal. A sweep costs O(n) for a Tridiagonal, one pass over the entries otherwise.
    relaxation : float
        Between 0 and 2. Any of them converges for symmetric positive definite M, those up to 1 for every
        H-matrix with positive diagonal.
    tolerance : float
        Sweeps end when no component moved by more than tolerance * max_i |q_i| / m_ii. The error may be
        larger than that by the factor 1 / (1 - rate of convergence).
    start : array_like, shape (n,), optional
        Default: z = 0. What lies outside the bounds is moved to them.
    time_limit : float, optional
        Seconds.

    Returns
    -------
    LCPSolution
        `iterations` counts the sweeps.

    Raises
    ------
    IterationLimitError
        No convergence within `max_sweeps` or `time_limit`.
    InvalidInputError
        A diagonal entry is not positive, or an option lies outside its range.

    Notes
    -----
    Source: Cryer 1971; Cottle, Pang, Stone 1992, section 5.2.

    Examples
    --------
    >>> solve_psor(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -1.0]), relaxation=1.0).z
    array([2.5, 0. ])
    """
    check_problem(problem)
    diagonal = _positive_diagonal(problem)
    relaxation, tolerance = as_number("relaxation", relaxation), as_number("tolerance", tolerance)
    if not 0.0 < relaxation < 2.0:
        raise InvalidInputError("relaxation", relaxation, "between 0 and 2, both excluded")
    if not 0.0 <= tolerance < 1.0:
        raise InvalidInputError("tolerance", tolerance, "at least 0 and less than 1")
    max_sweeps, clock = as_whole_number("max_sweeps", max_sweeps, 1), TimeLimit(time_limit)
    z = inside(problem, np.zeros(problem.size) if start is None else as_vector("start", start, problem.size))
    smallest_change = tolerance * float(np.max(np.abs(problem.q) / diagonal, initial=0.0))
    z, sweeps = _sweep(problem, diagonal, z, relaxation, smallest_change, max_sweeps, clock)
    if sweeps > max_sweeps or not np.isfinite(z).all():
        clock.check("projected SOR")
        failure = IterationLimitError(
            f"projected SOR left a residual of {natural_residual(problem, z):.1e} after {max_sweeps} sweeps: "
            "lower the relaxation towards 1, raise max_sweeps or tolerance, or use a direct method"
        )
        failure.best = solution_of(problem, z, max_sweeps, "psor") if np.isfinite(z).all() else None
        raise failure
    return solution_of(problem, z, sweeps, "psor")


def _positive_diagonal(problem: Problem) -> Vector:
    M = problem.M
    diagonal = M.diagonal if isinstance(M, Tridiagonal) else np.asarray(M.diagonal())
    if not (diagonal > 0.0).all():
        raise InvalidInputError(
            "M", float(np.min(diagonal)), "a matrix with a positive diagonal, for projected SOR"
        )
    return diagonal


def _sweep(
    problem: Problem,
    diagonal: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    clock: TimeLimit,
) -> tuple[Vector, int]:
    """Return (z, sweeps), sweeps = max_sweeps + 1 where the limit was reached."""
    M, q = problem.M, problem.q
    if isinstance(problem, LCP) and isinstance(M, Tridiagonal):
        found, count = kernel.projected_sor(
            M.lower, M.diagonal, M.upper, q, z, relaxation, tolerance, max_sweeps, clock
        )
        return np.asarray(found), int(count)
    rows = sparse(M)
    found, count = kernel.sparse_sweeps(
        rows.indptr.astype(np.int64),
        rows.indices.astype(np.int64),
        rows.data,
        q,
        problem.lower,
        problem.upper,
        z,
        relaxation,
        tolerance,
        max_sweeps,
        False,
        clock,
    )
    return np.asarray(found), int(count)
