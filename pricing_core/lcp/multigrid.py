"""Large sparse problems: active sets whose linear systems are solved by algebraic multigrid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, diags_array

from pricing_core.arrays import Vector, as_array, as_vector
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp.free_sets import DIVERGED, FreeSets
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCPSolution,
    Problem,
    as_tolerance,
    check_problem,
    inside,
    scaled_residual,
    solution_of,
    verified,
)
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.coefficients import diagonal_of, is_symmetric, sparse
from pricing_core.linalg.multigrid import Multigrid

Callback = Callable[[int, float], object]

SHARE_OF_Q = 1e-9  # natural residual, relative to max |q|, at which the iteration ends if rounding lets it
SOLVED = 1e-13  # scaled residual at which it ends
MOST_SWEEPS = 200
COARSE_SHARE, COARSE_ITERATIONS = 1e-4, 6
REMEDY = "M may be neither positive definite nor an M-matrix: try method='policy', 'psor', or a start"


def solve_multigrid(
    problem: Problem,
    *,
    start: ArrayLike | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    time_limit: float | None = None,
    callback: Callback | None = None,
) -> LCPSolution:
    """Solve a problem with a large sparse M: symmetric positive definite, an M-matrix, or H+ and nearly one.

    Each iteration takes some projected Gauss-Seidel sweeps, calls free the unknowns that are off their bounds or are
    drawn from them, and improves those together by conjugate gradients, or GMRES, preconditioned by multigrid. For a
    symmetric M no step raises z'Mz/2 + q'z. Without a start, the problem is first solved on coarser matrices
    (P'MP, P'q), each from the coarser one, so that few unknowns change sides on the finest.

    Parameters
    ----------
    problem : LCP or MixedLCP
        M with a positive diagonal; dense and tridiagonal ones are made sparse.
    start : array_like, shape (n,), optional
        A z, from which the iteration starts instead; or a basic set (bool), whose other unknowns start at zero.
    tolerance : float
        Largest `scaled_residual` of the answer. The iteration goes on to a natural residual of 1e-9 max |q| and a
        scaled one of 1e-13, or to what rounding allows.
    time_limit : float, optional
        Seconds.
    callback : callable, optional
        Told (iteration, natural residual) before every linear system; ends the work where it returns True.

    Returns
    -------
    LCPSolution
        `iterations` counts the linear systems on the finest matrix; `method` is "multigrid", or "projected-sweeps"
        where the first sweeps show that they are enough.

    Raises
    ------
    InvalidInputError
        A diagonal entry is not positive, or an option is of the wrong kind.
    IterationLimitError
        The residual stopped falling, `time_limit` was too short, or the callback ended the work; `best` is the best
        point. Where the residual stopped falling M is as a rule in none of these classes.
    NumericalError
        No coarser matrices could be made.

    Notes
    -----
    Cost: O(nnz) time and memory for the matrices of elliptic problems. Source: Hintermüller, Ito, Kunisch 2003 (the
    active sets); Kornhuber 1994 and Gräser, Kornhuber 2009 (projected sweeps, then a linear step on the free unknowns).

    Examples
    --------
    >>> from scipy.sparse import csr_array
    >>> from pricing_core.lcp.problem import LCP
    >>> solve_multigrid(LCP(csr_array([[2.0, -1.0], [-1.0, 2.0]]), [1.0, -2.0])).z
    array([0., 1.])
    """
    check_problem(problem)
    tolerance, clock = as_tolerance(tolerance), TimeLimit(time_limit)
    M = sparse(problem.M)
    if not (diagonal_of(M) > 0.0).all():
        least = float(diagonal_of(M).min(initial=0.0))
        raise InvalidInputError("M", least, "a matrix with a positive diagonal, for multigrid")
    symmetric, q = is_symmetric(M), problem.q
    if not symmetric:  # rows in other units have the same solutions, and may hide that M is symmetric
        inverse = 1.0 / diagonal_of(M)
        M, q = csr_array(diags_array(inverse) @ M), inverse * q
        symmetric = is_symmetric(M)
    finest = FreeSets(M, q, problem.lower, problem.upper, symmetric)
    watch = _Watch(problem, finest, callback)
    z, sweeps, done = finest.swept_out(_first_point(problem, start), watch.is_solved, MOST_SWEEPS, clock)
    if done:
        return verified(problem, z, sweeps, "projected-sweeps", tolerance, REMEDY)
    try:
        if start is None:
            z = _from_coarser(finest, z, clock)
        z, iterations = finest.improved(z, watch, clock)
    except IterationLimitError as failure:
        failure.best = watch.best()
        raise
    return verified(problem, z, iterations, "multigrid", tolerance, REMEDY)


def _first_point(problem: Problem, start: ArrayLike | None) -> Vector:
    if start is None or as_array("start", start).dtype == np.bool_:
        return inside(problem, np.zeros(problem.size))
    return inside(problem, as_vector("start", start, problem.size))


def _from_coarser(finest: FreeSets, first: Vector, clock: TimeLimit) -> Vector:
    """Return the point that the solutions of the coarser problems lead to, each solved from the coarser one.

    It is `first` where coarser unknowns are no values of some of the finer ones, or where they
    led far away, as for an indefinite M.
    """
    if finest.near_null is not None:
        return first
    hierarchy = Multigrid.of(finest.M, None)
    levels = [finest]
    for M, transfer in zip(hierarchy.matrices[1:], hierarchy.transfers, strict=True):
        fine, points = levels[-1], transfer.points
        q = np.asarray(transfer.prolongation.T @ fine.q)
        levels.append(FreeSets(M, q, fine.lower[points], fine.upper[points], fine.symmetric))
    coarsest = levels[-1]
    z = np.clip(np.zeros(coarsest.q.size), coarsest.lower, coarsest.upper)
    for level, transfer in zip(levels[:0:-1], hierarchy.transfers[::-1], strict=True):
        goal = COARSE_SHARE * float(np.abs(level.q).max(initial=0.0))
        z, _ = level.improved(z, _Until(goal), clock, COARSE_ITERATIONS)
        z = np.asarray(transfer.prolongation @ z)
    z = np.clip(z, finest.lower, finest.upper)
    swept, led = (finest.residual(at, finest.M @ at + finest.q) for at in (first, z))
    return z if led <= DIVERGED * swept else first


class _Until:
    """Ends an iteration on a coarser matrix at a residual."""

    def __init__(self, goal: float) -> None:
        self.goal = goal

    def __call__(self, iteration: int, residual: float, z: Vector) -> bool:
        return residual <= self.goal


class _Watch:
    """Ends the iteration on the finest matrix, and keeps its best point."""

    def __init__(self, problem: Problem, level: FreeSets, callback: Callback | None) -> None:
        self.problem, self.level, self.callback = problem, level, callback
        self.share = SHARE_OF_Q * float(np.abs(level.q).max(initial=0.0))
        self.least, self.point = np.inf, level.q

    def is_solved(self, residual: float, z: Vector) -> bool:
        """Tell whether the residual is at its share of q, or at rounding level, and the scaled one small as well."""
        if residual > self.share and residual > self.level.rounding(z):
            return False
        return scaled_residual(self.problem, z) <= SOLVED

    def __call__(self, iteration: int, residual: float, z: Vector) -> bool:
        if residual < self.least:
            self.least, self.point = residual, z
        if self.callback is not None and self.callback(iteration, residual) is True:
            raise IterationLimitError(
                f"the callback ended the work after {iteration} iterations of multigrid"
            )
        return self.is_solved(residual, z)

    def best(self) -> LCPSolution | None:
        """Return the point with the smallest residual so far."""
        return None if np.isinf(self.least) else solution_of(self.problem, self.point, 0, "multigrid")
