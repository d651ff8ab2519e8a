"""Conjugate gradients on the free unknowns and projected gradient steps: symmetric problems by products alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_vector, as_whole_number
from pricing_core.errors import IterationLimitError
from pricing_core.lcp.problem import (
    DEFAULT_TOLERANCE,
    LCPSolution,
    Problem,
    as_tolerance,
    check_problem,
    inside,
    solution_of,
    verified,
)
from pricing_core.lcp.time_limit import TimeLimit

SHARE = 1e-3  # of the tolerance to which the iteration goes on: the scaled residual measures otherwise
ROUNDING = 1e-15  # share of the terms of w below which the projected gradient is rounding
PROPORTION = 1.0  # of the gradient at the bounds to the free one from which on bounds are left
POWERS = 20  # products by which the norm of M is estimated
GOLDEN = 0.6180339887498949
REMEDY = "M may not be symmetric and positive definite: give a matrix, or raise max_iterations"


def solve_projected_gradients(
    problem: Problem,
    *,
    start: ArrayLike | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    max_iterations: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[int, float], object] | None = None,
) -> LCPSolution:
    """Solve a problem with a symmetric positive definite M by products M z alone, as a linear operator gives them.

    Conjugate gradients improve the free unknowns until they meet bounds; then a projected gradient step of fixed length
    follows, and bounds are left where the gradient there is the larger one.

    Parameters
    ----------
    problem : LCP or MixedLCP
        M of any storage, or a `scipy.sparse.linalg.LinearOperator`.
    start : array_like, shape (n,), optional
        Default: z = 0, or what is nearest between the bounds.
    tolerance : float
        Largest `scaled_residual` of the answer.
    max_iterations : int, optional
        Default 1000 + 20 n.
    time_limit : float, optional
        Seconds.
    callback : callable, optional
        Told (iteration, natural residual); ends the work where it returns True.

    Returns
    -------
    LCPSolution
        `iterations` counts the products.

    Raises
    ------
    IterationLimitError
        `max_iterations` or `time_limit` were not enough, M is not positive definite, or the callback ended the work;
        `best` is the last point.

    Notes
    -----
    Cost: one product in each iteration; their number grows like the square root of the condition of M. Source: Dostál
    and Schöberl 2005, minimizing quadratic functions subject to bound constraints (MPRGP).

    Examples
    --------
    >>> from scipy.sparse.linalg import aslinearoperator
    >>> from pricing_core.lcp.problem import LCP
    >>> solve_projected_gradients(LCP(aslinearoperator(np.array([[2.0, 1.0], [1.0, 2.0]])), [-4.0, 1.0])).z
    array([2., 0.])
    """
    check_problem(problem)
    tolerance, clock = as_tolerance(tolerance), TimeLimit(time_limit)
    limit = (
        1000 + 20 * problem.size
        if max_iterations is None
        else as_whole_number("max_iterations", max_iterations, 1)
    )
    z = inside(problem, np.zeros(problem.size) if start is None else as_vector("start", start, problem.size))
    state = _State(problem, z)
    for iteration in range(1, limit + 1):
        residual = float(np.abs(state.free + state.chopped).max(initial=0.0))
        if residual <= state.goal(SHARE * tolerance):
            return verified(problem, state.z, state.products, "projected-gradients", tolerance, REMEDY)
        over = "did not end within its time limit" if clock() else ""
        if callback is not None and callback(iteration, residual) is True:
            over = "was ended by the callback"
        if over or not state.step():
            break
    else:
        over = f"did not end within {limit} iterations"
    failure = IterationLimitError(
        f"the method of projected gradients {over or 'met a direction without curvature'}: {REMEDY}"
    )
    failure.best = solution_of(problem, state.z, state.products, "projected-gradients")
    raise failure


class _State:
    """z, the gradient w = M z + q, its free part and its part at the bounds that leads inside, and a direction."""

    def __init__(self, problem: Problem, z: Vector) -> None:
        self.M, self.q = problem.M, problem.q
        self.lower, self.upper = problem.lower, problem.upper
        self.products, self.z = 0, z
        self.length = 1.0 / self._norm()
        self._from_scratch()

    def _product(self, x: Vector) -> Vector:
        self.products += 1
        return np.asarray(self.M @ x)

    def _norm(self) -> float:
        """Return an estimate of the largest eigenvalue, more than half of it."""
        x = 0.5 + np.modf(GOLDEN * np.arange(1.0, self.q.size + 1.0))[0]
        size = 1.0
        for _ in range(POWERS):
            x = self._product(x / np.linalg.norm(x))
            size = float(np.linalg.norm(x))
            if size == 0.0:
                return 1.0
        return size

    def _from_scratch(self) -> None:
        self.gradient = self._product(self.z) + self.q
        self._split()
        self.direction = self.free

    def _split(self) -> None:
        at_lower, at_upper = self.z <= self.lower, self.z >= self.upper
        self.free = np.where(at_lower | at_upper, 0.0, self.gradient)
        inward = np.where(at_lower, np.minimum(self.gradient, 0.0), np.maximum(self.gradient, 0.0))
        self.chopped = np.where((at_lower | at_upper) & ~(at_lower & at_upper), inward, 0.0)

    def goal(self, share: float) -> float:
        size = max(float(np.abs(self.q).max()), float(np.abs(self.gradient - self.q).max()))
        return max(share * float(np.abs(self.q).max()), ROUNDING * size)

    def step(self) -> bool:
        """Make one step; return whether there was a direction with curvature to make it in."""
        if self.chopped @ self.chopped > PROPORTION * (self.free @ self.free):
            self.direction = self.chopped
        along = self._product(self.direction)
        curvature = float(self.direction @ along)
        if not curvature > 0.0:
            return False
        wanted = float(self.gradient @ self.direction) / curvature
        allowed = self._allowed()
        length = min(wanted, allowed)
        self.z = np.clip(self.z - length * self.direction, self.lower, self.upper)
        if wanted > allowed:
            self.gradient = self.gradient - length * along
            self._split()
            self.z = np.clip(self.z - self.length * self.free, self.lower, self.upper)
            self._from_scratch()
            return True
        self.gradient = self.gradient - length * along
        self._split()
        self.direction = self.free - float(self.free @ along) / curvature * self.direction
        return True

    def _allowed(self) -> float:
        """Return the longest step against the direction that stays between the bounds."""
        room = np.where(self.direction > 0.0, self.z - self.lower, self.upper - self.z)
        size = np.abs(self.direction)
        return float(
            np.divide(room, size, out=np.full(size.size, np.inf), where=size > 0.0).min(initial=np.inf)
        )
