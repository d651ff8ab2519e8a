"""The horizontal linear complementarity problem M w = N z + q, 0 <= w _|_ z >= 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import BoolVector, Matrix, Vector, as_matrix, as_square_matrix, as_vector, check_type
from pricing_core.errors import InfeasibleError, NumericalError, RayTerminationError
from pricing_core.lcp.complementary_basis import complementary_basis, exchanged
from pricing_core.lcp.exact import (
    LARGEST_EXACT_ORDER,
    LARGEST_SEARCHED_ORDER,
    exact_horizontal,
    rounded,
    values_by_lemke,
    values_by_search,
    with_basis,
)
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LARGEST_SHARE_OF_Q, LCP
from pricing_core.lcp.solve import solve
from pricing_core.lcp.time_limit import TimeLimit

UNPROVED = (
    "no solution was found; the problem that floating point made of this one has none, which proves nothing here: "
    "rescale the problem"
)


@dataclass(frozen=True, slots=True, eq=False)
class HorizontalLCP:
    """Find w and z with M w = N z + q and 0 <= w _|_ z >= 0; with M = I it is an LCP.

    Parameters
    ----------
    M, N : array_like, shape (n, n)
        Either may be singular.
    q : array_like, shape (n,)

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite.
    """

    M: Matrix  # (n, n)
    N: Matrix  # (n, n)
    q: Vector  # (n,)

    def __init__(self, M: ArrayLike, N: ArrayLike, q: ArrayLike) -> None:
        object.__setattr__(self, "M", as_square_matrix("M", M))
        object.__setattr__(self, "N", as_matrix("N", N, self.M.shape))
        object.__setattr__(self, "q", as_vector("q", q, self.M.shape[0]))

    def residual(self, w: Vector, z: Vector) -> float:
        """Return the largest of |M w - N z - q| and |min(w, z)|: zero exactly at the solutions."""
        w, z = as_vector("w", w, self.q.size), as_vector("z", z, self.q.size)
        equation = np.abs(self.M @ w - self.N @ z - self.q)
        return float(max(equation.max(initial=0.0), np.abs(np.minimum(w, z)).max(initial=0.0)))


class HorizontalSolution(NamedTuple):
    """A solution of a horizontal LCP, its residual, and the method that solved the LCP behind it.

    Parameters
    ----------
    w, z : Vector, shape (n,)
        The two complementary vectors.
    residual : float
        Largest violation of the equations, of the signs and of complementarity.
    method : str
        Name of the method, as in `LCPSolution`.
    """

    w: Vector  # (n,)
    z: Vector  # (n,)
    residual: float
    method: str


def solve_horizontal(problem: HorizontalLCP, *, time_limit: float | None = None) -> HorizontalSolution:
    """Solve a horizontal LCP by the LCP of a nonsingular complementary matrix, or in exact arithmetic.

    An answer of the LCP counts where it solves the equations of this problem to within 1e-10 of the terms of each row.
    Where there is none, Lemke's method in rational arithmetic is tried for n <= 60, and for n <= 20 a search of
    the complementary cells, for which no complementary matrix need be nonsingular ("exact").

    Parameters
    ----------
    problem : HorizontalLCP
    time_limit : float, optional
        Seconds.

    Raises
    ------
    InfeasibleError
        Proved in exact arithmetic for the numbers as they are given: there is no solution.
    RayTerminationError, IterationLimitError
        As `pricing_core.lcp.solve`; nothing is proved.
    NumericalError
        No method found a solution, for n > 20 because every complementary matrix is singular; nothing is proved.

    Notes
    -----
    Cost: that of `complementary_basis` and of the LCP. Source: Cottle, Pang, Stone 1992, section 1.5;
    Sznajder and Gowda 1995.

    Examples
    --------
    w = z + 1 in the first row, w + z = 2 in the second, where M is singular:

    >>> problem = HorizontalLCP([[1, -1], [0, 0]], [[0, 0], [-1, -1]], [-3, 2])
    >>> solution = solve_horizontal(problem)
    >>> solution.w, solution.z
    (array([0., 3.]), array([2., 0.]))
    """
    check_type("problem", problem, HorizontalLCP)
    limit = TimeLimit(time_limit)
    try:
        traded = complementary_basis(problem.M, problem.N)
    except NumericalError as failure:
        return _exactly(problem, None, failure, limit)
    try:
        return _by_lcp(problem, traded, limit)
    except NumericalError as failure:
        return _exactly(problem, traded, failure, limit)


def _by_lcp(problem: HorizontalLCP, traded: BoolVector, limit: TimeLimit) -> HorizontalSolution:
    table = exchanged(problem.M, problem.N, traded, problem.q[:, None])
    n = problem.q.size
    found = solve(LCP(table[:, :n], table[:, n]), time_limit=limit.left())
    slack = np.where(found.z > 0.0, 0.0, np.maximum(found.w, 0.0))  # rounding apart
    w, z = np.where(traded, found.z, slack), np.where(traded, slack, found.z)
    sizes = np.abs(problem.M) @ w + np.abs(problem.N) @ z + np.abs(problem.q)
    inverse = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    error = np.max(np.abs(problem.M @ w - problem.N @ z - problem.q) * inverse, initial=0.0)
    weight_of_q = np.max(np.abs(problem.q) * inverse, initial=0.0)
    if not error <= min(DEFAULT_TOLERANCE, LARGEST_SHARE_OF_Q * weight_of_q):
        raise NumericalError(
            f"the solution found misses the equations by {error:.1e} of their terms, and nothing is proved: "
            "rescale the problem"
        )
    return HorizontalSolution(w, z, problem.residual(w, z), found.method)


def _exactly(
    problem: HorizontalLCP, traded: BoolVector | None, failure: NumericalError, limit: TimeLimit
) -> HorizontalSolution:
    """Solve in rational arithmetic, or raise what is proved; the failure of floating point where nothing is."""
    limit.check("solving this horizontal problem")
    n = problem.q.size
    unproved = RayTerminationError(UNPROVED) if isinstance(failure, InfeasibleError) else failure
    if n > LARGEST_EXACT_ORDER:
        raise unproved
    posed = exact_horizontal(problem.M, problem.N, problem.q)
    if posed is None:
        raise InfeasibleError("no w and z of any sign satisfy the equations M w = N z + q")
    basis = None if traded is None else frozenset((np.arange(n) + n * traded).tolist())
    try:
        tableau = None if basis is None else with_basis(posed.tableau, basis)
        if tableau is None:
            raise unproved
        x = values_by_lemke(posed, tableau, limit)
    except NumericalError:
        if n > LARGEST_SEARCHED_ORDER:
            raise unproved from None
        x = values_by_search(posed, limit)
    w, z = rounded(x[:n]), rounded(x[n:])
    return HorizontalSolution(w, z, problem.residual(w, z), "exact")
