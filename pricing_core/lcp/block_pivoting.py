"""Block principal pivoting: all unknowns with a wrong sign change sides at once, one at a time where that stalls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Vector, as_array, as_vector, as_whole_number
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp.basis import point_between
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCPSolution,
    Problem,
    check_problem,
    inside,
    natural_residual,
    solution_of,
    verified,
    weights_and_slack,
)
from pricing_core.lcp.time_limit import TimeLimit

VIOLATION = 1e-13  # scaled: smaller numbers of the wrong sign are rounding
PATIENCE = 10  # blocks without fewer wrong signs, after which single unknowns change sides
REMEDY = "M may be no P-matrix: use method='lemke'"

Sides = NDArray[np.int8]  # (n,): -1 at the lower bound, 1 at the upper one, 0 with w = 0


def solve_block_pivoting(
    problem: Problem,
    *,
    start: ArrayLike | None = None,
    max_iterations: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[int, float], object] | None = None,
) -> LCPSolution:
    """Solve a problem with a P-matrix, as a rule in about ten factorisations whatever its order.

    Unknowns stand at a bound, or are basic, with w = 0. All with a wrong sign change sides together as long as their
    number falls, or for ten more rounds; then the last one of them alone, until there are fewer. For a P-matrix the
    method ends (Júdice and Pires 1994).

    Parameters
    ----------
    problem : LCP or MixedLCP
        For a free unknown w = 0 always.
    start : array_like, shape (n,), optional
        Boolean: the first basic set. Numbers: the first z. Default: bounds nearest to zero.
    max_iterations : int, optional
        Default 1000 + 50 n. Each costs a factorisation of the matrix of the basic unknowns.
    time_limit : float, optional
        Seconds.
    callback : callable, optional
        Told (iteration, natural residual) after every factorisation; ends the work where it returns True.

    Returns
    -------
    LCPSolution
        `iterations` counts the linear systems.

    Raises
    ------
    IterationLimitError
        `max_iterations` or `time_limit` were not enough, or the callback ended the work; `best` is the last point.
    NumericalError
        The matrix of the basic unknowns is singular: M is no P-matrix.

    Notes
    -----
    Source: Júdice and Pires 1994, a block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems; the single steps are Murty's 1974.

    Examples
    --------
    >>> from pricing_core.lcp.mixed import MixedLCP
    >>> solve_block_pivoting(MixedLCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, 1.0], [0.0, -np.inf], [1.0, np.inf])).z
    array([ 1., -1.])
    """
    check_problem(problem)
    limit = (
        1000 + 50 * problem.size
        if max_iterations is None
        else as_whole_number("max_iterations", max_iterations, 1)
    )
    clock, sides = TimeLimit(time_limit), _first_sides(problem, start)
    fewest, patience = problem.size + 1, PATIENCE
    for iteration in range(1, limit + 1):
        clock.check("block principal pivoting")
        z = point_between(problem, sides)
        better = _better_sides(problem, z, sides)
        wrong = np.flatnonzero(better != sides)
        if wrong.size == 0:
            return verified(problem, z, iteration, "block-pivoting", DEFAULT_TOLERANCE, REMEDY)
        if (
            callback is not None
            and callback(iteration, natural_residual(problem, inside(problem, z))) is True
        ):
            raise _ended(problem, z, iteration, "the callback ended block principal pivoting")
        if wrong.size < fewest:
            fewest, patience = wrong.size, PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            wrong = wrong[-1:]
        sides[wrong] = better[wrong]
    raise _ended(problem, z, limit, f"block principal pivoting did not end within {limit} systems")


def _ended(problem: Problem, z: Vector, iterations: int, message: str) -> IterationLimitError:
    failure = IterationLimitError(f"{message}, and nothing is proved: {REMEDY}")
    failure.best = solution_of(problem, inside(problem, z), iterations, "block-pivoting")
    return failure


def _first_sides(problem: Problem, start: ArrayLike | None) -> Sides:
    lower, upper = problem.lower, problem.upper
    near_lower = np.abs(lower) <= np.abs(upper)
    at_bound = np.where(np.isinf(lower) & np.isinf(upper), 0, np.where(near_lower, -1, 1)).astype(np.int8)
    given = None if start is None else as_array("start", start)
    if given is not None and given.dtype == np.bool_:
        if given.shape != (problem.size,):
            raise InvalidInputError("start", f"shape {given.shape}", f"a vector of length {problem.size}")
        return np.where(given, 0, at_bound).astype(np.int8)
    if start is None:
        z = np.where(at_bound < 0, lower, np.where(at_bound > 0, upper, 0.0))
    else:
        z = as_vector("start", start, problem.size)
    target = z - problem.slack(z)
    return np.where(target <= lower, -1, np.where(target >= upper, 1, 0)).astype(np.int8)


def _better_sides(problem: Problem, z: Vector, sides: Sides) -> Sides:
    """Return the sides that the signs of z - lower, z - upper and w ask for."""
    weights, slack = weights_and_slack(problem, z)
    with np.errstate(invalid="ignore"):  # an infinite distance with the weight zero is no violation
        below = (sides == 0) & ((z - problem.lower) * weights < -VIOLATION)
        above = (sides == 0) & ((z - problem.upper) * weights > VIOLATION)
    drawn = ((sides < 0) & (slack < -VIOLATION)) | ((sides > 0) & (slack > VIOLATION))
    fixed = problem.lower == problem.upper
    better = np.where(below, -1, np.where(above, 1, np.where(drawn & ~fixed, 0, sides)))
    return better.astype(np.int8)
