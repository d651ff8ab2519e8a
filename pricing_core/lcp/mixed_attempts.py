"""The methods that `solve` tries on a mixed linear complementarity problem, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from pricing_core.errors import InfeasibleError, NumericalError, RayTerminationError
from pricing_core.lcp.attempts import (
    LARGEST_DENSE,
    MOST_BLOCKS,
    Asked,
    Attempt,
    Method,
    attempts,
    first_success,
    single_methods,
    sparse_attempts,
)
from pricing_core.lcp.block_pivoting import solve_block_pivoting
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.mixed_reduction import Reduction, eliminated, one_sided, split
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCPSolution, inside, solution_of, verified
from pricing_core.lcp.time_limit import TimeLimit

REMEDY = "scale the rows and columns of M, or use method='block-pivoting'"
ROUNDED = (
    "the problem with its bounds moved to zero, in which numbers were rounded, has no solution, which proves nothing "
    "here: move the bounds to numbers that floating point adds without rounding"
)
NATIVE = ("psor", "multigrid", "block-pivoting", "projected-gradients")


def mixed_attempts(problem: MixedLCP, method: Method, asked: Asked) -> Iterator[Attempt]:
    """Yield the methods for a mixed problem: those that know bounds, and LCPs that stand for it."""
    if method in NATIVE:
        yield Attempt(method, single_methods(asked)[method])
        return
    if (np.isinf(problem.lower) != np.isinf(problem.upper)).all():
        yield Attempt("one bound each", partial(_by_lcp, reduce=_one_sided, method=method, asked=asked))
        return
    if method == "auto":
        if isinstance(problem.M, csr_array):
            yield from sparse_attempts(problem, asked)
        blocks = partial(
            solve_block_pivoting, start=asked.start, max_iterations=MOST_BLOCKS, callback=asked.callback
        )
        reason = "bounds on both sides, or free unknowns"
        yield Attempt("block pivoting", lambda given, limit: blocks(given, time_limit=limit.left()), reason)
    if problem.size <= LARGEST_DENSE:
        if method not in {"exact", "enumeration"}:
            yield Attempt("elimination", partial(_by_lcp, reduce=eliminated, method=method, asked=asked))
        yield Attempt("splitting", partial(_by_lcp, reduce=split, method=method, asked=asked))


def _one_sided(problem: MixedLCP) -> Reduction:
    found = one_sided(problem)
    assert found is not None
    return found


def _by_lcp(
    problem: MixedLCP,
    limit: TimeLimit,
    reduce: Callable[[MixedLCP], Reduction],
    method: Method,
    asked: Asked,
) -> LCPSolution:
    reduction = reduce(problem)
    asked = asked._replace(start=None)
    try:
        found = first_success(reduction.lcp, attempts(reduction.lcp, method, asked), limit)
    except InfeasibleError as proof:
        if reduction.is_exact:
            raise
        raise RayTerminationError(ROUNDED) from proof
    except NumericalError as failure:
        if failure.best is not None:
            z = inside(problem, reduction.back(failure.best.z))
            failure.best = solution_of(problem, z, failure.best.iterations, failure.best.method)
        raise
    z = reduction.back(found.z)
    return verified(problem, z, found.iterations, found.method, DEFAULT_TOLERANCE, REMEDY)
