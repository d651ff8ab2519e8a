"""Solve a linear complementarity problem: choose a method, check its answer, say which method gave it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import BoolVector, Matrix, check_choice, check_type
from pricing_core.errors import InfeasibleError, NumericalError, RayTerminationError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.enumeration import enumerate_solutions
from pricing_core.lcp.exact import (
    LARGEST_EXACT_ORDER,
    LARGEST_SEARCHED_ORDER,
    exact_problem,
    rounded,
    solve_exact,
    values_by_search,
)
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.lemke import follow_path
from pricing_core.lcp.murty import solve_murty
from pricing_core.lcp.policy_iteration import first_basic_set, solve_h_plus, solve_policy_iteration
from pricing_core.lcp.principal_pivot import principal_pivot
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, as_tolerance, solution_of, verified
from pricing_core.lcp.psor import solve_psor
from pricing_core.lcp.scaling import equilibrate
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.lcp.tridiagonal import as_tridiagonal, solve_tridiagonal_m_matrix
from pricing_core.linalg.matrix_classes import is_h_plus_matrix, is_z_matrix
from pricing_core.linalg.polynomial_tableau import feasible
from pricing_core.linalg.tridiagonal import Tridiagonal

Method: TypeAlias = Literal["auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration", "exact"]
METHODS = ("auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration", "exact")
Attempt: TypeAlias = tuple[str, Callable[[LCP, TimeLimit], LCPSolution]]

WARM_TOLERANCE = 1e-13  # scaled residual at which a basic set from elsewhere is taken for the solution
NEARLY_RIGHT = 0.3  # share of the indices with a wrong sign up to which the point of a start is mended
MENDING_SYSTEMS = 12
QUICKLY_EXACT = 6  # order up to which rational arithmetic costs less than other paths in floating point
SMALL = 10  # a dense matrix up to this order is not worth a look at its structure
LARGEST_DENSE = 3000  # sparse problems up to this order may be made dense for Lemke's method
LARGEST_PIVOT_TRIALS = 8
GOLDEN = 0.6180339887498949
PROOF = "a proof that there is no solution"
COMBINED = "no z >= 0 has M z + q >= 0: a combination of its rows proves it"


def solve(
    problem: LCP,
    *,
    method: Method = "auto",
    tolerance: float = DEFAULT_TOLERANCE,
    start: ArrayLike | None = None,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve an LCP, or say what is known about why not.

    method="auto" takes the first of these that gives a point with a small residual, and names it in `solution.method`:

    1. Tridiagonal Z-matrix with positive diagonal: the contact set by one pass; then, as it is one run at the first or
       last end, one run, or several, Brennan-Schwartz, the double sweep or policy iteration. All O(n) for an M-matrix.
    2. Sparse H+ matrix: for n > 3000 projected sweeps where they converge fast ("projected-sweeps"), else policy
       iteration; tridiagonal H+ matrix: policy iteration.
    3. Lemke's method with its own covering vector ("lemke"), and with others ("lemke-restarted"). If they fail, an
       exact proof is looked for that {z >= 0, M z + q >= 0} is empty.
    4. Lemke's method from other bases ("lemke-pivoted"), which helps where every covering vector fails, as in
       bimatrix games.
    5. For n > 20 Murty's least-index pivoting ("murty"), policy iteration ("policy-iteration").
    6. For n <= 60 Lemke's method in rational arithmetic ("exact"); for n <= 20 a search of the complementary cells in
       rational arithmetic as well, so that the answer there is a solution or a proof that there is none.

    Steps 3 to 5 are left out for sparse problems with n > 3000, and dense matrices up to n = 10 begin with step 3. Up
    to n = 6, where other paths cost more, step 6 follows the first path of step 3 and its proof at once.

    Parameters
    ----------
    problem : LCP
    method : {"auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration", "exact"}
        "tridiagonal" is step 1 for any tridiagonal M, "exact" step 6, "enumeration" is
        `enumerate_solutions`, and the search of step 6 where it finds nothing; the others are the single methods.
    tolerance : float
        Largest `scaled_residual` of an answer, > 0 and < 1. It is relative to the size of the terms in each
        row, so it means the same whatever the units of rows and columns. Only "psor" works harder for a
        smaller one; direct methods are at rounding level.
    start : array_like, shape (n,), optional
        Boolean: a basic set {i: w_i = 0}. Numbers: a z, whose basic set is {i: w_i < z_i}. Where its point solves
        the problem, that is the answer (`solution.method` is "start"); where at most three in ten components
        have the wrong sign, a few principal pivots mend it ("start-mended"); otherwise the start is not used.
    time_limit : float, optional
        Seconds; compiled and other iterations end within some milliseconds of it, single factorisations do not.

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
        The method could not answer, or its answer does not meet the tolerance; nothing is proved.
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
    check_type("problem", problem, LCP)
    check_choice("method", method, METHODS)
    tolerance, limit = as_tolerance(tolerance), TimeLimit(time_limit)
    if problem.size == 0:
        return solution_of(problem, np.zeros(0), 0, method)
    if start is not None and (known := _from_start(problem, start)) is not None:
        return known
    found = _first_success(problem, _attempts(problem, method, tolerance), limit)
    if method != "psor" and tolerance >= DEFAULT_TOLERANCE:
        return found  # verified at the default tolerance, or exact
    return verified(problem, found.z, found.iterations, found.method, tolerance, "raise the tolerance")


def _from_start(problem: LCP, start: ArrayLike) -> LCPSolution | None:
    """Return the solution of a basic set, mended where it is nearly right, or None."""
    basic_set = first_basic_set(problem, start)
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


def _attempts(problem: LCP, method: Method, tolerance: float) -> Iterator[Attempt]:
    single: dict[str, Callable[[LCP, TimeLimit], LCPSolution]] = {
        "lemke": partial(_lemke, tolerance=tolerance),
        "murty": _timed(solve_murty),
        "psor": _timed(partial(solve_psor, tolerance=0.1 * tolerance)),
        "policy": _timed(solve_policy_iteration),
        "tridiagonal": _timed(solve_tridiagonal_m_matrix),
        "enumeration": _one_by_search,
        "exact": _timed(solve_exact),
    }
    if method in single:
        yield method, single[method]
        if method == "lemke":
            yield PROOF, _refute
    else:
        yield from _automatic_attempts(problem)


def _timed(solver: Callable[..., LCPSolution]) -> Callable[[LCP, TimeLimit], LCPSolution]:
    return lambda problem, limit: solver(problem, time_limit=limit.left())


def _automatic_attempts(problem: LCP) -> Iterator[Attempt]:
    if not isinstance(problem.M, np.ndarray) or problem.size > SMALL:
        yield from _structured_attempts(problem)
    if isinstance(problem.M, np.ndarray) or problem.size <= LARGEST_DENSE:
        yield "lemke", _lemke
        if problem.size > QUICKLY_EXACT:
            yield "lemke-restarted", _lemke_restarted
        yield PROOF, _refute
        if problem.size > QUICKLY_EXACT:
            yield "lemke-pivoted", _lemke_pivoted
        if problem.size > LARGEST_SEARCHED_ORDER:
            yield "murty", _timed(solve_murty)
            yield "policy iteration", _timed(solve_policy_iteration)
    if problem.size <= LARGEST_EXACT_ORDER:
        yield "exact", _timed(solve_exact)


def _structured_attempts(problem: LCP) -> Iterator[Attempt]:
    banded = as_tridiagonal(problem)
    if banded is not None and is_z_matrix(banded) and (banded.diagonal > 0.0).all():
        yield "tridiagonal", _timed(solve_tridiagonal_m_matrix)
    elif isinstance(problem.M, csr_array | Tridiagonal) and is_h_plus_matrix(problem.M):
        if isinstance(problem.M, Tridiagonal):
            yield "policy iteration", _timed(solve_policy_iteration)
        yield "projected sweeps", _timed(solve_h_plus)


def _first_success(problem: LCP, attempts: Iterable[Attempt], limit: TimeLimit) -> LCPSolution:
    failures: list[tuple[str, NumericalError]] = []
    for name, attempt in attempts:
        try:
            return attempt(problem, limit)
        except InfeasibleError:
            raise
        except NumericalError as failure:
            failures.append((name, failure))
        limit.check("solving this problem")
    if not failures:
        raise NumericalError(_too_large(problem))
    found = [failure for name, failure in failures if name != PROOF]
    last = next((failure for failure in found[::-1] if isinstance(failure, RayTerminationError)), found[-1])
    if len(failures) == 1:
        raise last
    raise type(last)(f"{last}; tried without success: {', '.join(name for name, _ in failures)}")


def _too_large(problem: LCP) -> str:
    return (
        f"no method for a sparse matrix of order {problem.size} that is no H+ matrix; try 'psor' or 'policy'"
    )


def _lemke(
    problem: LCP, limit: TimeLimit, covering: ArrayLike | None = None, tolerance: float = DEFAULT_TOLERANCE
) -> LCPSolution:
    return follow_path(problem, covering, None, tolerance, limit)


def _refute(problem: LCP, limit: TimeLimit) -> LCPSolution:
    """Raise InfeasibleError where {z >= 0, M z + q >= 0} is proved to be empty, NumericalError elsewhere."""
    limit.check("solving this problem")
    small = problem.size <= LARGEST_SEARCHED_ORDER
    if (
        feasible(exact_problem(problem).tableau) is None
        if small
        else infeasibility_certificate(problem) is not None
    ):
        raise InfeasibleError(COMBINED)
    raise NumericalError("no proof was found that the problem has no solution")


def _lemke_restarted(problem: LCP, limit: TimeLimit) -> LCPSolution:
    """Try the covering vector of ones, and one of fixed irregular numbers from 1 to 2."""
    irregular = 1.0 + np.modf(GOLDEN * np.arange(1, problem.size + 1))[0]
    coverings = np.ones(problem.size), irregular / equilibrate(problem).row
    found = _first_success(
        problem, ((f"covering {k}", partial(_lemke, covering=d)) for k, d in enumerate(coverings, 1)), limit
    )
    return replace(found, method="lemke-restarted")


def _lemke_pivoted(problem: LCP, limit: TimeLimit) -> LCPSolution:
    """Start Lemke's method from other complementary bases: after a small principal pivot.

    For a bimatrix game, where every positive covering vector ends on a ray at once, this is close to the
    method of Lemke and Howson, which starts from an edge of one player's polyhedron.
    """
    scaled = equilibrate(problem)
    near = LCP(scaled.M, scaled.q)
    sets = enumerate(_small_pivot_sets(scaled.M), 1)
    pivoted = ((f"pivot {k}", partial(_from_pivot, pivot_set=chosen)) for k, chosen in sets)
    found = _first_success(near, pivoted, limit)
    z, remedy = scaled.original(found.z), "use another method"
    return verified(problem, z, found.iterations, "lemke-pivoted", DEFAULT_TOLERANCE, remedy)


def _small_pivot_sets(M: Matrix) -> Iterator[BoolVector]:
    """Yield {i, j} for the first few i, j the index of the largest |m_ij m_ji|; {i} if that is i."""
    for i in range(min(LARGEST_PIVOT_TRIALS, len(M))):
        products = np.abs(M[i] * M[:, i])
        if products.any():
            yield np.isin(np.arange(len(M)), (i, int(np.argmax(products))))


def _from_pivot(problem: LCP, limit: TimeLimit, pivot_set: BoolVector) -> LCPSolution:
    transformed = principal_pivot(problem, pivot_set)
    found = _lemke(transformed, limit)
    z = basic_point(problem, np.where(pivot_set, found.z == 0.0, found.z > 0.0))
    return verified(problem, z, found.iterations, "lemke-pivoted", DEFAULT_TOLERANCE, "use another method")


def _one_by_search(problem: LCP, limit: TimeLimit) -> LCPSolution:
    found = enumerate_solutions(problem, time_limit=limit.left())
    for z in (*(point.z for point in found.isolated), *(face.vertices[0] for face in found.faces)):
        with suppress(NumericalError):
            return verified(problem, z, found.nodes, "enumeration", DEFAULT_TOLERANCE, "use another method")
    return _by_exact_search(problem, limit)


def _by_exact_search(problem: LCP, limit: TimeLimit) -> LCPSolution:
    posed = exact_problem(problem)
    if feasible(posed.tableau) is None:
        raise InfeasibleError(COMBINED)
    return solution_of(problem, rounded(values_by_search(posed, limit)[problem.size :]), 0, "enumeration")
