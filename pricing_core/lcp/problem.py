"""The linear complementarity problem, its solution, and the residuals that measure its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import Matrix, Vector, as_number, as_vector, check_type
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp.row_scales import floored
from pricing_core.linalg.coefficients import Coefficients, absolute, as_coefficients, dense
from pricing_core.linalg.tridiagonal import Tridiagonal

DEFAULT_TOLERANCE = 1e-10  # Default tolerance of the scaled residual.
# Largest ratio of the scaled residual to the weight of q in it, which a singular submatrix exceeds.
LARGEST_SHARE_OF_Q = 1e-5
ROUNDED = 1e-14  # a scaled residual that is rounding, whatever the scales of the rows
SMALLEST_SCALE = 1e-290  # a row whose terms are all smaller is void: its reciprocal would overflow


@dataclass(frozen=True, slots=True, eq=False)
class LCP:
    """Find z with 0 <= w = M z + q _|_ z >= 0.

    Parameters
    ----------
    M : array_like (n, n), scipy.sparse matrix or array (n, n), or Tridiagonal
        Kept as a read-only array, as a `csr_array` of its own, or as it is.
    q : array_like, shape (n,)

    Raises
    ------
    InvalidInputError
        M is not square, q has another length, or an entry is not a finite real number.

    Examples
    --------
    >>> problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
    >>> problem.slack(np.array([1.0, 3.0]))
    array([0., 1.])
    """

    M: Coefficients  # (n, n)
    q: Vector  # (n,)

    def __init__(self, M: object, q: ArrayLike) -> None:
        object.__setattr__(self, "M", as_coefficients("M", M))
        object.__setattr__(self, "q", as_vector("q", q, self.M.shape[0]))

    @property
    def size(self) -> int:
        """The number of unknowns n."""
        return self.q.size

    def slack(self, z: Vector) -> Vector:
        """Return w = M z + q, shape (n,)."""
        if np.shape(z) != self.q.shape or np.asarray(z).dtype.kind not in "fiu":
            raise InvalidInputError("z", z, f"a vector of {self.q.size} numbers")
        return np.asarray(self.M @ z + self.q)

    def dense(self) -> Matrix:
        """Return M as an array, shape (n, n)."""
        return dense(self.M)


@dataclass(frozen=True, slots=True, eq=False)
class LCPSolution:
    """A point z >= 0 with w = M z + q, and how it was found.

    Parameters
    ----------
    z, w : Vector, shape (n,)
    residual : float
        The natural residual max |min(z, w)|, in the units of the problem.
    iterations : int
        Pivots, sweeps, linear solves or tree nodes, as the method counts.
    method : str
        The method that produced z.
    """

    z: Vector
    w: Vector
    residual: float
    iterations: int
    method: str


def as_tolerance(tolerance: object) -> float:
    """Return a tolerance of the scaled residual, or raise InvalidInputError."""
    number = as_number("tolerance", tolerance)
    if not 0.0 < number < 1.0:
        raise InvalidInputError("tolerance", tolerance, "> 0 and < 1")
    return number


def natural_residual(problem: LCP, z: Vector) -> float:
    """Return max |min(z, M z + q)|: zero exactly at the solutions, 0.0 for n = 0.

    Examples
    --------
    >>> natural_residual(LCP([[2.0]], [-4.0]), np.array([1.0]))
    2.0
    """
    check_type("problem", problem, LCP)
    return float(np.max(np.abs(np.minimum(z, problem.slack(z))), initial=0.0))


def scaled_residual(problem: LCP, z: Vector) -> float:
    """Return the natural residual with every quantity measured on its own scale, at most about 1.

    s = |M| |z| + |q| is the size of the terms that make up w, and t_i = z_i max_k |m_ki| / s_k is the
    weight of z_i in the row where it matters most. The value is max |min(t_i, w_i / s_i)|. It does not change
    when rows or columns of the problem are multiplied by positive numbers. Where it is not at rounding level, rows
    with much smaller terms than the rows that they depend on are measured again with s_i at least 1e-6 of what
    reaches them from there (`row_scales.floored`), since their terms may be rounding alone. Then rounding makes it a
    small multiple of 1e-16 times the amplification of rounding by M, whatever the units.

    Examples
    --------
    >>> scaled_residual(LCP([[2e-12]], [-6e12]), np.array([1e24]))
    0.5
    """
    check_type("problem", problem, LCP)
    slack = problem.slack(z)
    sizes = _term_sizes(problem, z)
    error = _largest_part(*_scaled(problem.M, z, slack, sizes))
    return (
        error
        if error <= ROUNDED
        else _largest_part(*_scaled(problem.M, z, slack, floored(problem.M, z, sizes)))
    )


def scaled_parts(problem: LCP, z: Vector) -> tuple[Vector, Vector]:
    """Return (t, w / s) of `scaled_residual`, both of shape (n,), without a floor; w_i / s_i = 0 where s_i = 0."""
    return _scaled(problem.M, z, problem.slack(z), _term_sizes(problem, z))


def _scaled(M: Coefficients, z: Vector, slack: Vector, sizes: Vector) -> tuple[Vector, Vector]:
    inverse = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > SMALLEST_SCALE)
    return z * _largest_in_column(absolute(M), inverse), slack * inverse


def _largest_part(weight: Vector, slack: Vector) -> float:
    return float(np.abs(np.minimum(weight, slack)).max(initial=0.0))


def solution_of(problem: LCP, z: Vector, iterations: int, method: str) -> LCPSolution:
    """Return the LCPSolution of z, with w and the residual computed afresh from M, z and q."""
    return LCPSolution(z, problem.slack(z), natural_residual(problem, z), iterations, method)


def verified(
    problem: LCP, z: Vector, iterations: int, method: str, tolerance: float, remedy: str
) -> LCPSolution:
    """Return the LCPSolution of max(z, 0) if its scaled residual is at most `tolerance`.

    Raises
    ------
    NumericalError
        It is not, or z is not finite, or so large that the residual says nothing; `remedy` ends the message.
    """
    if not np.isfinite(z).all():
        raise NumericalError(f"{method} produced numbers that are not finite: {remedy}")
    clipped = np.maximum(z, 0.0) + 0.0  # no -0.0
    sizes, slack = _term_sizes(problem, clipped), problem.slack(clipped)
    error = _largest_part(*_scaled(problem.M, clipped, slack, sizes))
    if not error <= min(tolerance, ROUNDED):
        error = scaled_residual(problem, clipped)
    if not error <= tolerance:
        raise NumericalError(
            f"{method} left a scaled residual of {error:.1e}, more than {tolerance:.1e}: {remedy}"
        )
    if not error <= LARGEST_SHARE_OF_Q * _weight_of_q(problem, sizes):
        raise NumericalError(f"{method} ended so far out that q is lost in rounding: {remedy}")
    return LCPSolution(
        clipped, slack, float(np.abs(np.minimum(clipped, slack)).max(initial=0.0)), iterations, method
    )


def _weight_of_q(problem: LCP, sizes: Vector) -> float:
    """Return max |q_i| / s_i: tiny where z nearly solves M z = 0 and any q would do."""
    return float(
        np.divide(np.abs(problem.q), sizes, out=np.zeros_like(sizes), where=sizes > 0.0).max(initial=0.0)
    )


def _term_sizes(problem: LCP, z: Vector) -> Vector:
    """Return s = |M| |z| + |q|, shape (n,)."""
    return np.asarray(absolute(problem.M) @ np.abs(z)) + np.abs(problem.q)


def _largest_in_column(magnitude: Coefficients, row_factor: Vector) -> Vector:
    """Return max_k row_factor[k] magnitude[k, i] for every column i, shape (n,)."""
    if isinstance(magnitude, Tridiagonal):
        largest = magnitude.diagonal * row_factor
        largest[:-1] = np.maximum(largest[:-1], magnitude.lower * row_factor[1:])
        largest[1:] = np.maximum(largest[1:], magnitude.upper * row_factor[:-1])
        return largest
    if isinstance(magnitude, csr_array):
        largest = np.zeros(row_factor.size)
        rows = np.repeat(np.arange(row_factor.size), np.diff(magnitude.indptr))
        np.maximum.at(largest, magnitude.indices, magnitude.data * row_factor[rows])
        return largest
    return np.asarray(np.max(magnitude * row_factor[:, None], axis=0, initial=0.0))
