"""Basic points: z_i = 0 outside a basic set, w_i = 0 on it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgWarning, lu_factor, lu_solve
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp.problem import LCP, Problem
from pricing_core.linalg.coefficients import Coefficients, dense
from pricing_core.linalg.tridiagonal import Tridiagonal

FACTORED_ONCE = (
    50  # order from which two systems with one matrix cost more than its factors and their overhead
)
# Largest correction, as a share of the solution: a larger one says that not even three digits are known.
LARGEST_CORRECTION = 1e-3


def basic_point(problem: LCP, basic_set: BoolVector) -> Vector:
    """Return the z with w_i = 0 on the basic set and z_i = 0 elsewhere, of any sign, shape (n,).

    Cost: O(n) for a Tridiagonal, one sparse or dense factorisation otherwise.

    Raises
    ------
    NumericalError
        The principal submatrix M_II of the basic set is singular.

    Examples
    --------
    >>> basic_point(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0]), np.array([True, False]))
    array([2., 0.])
    """
    z = np.zeros(problem.size)
    if not basic_set.any():
        return z
    if isinstance(problem.M, Tridiagonal):
        system, right = decoupled(problem.M, basic_set), np.where(basic_set, -problem.q, 0.0)
        point: Vector = system.solve(right)
        point = point + system.solve(right - system @ point)
        return np.where(basic_set, point, 0.0)
    z[basic_set] = refined_solve(_principal(problem.M, basic_set), -problem.q[basic_set])
    return z


def point_between(problem: Problem, sides: NDArray[np.int8]) -> Vector:
    """Return the z with w_i = 0 where the side is 0, z_i = lower_i where it is -1 and upper_i where it is 1.

    Raises
    ------
    NumericalError
        As `basic_point`.

    Examples
    --------
    >>> point_between(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0]), np.array([0, -1], dtype=np.int8))
    array([2., 0.])
    """
    basic_set = sides == 0
    held = np.where(basic_set, 0.0, np.where(sides < 0, problem.lower, problem.upper))
    return np.where(basic_set, basic_point(LCP(problem.M, problem.slack(held)), basic_set), held)


def decoupled(M: Tridiagonal, basic_set: BoolVector) -> Tridiagonal:
    """Return M with the rows and columns outside the basic set replaced by those of the identity."""
    linked = basic_set[1:] & basic_set[:-1]
    return Tridiagonal(
        np.where(linked, M.lower, 0.0),
        np.where(basic_set, M.diagonal, 1.0),
        np.where(linked, M.upper, 0.0),
    )


def refined_solve(A: Matrix | csr_array, b: Vector) -> Vector:
    """Solve A x = b, with one step of refinement that takes each row's residual to rounding level.

    Raises
    ------
    NumericalError
        A is singular, exactly or because the refinement changes the leading digits.
    """
    try:
        inverse = splu(A.tocsc()).solve if isinstance(A, csr_array) else _dense_inverse(A)
        with np.errstate(over="ignore", invalid="ignore"):
            x = np.asarray(inverse(b))
            correction = np.asarray(inverse(b - A @ x))
    except (np.linalg.LinAlgError, RuntimeError):
        raise _singular(b.size) from None
    if not np.isfinite(x).all() or not np.max(np.abs(correction), initial=0.0) <= LARGEST_CORRECTION * np.max(
        np.abs(x), initial=0.0
    ):
        raise _singular(b.size)
    return np.asarray(x + correction)


def _dense_inverse(A: Matrix) -> Callable[[Vector], Vector]:
    if len(A) < FACTORED_ONCE:
        return partial(np.linalg.solve, A)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)  # a pivot of zero gives numbers that are not finite
        return partial(lu_solve, lu_factor(A, check_finite=False), check_finite=False)


def _principal(M: Coefficients, basic_set: BoolVector) -> Matrix | csr_array:
    index = np.flatnonzero(basic_set)
    return M[index][:, index] if isinstance(M, csr_array) else dense(M)[np.ix_(index, index)]


def _singular(order: int) -> NumericalError:
    return NumericalError(
        f"a principal submatrix of order {order} is singular to working precision: "
        "the method needs a nondegenerate matrix; use Lemke or enumeration"
    )
