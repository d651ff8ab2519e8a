"""Howard's policy iteration, which is Newton's method on min(z, M z + q) = 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core import kernel
from pricing_core.arrays import BoolVector, Vector, as_array, as_vector, as_whole_number, check_type
from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.policies import iterate_policies
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCP,
    LCPSolution,
    scaled_parts,
    scaled_residual,
    verified,
)
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.tridiagonal import Tridiagonal

ROUNDING = 1e-14  # scaled: a smaller violation does not move its index to the other side
REMEDY = "raise max_iterations, or use Lemke where M is no M-matrix"
# Scaled residual that ends the iteration where rounding keeps indices moving.
SOLVED = 1e-13


def solve_policy_iteration(
    problem: LCP,
    *,
    start: ArrayLike | None = None,
    max_iterations: int | None = None,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve an LCP with an M-matrix in a few linear systems; worth a try for other matrices.

    Each iteration fixes the basic set I, solves w_I = 0, z_i = 0 outside I, and then keeps in I the indices
    with z_i > 0 and adds those with w_i < 0. The same iteration is known as the primal-dual active set method
    and as the semismooth Newton method on min(z, M z + q) = 0.

    Parameters
    ----------
    problem : LCP
        Tridiagonal matrices cost O(n) per iteration, sparse and dense ones a factorisation.
    start : array_like, shape (n,), optional
        Boolean: the first basic set. Numbers: the first z, whose basic set is {i: w_i < z_i}. Default: z = 0.
    max_iterations : int, optional
        Default n + 50: for an M-matrix z never falls from the second iterate on, so that at most n + 1 are
        needed.
    time_limit : float, optional
        Seconds.

    Returns
    -------
    LCPSolution
        `iterations` counts the linear systems.

    Raises
    ------
    IterationLimitError
        A basic set came back, or `max_iterations` or `time_limit` were not enough; the default is for an M-matrix.
    NumericalError
        A principal submatrix is singular.

    Notes
    -----
    Source: Bokanowski, Maroso, Zidani 2009 (convergence for M-matrices, at most n steps for an obstacle
    problem); Hintermüller, Ito, Kunisch 2003 (the same as semismooth Newton).

    Examples
    --------
    >>> from pricing_core.linalg.tridiagonal import Tridiagonal
    >>> solution = solve_policy_iteration(LCP(Tridiagonal([-1.0], [2.0, 2.0], [-1.0]), [0.0, -3.0]))
    >>> solution.z, solution.iterations
    (array([1., 2.]), 2)
    """
    check_type("problem", problem, LCP)
    limit = (
        problem.size + 50 if max_iterations is None else as_whole_number("max_iterations", max_iterations, 1)
    )
    basic_set, clock = first_basic_set(problem, start), TimeLimit(time_limit)
    if isinstance(problem.M, Tridiagonal):
        z, iterations = _solve_tridiagonal(problem, problem.M, basic_set, limit, clock)
    else:
        z, iterations = _solve_general(problem, basic_set, limit, clock)
    return verified(problem, z, iterations, "policy-iteration", DEFAULT_TOLERANCE, "use Lemke")


def _solve_tridiagonal(
    problem: LCP, M: Tridiagonal, basic_set: BoolVector, limit: int, clock: TimeLimit
) -> tuple[Vector, int]:
    try:
        z, systems = kernel.policy_iteration(
            M.lower, M.diagonal, M.upper, problem.q, basic_set, ROUNDING, limit, clock
        )
    except ZeroDivisionError:
        raise NumericalError(
            "a pivot is zero: M is no M-matrix, or a principal submatrix is singular; use Lemke"
        ) from None
    if not scaled_residual(problem, z) <= SOLVED:
        clock.check("policy iteration")
        if systems > limit:
            raise IterationLimitError(
                f"policy iteration did not converge within {limit} iterations: {REMEDY}"
            )
    return z, min(systems, limit)


def _solve_general(problem: LCP, basic_set: BoolVector, limit: int, clock: TimeLimit) -> tuple[Vector, int]:
    seen: set[bytes] = set()

    def evaluate(basic_set: BoolVector) -> tuple[BoolVector, Vector]:
        clock.check("policy iteration")
        seen.add(basic_set.tobytes())
        return basic_set, basic_point(problem, basic_set)

    def improve(value: tuple[BoolVector, Vector]) -> BoolVector | None:
        basic_set, z = value
        _, slack = scaled_parts(problem, z)
        following = np.where(basic_set, z > 0.0, slack < -ROUNDING)
        if np.array_equal(following, basic_set) or scaled_residual(problem, np.maximum(z, 0.0)) <= SOLVED:
            return None
        if following.tobytes() in seen:
            raise IterationLimitError(
                f"policy iteration came back to a basic set after {len(seen)} iterations: "
                "M is no M-matrix; use Lemke"
            )
        return following

    (_, z), iterations = iterate_policies(evaluate, improve, basic_set, limit=limit, remedy=REMEDY)
    return z, iterations


def first_basic_set(problem: LCP, start: ArrayLike | None) -> BoolVector:
    """Return the basic set of a start: itself where it is boolean, {i: w_i < z_i} of a z, that of z = 0 by default.

    Raises
    ------
    InvalidInputError
        `start` has another length, or holds no numbers.
    """
    if start is None:
        return problem.q < 0.0
    given = as_array("start", start)
    if given.dtype != np.bool_:
        z = as_vector("start", start, problem.size)
        return problem.slack(z) < z
    if given.shape != (problem.size,):
        raise InvalidInputError("start", f"shape {given.shape}", f"a vector of length {problem.size}")
    return given
