"""Projected successive over-relaxation: Gauss-Seidel sweeps with the projection inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core import kernel
from pricing_core.arrays import Vector, as_number, as_vector, as_whole_number, check_type
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp.problem import LCP, LCPSolution, natural_residual, solution_of
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.tridiagonal import Tridiagonal


def solve_psor(
    problem: LCP,
    *,
    relaxation: float = 1.2,
    tolerance: float = 1e-12,
    max_sweeps: int = 100_000,
    start: ArrayLike | None = None,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve an LCP with a symmetric positive definite or H+ matrix by projected sweeps.

    Each sweep sets z_i <- max(0, z_i - relaxation w_i / m_ii) for i = 0, ..., n - 1, with the newest z.

    Parameters
    ----------
    problem : LCP
        Positive diagonal. A sweep costs O(n) for a Tridiagonal, one pass over the entries otherwise.
    relaxation : float
        Between 0 and 2. Any of them converges for symmetric positive definite M, those up to 1 for every
        H-matrix with positive diagonal.
    tolerance : float
        Sweeps end when no component moved by more than tolerance * max_i |q_i| / m_ii. The error may be
        larger than that by the factor 1 / (1 - rate of convergence).
    start : array_like, shape (n,), optional
        Default: z = 0. Negative components are set to zero.
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
    check_type("problem", problem, LCP)
    diagonal = _positive_diagonal(problem)
    relaxation, tolerance = as_number("relaxation", relaxation), as_number("tolerance", tolerance)
    if not 0.0 < relaxation < 2.0:
        raise InvalidInputError("relaxation", relaxation, "between 0 and 2, both excluded")
    if not 0.0 <= tolerance < 1.0:
        raise InvalidInputError("tolerance", tolerance, "at least 0 and less than 1")
    max_sweeps, clock = as_whole_number("max_sweeps", max_sweeps, 1), TimeLimit(time_limit)
    z = np.zeros(problem.size) if start is None else np.maximum(as_vector("start", start, problem.size), 0.0)
    smallest_change = tolerance * float(np.max(np.abs(problem.q) / diagonal, initial=0.0))
    z, sweeps = _sweep(problem, diagonal, z, relaxation, smallest_change, max_sweeps, clock)
    if sweeps > max_sweeps or not np.isfinite(z).all():
        clock.check("projected SOR")
        raise IterationLimitError(
            f"projected SOR left a residual of {natural_residual(problem, z):.1e} after {max_sweeps} sweeps: "
            "lower the relaxation towards 1, raise max_sweeps or tolerance, or use a direct method"
        )
    return solution_of(problem, z, sweeps, "psor")


def _positive_diagonal(problem: LCP) -> Vector:
    M = problem.M
    diagonal = M.diagonal if isinstance(M, Tridiagonal) else np.asarray(M.diagonal())
    if not (diagonal > 0.0).all():
        raise InvalidInputError(
            "M", float(np.min(diagonal)), "a matrix with a positive diagonal, for projected SOR"
        )
    return diagonal


def _sweep(
    problem: LCP,
    diagonal: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    clock: TimeLimit,
) -> tuple[Vector, int]:
    """Return (z, sweeps), sweeps = max_sweeps + 1 where the limit was reached."""
    M, q = problem.M, problem.q
    if isinstance(M, Tridiagonal):
        found, count = kernel.projected_sor(
            M.lower, M.diagonal, M.upper, q, z, relaxation, tolerance, max_sweeps, clock
        )
        return np.asarray(found), int(count)
    rows = _rows(M)
    for sweep in range(1, max_sweeps + 1):
        before = z.copy()
        with np.errstate(over="ignore", invalid="ignore"):  # divergence is reported by the caller
            for i, (columns, values) in enumerate(rows):
                z[i] = max(z[i] - relaxation * ((q[i] + values @ z[columns]) / diagonal[i]), 0.0)  # NaN stays
            change = float(np.max(np.abs(z - before), initial=0.0))
        if change <= tolerance:
            return z, sweep
        if not np.isfinite(change) or clock():
            break
    return z, max_sweeps + 1


def _rows(M: np.ndarray | csr_array) -> list[tuple[slice | np.ndarray, Vector]]:
    """Return for every row (columns, values)."""
    if isinstance(M, csr_array):
        parts = [slice(a, b) for a, b in zip(M.indptr[:-1], M.indptr[1:], strict=True)]
        return [(M.indices[part], M.data[part]) for part in parts]
    return [(slice(None), row) for row in M]
