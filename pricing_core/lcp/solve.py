"""Solve a complementarity problem: choose a method, check its answer, say which method gave it and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import check_callable, check_choice
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp.attempts import (
    LARGEST_DENSE,
    METHODS,
    Asked,
    Attempt,
    Method,
    attempts,
    first_success,
    single_methods,
)
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.mixed_attempts import mixed_attempts
from pricing_core.lcp.policy_iteration import first_basic_set, solve_policy_iteration
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCP,
    LCPSolution,
    Problem,
    as_tolerance,
    check_problem,
    solution_of,
    verified,
)
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.coefficients import is_operator

WARM_TOLERANCE = 1e-13  # scaled residual at which a basic set from elsewhere is taken for the solution
NEARLY_RIGHT = 0.3  # share of the indices with a wrong sign up to which the point of a start is mended
MENDING_SYSTEMS = 12


def solve(
    problem: Problem,
    *,
    method: Method = "auto",
    tolerance: float = DEFAULT_TOLERANCE,
    start: ArrayLike | None = None,
    time_limit: float | None = None,
    callback: Callable[[int, float], object] | None = None,
) -> LCPSolution:
    """Solve an LCP or a mixed LCP, or say what is known about why not.

    method="auto" takes the first of these that gives a point with a small residual, and names it in `solution.method`,
    with why it was tried in `solution.reason`:

    1. Tridiagonal Z-matrix with positive diagonal: the contact set by one pass; then, as it is one run at the first or
       last end, one run, or several, Brennan-Schwartz, the double sweep or policy iteration. All O(n) for an M-matrix.
       Other tridiagonal H+ matrix: policy iteration.
    2. Sparse Z-, H+ or symmetric matrix with positive diagonal: up to n = 3000 policy iteration ("policy-iteration")
       and block pivoting ("block-pivoting"), then, and for larger ones at once, active sets with multigrid
       ("multigrid", or "projected-sweeps" where sweeps are enough): O(nnz) time and memory for elliptic problems.
    3. Dense matrix with n >= 200: block principal pivoting, a few factorisations for a P-matrix.
    4. Lemke's method with its own covering vector ("lemke"), and with others ("lemke-restarted"). If they fail, an
       exact proof is looked for that {z >= 0, M z + q >= 0} is empty.
    5. Lemke's method from other bases ("lemke-pivoted"), which helps where every covering vector fails, as in
       bimatrix games.
    6. For n > 20 Murty's least-index pivoting ("murty"), policy iteration ("policy-iteration").
    7. For n <= 60 Lemke's method in rational arithmetic ("exact"); for n <= 20 a search of the complementary cells in
       rational arithmetic as well, so that the answer there is a solution or a proof that there is none; for larger
       ones a mixed-integer linear programme of at most 500 nodes ("integer-programme").

    Steps 4 to 6 are left out for sparse problems with n > 3000, and dense matrices up to n = 10 begin with step 4. Up
    to n = 6, where other paths cost more, step 7 follows the first path of step 4 and its proof at once.

    A `MixedLCP` whose unknowns have one bound each is solved as the LCP in the distances from it. Any other goes to
    step 2 where M is sparse, then to block pivoting, and for n <= 3000 to the LCPs in which free unknowns are
    eliminated or split and every second bound has a slack. A linear operator is made dense up to n = 3000; a larger
    one, which must be symmetric positive definite, is solved by its products ("projected-gradients").

    Parameters
    ----------
    problem : LCP or MixedLCP
    method : {"auto", "lemke", "murty", "psor", "policy", "tridiagonal", "multigrid", "block-pivoting", \
"projected-gradients", "enumeration", "exact"}
        "tridiagonal" is step 1 for any tridiagonal M, "exact" step 7, "enumeration" is
        `enumerate_solutions`, and the search of step 7 where it finds nothing; the others are the single methods.
    tolerance : float
        Largest `scaled_residual` of an answer, > 0 and < 1. It is relative to the size of the terms in each
        row, so it means the same whatever the units of rows and columns. Only "psor" works harder for a
        smaller one; the others end at rounding level.
    start : array_like, shape (n,), optional
        Boolean: a basic set {i: w_i = 0}. Numbers: a z, whose basic set is {i: w_i < z_i}. Where its point solves
        the problem, that is the answer (`solution.method` is "start"); where at most three in ten components
        have the wrong sign, a few principal pivots mend it ("start-mended"); otherwise the start is not used.
        "multigrid" and, for mixed problems, "block-pivoting" begin from the start instead.
    time_limit : float, optional
        Seconds; compiled and other iterations end within some milliseconds of it, single factorisations do not.
    callback : callable, optional
        Told (iteration, natural residual) by "multigrid", "block-pivoting" and "projected-gradients", asked for or
        chosen; ends the method where it returns True. The other methods measure no residual on their way.

    Returns
    -------
    LCPSolution

    Raises
    ------
    InfeasibleError
        Proved in exact arithmetic for the numbers as they are given: {z >= 0, M z + q >= 0} is empty, or for n <= 20
        no complementary cell holds a point.
    RayTerminationError
        Lemke's method ended on rays, nothing else helped, and nothing is proved.
    IterationLimitError, NumericalError
        The method could not answer, or its answer does not meet the tolerance; nothing is proved. The message says what
        was tried and what else may help.

        All but InfeasibleError carry `best`, the LCPSolution with the smallest scaled residual that was met.
    InvalidInputError
        An unknown method, an option of the wrong kind or out of range, or a matrix that the named method does not take.

    Examples
    --------
    >>> solution = solve(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, -5.0]))
    >>> solution.z, solution.method
    (array([1., 2.]), 'lemke')
    >>> solve(LCP([[-1.0]], [-1.0]))
    Traceback (most recent call last):
        ...
    pricing_core.errors.InfeasibleError: no z >= 0 has M z + q >= 0: a combination of its rows proves it
    """
    check_problem(problem)
    check_choice("method", method, METHODS)
    if callback is not None:
        check_callable("callback", callback, "an iteration and a residual")
    tolerance, limit = as_tolerance(tolerance), TimeLimit(time_limit)
    if problem.size == 0:
        return solution_of(problem, np.zeros(0), 0, method)
    asked = Asked(tolerance, start, callback)
    if is_operator(problem.M):
        return _by_products(problem, method, asked, limit)
    if isinstance(problem, MixedLCP):
        found = first_success(problem, mixed_attempts(problem, method, asked), limit)
    else:
        if start is not None and (known := _from_start(problem, start)) is not None:
            return known
        found = first_success(problem, attempts(problem, method, asked), limit)
    if method != "psor" and tolerance >= DEFAULT_TOLERANCE:
        return found  # verified at the default tolerance, or exact
    checked = verified(problem, found.z, found.iterations, found.method, tolerance, "raise the tolerance")
    return replace(checked, reason=found.reason)


def _by_products(problem: Problem, method: Method, asked: Asked, limit: TimeLimit) -> LCPSolution:
    """Solve a problem with a linear operator: by its products alone, or made dense where it is small."""
    large = problem.size > LARGEST_DENSE
    if large or method == "projected-gradients":
        if method not in {"auto", "projected-gradients"}:
            raise InvalidInputError(
                "method", method, '"projected-gradients" for a linear operator of more than 3000 unknowns'
            )
        run = single_methods(asked)["projected-gradients"]
        reason = "large linear operator" if method == "auto" else ""
        return first_success(problem, [Attempt("projected-gradients", run, reason)], limit)
    M = problem.dense()
    made = (
        LCP(M, problem.q)
        if isinstance(problem, LCP)
        else MixedLCP(M, problem.q, problem.lower, problem.upper)
    )
    return solve(
        made,
        method=method,
        tolerance=asked.tolerance,
        start=asked.start,
        time_limit=limit.left(),
        callback=asked.callback,
    )


def _from_start(problem: LCP, start: ArrayLike) -> LCPSolution | None:
    """Return the solution of a basic set, mended where it is nearly right, or None."""
    basic_set = first_basic_set(problem, start)
    if isinstance(problem.M, csr_array) and problem.size > LARGEST_DENSE:
        return None  # a factorisation may cost more than the iteration that begins there
    try:
        z = basic_point(problem, basic_set)
        wrong = np.where(basic_set, z < 0.0, problem.slack(z) < 0.0)
        try:
            return verified(problem, z, 1, "start", WARM_TOLERANCE, "not a solution")
        except NumericalError:
            if np.count_nonzero(wrong) > NEARLY_RIGHT * problem.size:
                return None
        found = solve_policy_iteration(problem, start=basic_set ^ wrong, max_iterations=MENDING_SYSTEMS)
        return verified(
            problem, found.z, 1 + found.iterations, "start-mended", WARM_TOLERANCE, "not a solution"
        )
    except NumericalError:
        return None
