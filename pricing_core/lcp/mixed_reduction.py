"""Mixed problems as linear complementarity problems: bounds moved to zero, free unknowns eliminated or split."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.sparse import csr_array, diags_array

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp.complementary_basis import complementary_basis, exchanged
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.problem import LCP
from pricing_core.linalg.coefficients import Coefficients
from pricing_core.linalg.tridiagonal import Tridiagonal

SMALLEST_RECIPROCAL_CONDITION = 1e-12
LARGEST_SEARCHED_BASIS = 250  # order up to which ranks are decided, one for each unknown


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """An LCP whose solutions x give those of a mixed problem, z = back(x).

    `is_exact` tells that its numbers are those of the mixed problem, without rounding: then a proof that the LCP has no
    solution is one for the mixed problem.
    """

    lcp: LCP
    back: Callable[[Vector], Vector]
    is_exact: bool


def one_sided(problem: MixedLCP) -> Reduction | None:
    """Return the LCP in the distances from the bounds, of the same order, where each unknown has one bound.

    Examples
    --------
    >>> found = one_sided(MixedLCP([[2.0]], [4.0], -np.inf, -1.0))
    >>> found.lcp.M, found.lcp.q, found.back(np.array([1.0]))
    (array([[2.]]), array([-2.]), array([-2.]))
    """
    if (np.isinf(problem.lower) == np.isinf(problem.upper)).any():
        return None
    moved = _moved(problem)
    return Reduction(LCP(moved.M, moved.q), moved.back, moved.is_exact)


def eliminated(problem: MixedLCP) -> Reduction:
    """Return the LCP without the free unknowns, with a slack of its own for every second bound.

    With x the distances from the bounds, y the multipliers of the second bounds and d the widths between them,
    w = M x + q + y and 0 <= d - x _|_ y >= 0. The equations of the free unknowns determine those, or, where their
    matrix is singular, others as well, whose w are unknowns of the LCP then. A positive semidefinite M gives an LCP
    that has such a matrix.

    Raises
    ------
    NumericalError
        There are free unknowns that the equations and the complementarity conditions do not determine.

    Examples
    --------
    >>> eliminated(MixedLCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, 1.0], [0.0, -np.inf], [1.0, np.inf])).lcp.M
    array([[ 1.5,  1. ],
           [-1. ,  0. ]])
    """
    moved = _moved(problem)
    wide = _with_widths(moved.M_dense(), moved.q, moved.widths)
    free = np.zeros(wide.size, dtype=np.bool_)
    free[: problem.size] = np.isinf(problem.lower) & np.isinf(problem.upper)
    if not free.any():
        return Reduction(wide, lambda x: moved.back(x[: problem.size]), moved.is_exact)
    pairs, M, held = np.diag((~free).astype(np.float64)), wide.dense(), ~free
    traded = free if _is_regular(M[np.ix_(free, free)]) else _determined(pairs, M)
    table = exchanged(pairs, M, traded, wide.q[:, None])
    lcp = LCP(table[np.ix_(held, held)], table[held, -1])

    def back(x: Vector) -> Vector:
        chosen = np.zeros(wide.size)
        chosen[held] = x
        found = np.where(traded, table[:, :-1] @ chosen + table[:, -1], chosen)
        return moved.back(found[: problem.size])

    return Reduction(lcp, back, is_exact=False)


def _is_regular(block: Matrix) -> bool:
    return bool(np.linalg.cond(block, 1) < 1.0 / SMALLEST_RECIPROCAL_CONDITION)


def _determined(pairs: Matrix, M: Matrix) -> BoolVector:
    if len(M) > LARGEST_SEARCHED_BASIS:
        raise NumericalError("the matrix of the free unknowns is singular: they are split instead")
    return complementary_basis(pairs, M)


def split(problem: MixedLCP) -> Reduction:
    """Return the LCP in which each free unknown is a - b with a, b >= 0, and second bounds are as in `eliminated`.

    The rows of a and b are opposite, so that both slacks are zero in a solution. A positive semidefinite M gives an LCP
    that has such a matrix.

    Examples
    --------
    >>> split(MixedLCP([[2.0]], [-4.0], -np.inf, np.inf)).lcp.M
    array([[ 2., -2.],
           [-2.,  2.]])
    """
    moved = _moved(problem)
    free = np.flatnonzero(np.isinf(problem.lower) & np.isinf(problem.upper))
    n, M = problem.size, moved.M_dense()
    wide = np.hstack([M, -M[:, free]])
    doubled = np.vstack([wide, -wide[free]])
    widths = np.append(moved.widths, np.full(free.size, np.inf))
    lcp = _with_widths(doubled, np.append(moved.q, -moved.q[free]), widths)

    def back(x: Vector) -> Vector:
        full = x[:n].copy()
        full[free] -= x[n : n + free.size]
        return moved.back(full)

    return Reduction(lcp, back, moved.is_exact)


@dataclass(frozen=True, slots=True, eq=False)
class _Moved:
    """z = base + sign x with x >= 0 where z has a bound; w' = sign w = M x + q."""

    M: Coefficients
    q: Vector
    base: Vector
    sign: Vector
    widths: Vector  # upper - lower, infinite where one of them is
    is_exact: bool

    def back(self, x: Vector) -> Vector:
        return self.base + self.sign * x

    def M_dense(self) -> Matrix:
        return LCP(self.M, self.q).dense()


def _moved(problem: MixedLCP) -> _Moved:
    has_lower, has_upper = np.isfinite(problem.lower), np.isfinite(problem.upper)
    sign = np.where(has_upper & ~has_lower, -1.0, 1.0)
    base = np.where(has_lower, problem.lower, np.where(has_upper, problem.upper, 0.0))
    widths = problem.upper - problem.lower
    q = sign * problem.slack(base)
    return _Moved(_signed(problem.M, sign), q, base, sign, widths, _is_exact(problem, base, sign * q, widths))


def _signed(M: Coefficients, sign: Vector) -> Coefficients:
    if (sign > 0.0).all():
        return M
    if isinstance(M, Tridiagonal):
        links = sign[1:] * sign[:-1]
        return Tridiagonal(M.lower * links, M.diagonal, M.upper * links)
    if isinstance(M, csr_array):
        return csr_array(diags_array(sign) @ M @ diags_array(sign))
    return np.asarray(sign[:, None] * M * sign)


def _is_exact(problem: MixedLCP, base: Vector, slack: Vector, widths: Vector) -> bool:
    """Tell whether M base + q and upper - lower were formed without rounding."""
    two = np.flatnonzero(np.isfinite(widths))
    if any(
        Fraction(problem.upper[i]) - Fraction(problem.lower[i]) != Fraction(widths[i]) for i in two.tolist()
    ):
        return False
    moved = np.flatnonzero(base).tolist()
    if not moved:
        return True
    if problem.size > 100:  # nothing is proved there in exact arithmetic
        return False
    rows = problem.dense().tolist()
    return all(
        sum((Fraction(row[j]) * Fraction(base[j]) for j in moved), Fraction(q)) == Fraction(w)
        for row, q, w in zip(rows, problem.q.tolist(), slack.tolist(), strict=True)
    )


def _with_widths(M: Matrix, q: Vector, widths: Vector) -> LCP:
    two_sided = np.flatnonzero(np.isfinite(widths))
    n, k = q.size, two_sided.size
    table = np.zeros((n + k, n + k))
    table[:n, :n] = M
    table[two_sided, n + np.arange(k)] = 1.0
    table[n + np.arange(k), two_sided] = -1.0
    return LCP(table, np.append(q, widths[two_sided]))
