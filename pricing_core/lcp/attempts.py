"""The methods that `solve` tries on a linear complementarity problem, in order, each with the reason for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import BoolVector, Matrix
from pricing_core.errors import InfeasibleError, IterationLimitError, NumericalError, RayTerminationError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.block_pivoting import solve_block_pivoting
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
from pricing_core.lcp.integer_programme import solve_by_integer_programme
from pricing_core.lcp.lemke import follow_path
from pricing_core.lcp.multigrid import solve_multigrid
from pricing_core.lcp.murty import solve_murty
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.principal_pivot import principal_pivot
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCP,
    LCPSolution,
    Problem,
    inside,
    scaled_residual,
    solution_of,
    verified,
)
from pricing_core.lcp.projected_gradients import solve_projected_gradients
from pricing_core.lcp.psor import solve_psor
from pricing_core.lcp.scaling import equilibrate
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.lcp.tridiagonal import as_tridiagonal, solve_tridiagonal_m_matrix
from pricing_core.linalg.coefficients import diagonal_of, is_symmetric
from pricing_core.linalg.matrix_classes import is_h_plus_matrix, is_z_matrix
from pricing_core.linalg.polynomial_tableau import feasible
from pricing_core.linalg.tridiagonal import Tridiagonal

Method: TypeAlias = Literal[
    "auto",
    "lemke",
    "murty",
    "psor",
    "policy",
    "tridiagonal",
    "multigrid",
    "block-pivoting",
    "projected-gradients",
    "enumeration",
    "exact",
]
METHODS: tuple[str, ...] = get_args(Method)

QUICKLY_EXACT = 6  # order up to which rational arithmetic costs less than other paths in floating point
SMALL = 10  # a dense matrix up to this order is not worth a look at its structure
LARGEST_DENSE = (
    3000  # sparse problems up to this order are factored, and may be made dense for Lemke's method
)
LARGEST_FACTORED = 30_000  # order up to which sparse problems are factored where nothing else has helped
BLOCKS = 200  # order of a dense matrix from which a few factorisations cost less than Lemke's pivots
MOST_BLOCKS = 40
MOST_POLICIES = 200  # linear systems; a few are usual
LARGEST_PIVOT_TRIALS = 8
GOLDEN = 0.6180339887498949
FAR = 10.0  # times the residual of z = 0 up to which a point may be called the best that was met
OVER = "the end of the time"
BEST = "; the best point met (`best`) has a residual of "
PROOF = "a proof that there is no solution"
COMBINED = "no z >= 0 has M z + q >= 0: a combination of its rows proves it"


class Asked(NamedTuple):
    """The arguments of `solve` besides the problem."""

    tolerance: float = DEFAULT_TOLERANCE
    start: ArrayLike | None = None
    callback: Callable[[int, float], object] | None = None


class Attempt(NamedTuple):
    """A method with its name and the reason why it is tried."""

    name: str
    run: Callable[[Any, TimeLimit], LCPSolution]
    reason: str = ""


def attempts(problem: LCP, method: Method, asked: Asked) -> Iterator[Attempt]:
    """Yield the method that was asked for, or those that "auto" stands for."""
    if method == "auto":
        yield from automatic_attempts(problem, asked)
    else:
        yield Attempt(method, single_methods(asked)[method])
        if method == "lemke":
            yield Attempt(PROOF, _refute)


def single_methods(asked: Asked) -> dict[str, Callable[[Any, TimeLimit], LCPSolution]]:
    """Return the methods by their names."""
    return {
        "lemke": partial(_lemke, tolerance=asked.tolerance),
        "murty": _timed(solve_murty),
        "psor": _timed(partial(solve_psor, tolerance=0.1 * asked.tolerance)),
        "policy": _timed(solve_policy_iteration),
        "tridiagonal": _timed(solve_tridiagonal_m_matrix),
        "multigrid": _timed(
            partial(solve_multigrid, start=asked.start, tolerance=asked.tolerance, callback=asked.callback)
        ),
        "block-pivoting": _timed(partial(solve_block_pivoting, callback=asked.callback)),
        "projected-gradients": _timed(
            partial(
                solve_projected_gradients,
                start=asked.start,
                tolerance=asked.tolerance,
                callback=asked.callback,
            )
        ),
        "enumeration": _one_by_search,
        "exact": _timed(solve_exact),
    }


def _timed(solver: Callable[..., LCPSolution]) -> Callable[[Any, TimeLimit], LCPSolution]:
    return lambda problem, limit: solver(problem, time_limit=limit.left())


def automatic_attempts(problem: LCP, asked: Asked) -> Iterator[Attempt]:
    """Yield the methods of method="auto", as the docstring of `solve` has them."""
    is_dense = isinstance(problem.M, np.ndarray)
    if not is_dense or problem.size > SMALL:
        yield from _structured_attempts(problem, asked)
    if is_dense and problem.size >= BLOCKS:
        blocks = partial(solve_block_pivoting, max_iterations=MOST_BLOCKS, callback=asked.callback)
        yield Attempt("block pivoting", _timed(blocks), f"dense, of order {BLOCKS} or more")
    if is_dense or problem.size <= LARGEST_DENSE:
        yield Attempt("lemke", _lemke, "no cheaper method fits")
        if problem.size > QUICKLY_EXACT:
            yield Attempt("lemke-restarted", _lemke_restarted, "Lemke's first path gave no solution")
        yield Attempt(PROOF, _refute)
        if problem.size > QUICKLY_EXACT:
            yield Attempt(
                "lemke-pivoted", _lemke_pivoted, "Lemke's paths from the first basis gave no solution"
            )
        if problem.size > LARGEST_SEARCHED_ORDER:
            for name, solver in (("murty", solve_murty), ("policy iteration", solve_policy_iteration)):
                yield Attempt(name, _timed(solver), "Lemke's paths gave no solution")
    if problem.size <= LARGEST_EXACT_ORDER:
        yield Attempt("exact", _timed(solve_exact), "floating point found no solution")
        if problem.size > LARGEST_SEARCHED_ORDER:
            yield Attempt("integer programme", _timed(solve_by_integer_programme), "no path gave a solution")


def _structured_attempts(problem: LCP, asked: Asked) -> Iterator[Attempt]:
    banded = as_tridiagonal(problem)
    if banded is not None and is_z_matrix(banded) and (banded.diagonal > 0.0).all():
        yield Attempt(
            "tridiagonal", _timed(solve_tridiagonal_m_matrix), "tridiagonal Z-matrix, positive diagonal"
        )
    elif isinstance(problem.M, Tridiagonal) and is_h_plus_matrix(problem.M):
        yield Attempt("policy iteration", _timed(solve_policy_iteration), "tridiagonal H+ matrix")
    if isinstance(problem.M, csr_array):
        yield from sparse_attempts(problem, asked)


def sparse_attempts(problem: Problem, asked: Asked) -> Iterator[Attempt]:
    """Yield the methods for a sparse matrix of a class that they serve."""
    kind = sparse_class(problem)
    if kind is None:
        return
    if problem.size <= LARGEST_DENSE:
        if isinstance(problem, LCP) and kind != SYMMETRIC:
            policies = _timed(partial(solve_policy_iteration, max_iterations=MOST_POLICIES))
            yield Attempt("policy iteration", policies, f"{kind} up to order {LARGEST_DENSE}")
        blocks = partial(solve_block_pivoting, max_iterations=MOST_BLOCKS, callback=asked.callback)
        yield Attempt("block pivoting", _timed(blocks), f"{kind} up to order {LARGEST_DENSE}")
    # Its tolerance decides about a result at once, where that of direct methods is at rounding level anyway.
    run = partial(solve_multigrid, start=asked.start, callback=asked.callback)
    yield Attempt("multigrid", _timed(run), kind)
    if LARGEST_DENSE < problem.size <= LARGEST_FACTORED:
        direct = partial(solve_block_pivoting, max_iterations=MOST_BLOCKS, callback=asked.callback)
        yield Attempt("block pivoting", _timed(direct), f"{kind}, on which multigrid did not end")


SYMMETRIC = "sparse symmetric matrix, positive diagonal"


def sparse_class(problem: Problem) -> str | None:
    """Return the words for the class of a sparse matrix that sweeps and multigrid serve, None where it is in none."""
    if not (diagonal_of(problem.M) > 0.0).all():
        return None
    if is_z_matrix(problem.M):
        return "sparse Z-matrix, positive diagonal"
    if is_symmetric(problem.M):
        return SYMMETRIC
    return "sparse H+ matrix" if is_h_plus_matrix(problem.M) else None


def first_success(problem: Problem, attempts: Iterable[Attempt], limit: TimeLimit) -> LCPSolution:
    """Return the first solution, or raise what the failures say together, with the best point of them all."""
    failures: list[tuple[str, NumericalError]] = []
    for name, run, reason in attempts:
        try:
            return replace(run(problem, limit), reason=reason)
        except InfeasibleError:
            raise
        except NumericalError as failure:
            failures.append((name, failure))
        try:
            limit.check("solving this problem")
        except IterationLimitError as over:
            failures.append((OVER, over))
            break
    if not failures:
        raise NumericalError(_too_large(problem))
    raise _summary(problem, failures)


def _summary(problem: Problem, failures: list[tuple[str, NumericalError]]) -> NumericalError:
    found = [failure for name, failure in failures if name != PROOF]
    last = next((failure for failure in found[::-1] if isinstance(failure, RayTerminationError)), found[-1])
    if failures[-1][0] == OVER:
        last = found[-1]
    tried = [name for name, _ in failures if name != OVER]
    best = _best(problem, [failure for _, failure in failures])
    others = f"; tried without success: {', '.join(tried)}" if len(tried) > 1 else ""
    said, _, _ = str(last).partition(BEST)
    summary = type(last)(f"{said}{others}{BEST}{best.residual:.1e}")
    summary.best = best
    return summary


def _best(problem: Problem, failures: list[NumericalError]) -> LCPSolution:
    """Return the point with the smallest scaled residual that the failures carry, or the one nearest to zero."""
    zero = solution_of(problem, inside(problem, np.zeros(problem.size)), 0, "zero")
    carried = [failure.best for failure in failures if failure.best is not None]
    # Far out, where q is lost, scaled residuals are small: such a point is worse than none.
    usable = [p for p in carried if p.z.shape == problem.q.shape and p.residual <= FAR * zero.residual]
    with np.errstate(all="ignore"):  # numbers near the end of the range make no residual, and lose
        residuals = [scaled_residual(problem, point.z) for point in (*usable, zero)]
    points: list[LCPSolution] = [*usable, zero]
    return points[int(np.argmin(np.nan_to_num(residuals, nan=np.inf)))]


def _too_large(problem: Problem) -> str:
    return (
        f"no method for a sparse matrix of order {problem.size} that is no H+ matrix, no Z-matrix and not symmetric; "
        "try 'block-pivoting', 'policy' or 'psor'"
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
    found = first_success(
        problem,
        (Attempt(f"covering {k}", partial(_lemke, covering=d)) for k, d in enumerate(coverings, 1)),
        limit,
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
    pivoted = (Attempt(f"pivot {k}", partial(_from_pivot, pivot_set=chosen)) for k, chosen in sets)
    found = first_success(near, pivoted, limit)
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
