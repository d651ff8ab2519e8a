"""Lemke's complementary pivoting with a covering vector and the lexicographic ratio test."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core import kernel
from pricing_core.arrays import BoolVector, as_vector, as_whole_number, check_type
from pricing_core.errors import (
    InfeasibleError,
    InvalidInputError,
    IterationLimitError,
    NumericalError,
    RayTerminationError,
)
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCP,
    LCPSolution,
    as_tolerance,
    inside,
    solution_of,
    verified,
)
from pricing_core.lcp.scaling import equilibrate
from pricing_core.lcp.time_limit import TimeLimit

MENDING_PIVOTS = 5
REMEDY = "rescale the problem, or use method='murty' or 'enumeration'"


def solve_lemke(
    problem: LCP,
    *,
    covering: ArrayLike | None = None,
    max_pivots: int | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve any LCP whose path from the covering ray ends in a solution.

    The path of w - M z - d z0 = q is followed from the ray z0 -> infinity, d the covering vector, until z0
    leaves the basis. Without rounding it does so for every q where M is a P-matrix, or strictly copositive, and, where
    the problem is feasible, for M positive semidefinite or copositive-plus; elsewhere it may end on a second ray,
    which proves nothing by itself. `method="exact"` of `solve` follows the path without rounding.

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
    time_limit : float, optional
        Seconds, after which the path is left.

    Returns
    -------
    LCPSolution
        `iterations` counts the pivots. z is corrected by its residual in the last basis, which takes that to
        rounding level whatever the length of the path; a basic z that is rounding alone is zero.

    Raises
    ------
    InfeasibleError
        The path ended on a ray and {z >= 0, M z + q >= 0} is proved empty.
    RayTerminationError
        The path ended on a ray and nothing is proved.
    IterationLimitError
        `max_pivots` or `time_limit` were not enough; exponentially long paths exist (Murty 1978).
    NumericalError
        The last basis, chosen in floating point, does not belong to a solution.
    InvalidInputError
        A component of `covering` is not positive, or an option is of the wrong kind or out of range.

    Notes
    -----
    Source: Cottle, Pang, Stone 1992, algorithm 4.4.5, with the lexicographic rule of section 4.9.

    Examples
    --------
    >>> solve_lemke(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, -5.0])).z
    array([1., 2.])
    """
    check_type("problem", problem, LCP)
    try:
        return follow_path(problem, covering, max_pivots, tolerance, TimeLimit(time_limit))
    except RayTerminationError:
        if infeasibility_certificate(problem) is not None:
            raise InfeasibleError("no z >= 0 has M z + q >= 0: a combination of its rows proves it") from None
        raise


def follow_path(
    problem: LCP,
    covering: ArrayLike | None,
    max_pivots: int | None,
    tolerance: float,
    time_limit: TimeLimit,
) -> LCPSolution:
    """Return what `solve_lemke` returns; a ray is no occasion to look for a proof that there is no solution."""
    tolerance = as_tolerance(tolerance)
    scaled = equilibrate(problem)
    d = np.ones(problem.size)
    if covering is not None:
        d = scaled.row * as_vector("covering", covering, problem.size)
        if not (d > 0.0).all():
            raise InvalidInputError("covering", covering, "positive in every component")
    limit = (
        10_000 + 100 * problem.size if max_pivots is None else as_whole_number("max_pivots", max_pivots, 0)
    )
    end, z, basic_set, pivots = kernel.lemke(scaled.M, scaled.q, d, limit, time_limit)
    if end != "solved":
        failure = _unfinished(end, pivots, time_limit)
        failure.best = solution_of(problem, inside(problem, scaled.original(z)), pivots, "lemke")
        raise failure
    try:
        return verified(problem, scaled.original(z), pivots, "lemke", tolerance, REMEDY)
    except NumericalError:
        return _mended(problem, basic_set, pivots, tolerance)


def _unfinished(end: str, pivots: int, time_limit: TimeLimit) -> NumericalError:
    if end == "ray":
        return RayTerminationError(
            f"Lemke's method ended on a ray after {pivots} pivots, which proves nothing here: "
            "try another covering vector, method='murty' or, for n <= 20, method='enumeration'"
        )
    if end == "interrupted":
        return IterationLimitError(
            f"Lemke's method, at {pivots} pivots, did not end within time_limit = {time_limit.seconds} seconds"
        )
    return IterationLimitError(f"Lemke's method took {pivots} pivots without an end: raise max_pivots")


def _mended(problem: LCP, basic_set: BoolVector, pivots: int, tolerance: float) -> LCPSolution:
    """Let a few principal pivots correct a last basis in which rounding decided between nearly equal ratios."""
    try:
        found = solve_policy_iteration(problem, start=basic_set, max_iterations=MENDING_PIVOTS)
    except NumericalError as failure:
        raise NumericalError(
            f"the last basis of Lemke's method does not solve the problem: {REMEDY}"
        ) from failure
    return verified(problem, found.z, pivots + found.iterations, "lemke-mended", tolerance, REMEDY)
