"""Solve a linear complementarity problem: choose a method, check its answer, say which method gave it."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from scipy.sparse import csr_array

from pricing_core.arrays import BoolVector, Matrix
from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError, RayTerminationError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.enumeration import LARGEST_ORDER, LARGEST_SPAN, enumerate_solutions
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.lemke import solve_lemke
from pricing_core.lcp.murty import solve_murty
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.principal_pivot import principal_pivot
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, solution_of, verified
from pricing_core.lcp.psor import solve_psor
from pricing_core.lcp.scaling import equilibrate, span_of_scales
from pricing_core.lcp.tridiagonal import as_tridiagonal, solve_brennan_schwartz, solve_double_sweep
from pricing_core.linalg.coefficients import diagonal_of
from pricing_core.linalg.matrix_classes import is_m_matrix, is_z_matrix

Method: TypeAlias = Literal["auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration"]
METHODS = ("auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration")
Attempt: TypeAlias = Callable[[LCP], LCPSolution]

WARM_TOLERANCE = 1e-13  # scaled residual at which a basic set from elsewhere is taken for the solution
LARGEST_DENSE = 3000  # sparse problems up to this order may be made dense for Lemke's method
LARGEST_PIVOT_TRIALS = 8
GOLDEN = 0.6180339887498949


def solve(
    problem: LCP,
    *,
    method: Method = "auto",
    tolerance: float = DEFAULT_TOLERANCE,
    start: BoolVector | None = None,
) -> LCPSolution:
    """Solve an LCP, or say what is known about why not.

    method="auto" takes the first of these that gives a point with a small residual, and names it in `solution.method`:

    1. Tridiagonal Z-matrix with positive diagonal: Brennan-Schwartz from the first end, then from the last,
       the double sweep, policy iteration. All O(n).
    2. Sparse M-matrix: policy iteration.
    3. Lemke's method with its own covering vector ("lemke"). If it ends on a ray, linear programming looks
       for a proof that the problem is infeasible.
    4. Lemke's method with other covering vectors ("lemke-restarted"), and from other bases ("lemke-pivoted"),
       which helps where every covering vector fails, as in bimatrix games.
    5. Murty's least-index pivoting ("murty"), policy iteration ("policy-iteration").
    6. For n <= 20 enumeration ("enumeration"). Where it finds nothing, that counts as a proof for data within
       the scales for which it is complete, see `enumerate_solutions`.

    Steps 3 to 5 are left out for sparse problems with n > 3000.

    Parameters
    ----------
    problem : LCP
    method : {"auto", "lemke", "murty", "psor", "policy", "tridiagonal", "enumeration"}
        "tridiagonal" is step 1 for any tridiagonal M; the others are the single methods.
    tolerance : float
        Largest `scaled_residual` of an answer, > 0 and < 1. It is relative to the size of the terms in each
        row, so it means the same whatever the units of rows and columns. Only "psor" works harder for a
        smaller one; direct methods are at rounding level.

    Returns
    -------
    LCPSolution

    Raises
    ------
    InfeasibleError
        There is no solution: shown by an exact certificate for {z >= 0, M z + q >= 0}, or by an enumeration
        in floating point of data whose scales span at most a factor 1e3.
    RayTerminationError
        Lemke's method ended on rays, nothing else helped, and nothing is proved.
    IterationLimitError, NumericalError
        The method could not answer, or its answer does not meet the tolerance.
    InvalidInputError
        An unknown method, a tolerance out of range, or a matrix that the named method does not take.

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
    if method not in METHODS:
        raise InvalidInputError("method", method, "one of " + ", ".join(METHODS))
    if not 0.0 < tolerance < 1.0:
        raise InvalidInputError("tolerance", tolerance, "> 0 and < 1")
    if problem.size == 0:
        return solution_of(problem, np.zeros(0), 0, method)
    if start is not None and (known := _at_basic_set(problem, start)) is not None:
        return known
    found = _first_success(problem, _attempts(problem, method, tolerance))
    return verified(problem, found.z, found.iterations, found.method, tolerance, "raise the tolerance")


def _at_basic_set(problem: LCP, basic_set: BoolVector) -> LCPSolution | None:
    if basic_set.shape != (problem.size,):
        raise InvalidInputError("start", f"shape {basic_set.shape}", f"a vector of length {problem.size}")
    try:
        return verified(
            problem, basic_point(problem, basic_set), 1, "start", WARM_TOLERANCE, "not a solution"
        )
    except NumericalError:
        return None


def _attempts(problem: LCP, method: Method, tolerance: float) -> Iterator[Attempt]:
    single: dict[str, Attempt] = {
        "lemke": partial(solve_lemke, tolerance=tolerance),
        "murty": solve_murty,
        "psor": partial(solve_psor, tolerance=0.1 * tolerance),
        "policy": solve_policy_iteration,
        "enumeration": _one_by_enumeration,
    }
    if method in single:
        yield single[method]
    elif method == "tridiagonal":
        yield from _tridiagonal_attempts()
    else:
        yield from _automatic_attempts(problem)


def _automatic_attempts(problem: LCP) -> Iterator[Attempt]:
    if (
        as_tridiagonal(problem) is not None
        and is_z_matrix(problem.M)
        and (diagonal_of(problem.M) > 0.0).all()
    ):
        yield from _tridiagonal_attempts()
    elif isinstance(problem.M, csr_array) and is_m_matrix(problem.M):
        yield solve_policy_iteration
    if isinstance(problem.M, np.ndarray) or problem.size <= LARGEST_DENSE:
        yield solve_lemke
        yield _lemke_restarted
        yield _lemke_pivoted
        yield solve_murty
        yield solve_policy_iteration
    if problem.size <= LARGEST_ORDER:
        yield _one_by_enumeration


def _tridiagonal_attempts() -> Iterator[Attempt]:
    yield solve_brennan_schwartz
    yield partial(solve_brennan_schwartz, contact="last")
    yield solve_double_sweep
    yield solve_policy_iteration


def _first_success(problem: LCP, attempts: Iterator[Attempt]) -> LCPSolution:
    failures: list[NumericalError] = []
    for attempt in attempts:
        try:
            return attempt(problem)
        except InfeasibleError:
            raise
        except NumericalError as failure:
            failures.append(failure)
    rays = [failure for failure in failures if isinstance(failure, RayTerminationError)]
    raise (rays or failures or [NumericalError(_too_large(problem))])[-1]


def _too_large(problem: LCP) -> str:
    return (
        f"no method for a sparse matrix of order {problem.size} that is no M-matrix; try 'psor' or 'policy'"
    )


def _lemke_restarted(problem: LCP) -> LCPSolution:
    """Try the covering vector of ones, and one of fixed irregular numbers from 1 to 2."""
    irregular = 1.0 + np.modf(GOLDEN * np.arange(1, problem.size + 1))[0]
    coverings = np.ones(problem.size), irregular / equilibrate(problem).row
    found = _first_success(problem, (partial(solve_lemke, covering=d) for d in coverings))
    return solution_of(problem, found.z, found.iterations, "lemke-restarted")


def _lemke_pivoted(problem: LCP) -> LCPSolution:
    """Start Lemke's method from other complementary bases: after a small principal pivot.

    For a bimatrix game, where every positive covering vector ends on a ray at once, this is close to the
    method of Lemke and Howson, which starts from an edge of one player's polyhedron.
    """
    scaled = equilibrate(problem)
    near = LCP(scaled.M, scaled.q)
    found = _first_success(near, (partial(_from_pivot, pivot_set=s) for s in _small_pivot_sets(scaled.M)))
    return solution_of(problem, scaled.original(found.z), found.iterations, "lemke-pivoted")


def _small_pivot_sets(M: Matrix) -> Iterator[BoolVector]:
    """Yield {i, j} for the first few i, j the index of the largest |m_ij m_ji|; {i} if that is i."""
    for i in range(min(LARGEST_PIVOT_TRIALS, len(M))):
        products = np.abs(M[i] * M[:, i])
        if products.any():
            yield np.isin(np.arange(len(M)), (i, int(np.argmax(products))))


def _from_pivot(problem: LCP, pivot_set: BoolVector) -> LCPSolution:
    transformed = principal_pivot(problem, pivot_set)
    found = solve_lemke(transformed)
    z = basic_point(problem, np.where(pivot_set, found.z == 0.0, found.z > 0.0))
    return verified(problem, z, found.iterations, "lemke-pivoted", DEFAULT_TOLERANCE, "use another method")


def _one_by_enumeration(problem: LCP) -> LCPSolution:
    found = enumerate_solutions(problem)
    if found.isolated:
        return found.isolated[0]
    if found.faces:
        return solution_of(problem, found.faces[0].vertices[0], found.nodes, "enumeration")
    if infeasibility_certificate(problem) is not None:
        raise InfeasibleError("no z >= 0 has M z + q >= 0: a combination of its rows proves it")
    if (span := span_of_scales(equilibrate(problem))) > LARGEST_SPAN:
        raise NumericalError(
            f"enumeration found no solution, but the scales of the equilibrated data span a factor {span:.0e}, "
            f"more than {LARGEST_SPAN:.0e}, and that proves nothing: use units in which the data are closer"
        )
    raise InfeasibleError("a complete enumeration of the complementary cones shows that there is no solution")
