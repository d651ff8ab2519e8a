"""The linear complementarity problem, its solution, and the residuals that measure its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import Matrix, Vector, as_number, as_vector
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.row_scales import floored
from pricing_core.linalg.coefficients import (
    Coefficients,
    absolute,
    as_coefficients_or_operator,
    dense,
    is_operator,
    sparse,
)
from pricing_core.linalg.equilibration import equilibration
from pricing_core.linalg.tridiagonal import Tridiagonal

DEFAULT_TOLERANCE = 1e-10  # Default tolerance of the scaled residual.
# Largest ratio of the scaled residual to the weight of q in it, which a singular submatrix exceeds.
LARGEST_SHARE_OF_Q = 1e-5
NEGLIGIBLE = 1e-15  # share of the largest unknown, each on its own scale, that is rounding
ROUNDED = 1e-14  # a scaled residual that is rounding, whatever the scales of the rows
SMALLEST_SCALE = 1e-290  # a row whose terms are all smaller is void: its reciprocal would overflow


@dataclass(frozen=True, slots=True, eq=False)
class LCP:
    """Find z with 0 <= w = M z + q _|_ z >= 0.

    Parameters
    ----------
    M : array_like (n, n), scipy.sparse matrix or array (n, n), Tridiagonal, or scipy.sparse.linalg.LinearOperator
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
        object.__setattr__(self, "M", as_coefficients_or_operator("M", M))
        object.__setattr__(self, "q", as_vector("q", q, self.M.shape[0]))

    @property
    def size(self) -> int:
        """The number of unknowns n."""
        return self.q.size

    @property
    def lower(self) -> Vector:
        """The bounds below, all zero, shape (n,)."""
        return np.zeros(self.q.size)

    @property
    def upper(self) -> Vector:
        """The bounds above, all infinite, shape (n,)."""
        return np.full(self.q.size, np.inf)

    def slack(self, z: Vector) -> Vector:
        """Return w = M z + q, shape (n,)."""
        if np.shape(z) != self.q.shape or np.asarray(z).dtype.kind not in "fiu":
            raise InvalidInputError("z", z, f"a vector of {self.q.size} numbers")
        return np.asarray(self.M @ z + self.q)

    def dense(self) -> Matrix:
        """Return M as an array, shape (n, n)."""
        return dense(self.M)


Problem: TypeAlias = LCP | MixedLCP


@dataclass(frozen=True, slots=True, eq=False)
class LCPSolution:
    """A point z >= 0, or between the bounds, with w = M z + q, and how it was found.

    Parameters
    ----------
    z, w : Vector, shape (n,)
    residual : float
        The natural residual max |min(z, w)|, or with bounds max |z - mid(lower, z - w, upper)|, in the units of the
        problem.
    iterations : int
        Pivots, sweeps, linear solves or tree nodes, as the method counts.
    method : str
        The method that produced z.
    reason : str
        Why `solve` with method="auto" took that method; empty where the method was asked for.
    """

    z: Vector
    w: Vector
    residual: float
    iterations: int
    method: str
    reason: str = ""


def as_tolerance(tolerance: object) -> float:
    """Return a tolerance of the scaled residual, or raise InvalidInputError."""
    number = as_number("tolerance", tolerance)
    if not 0.0 < number < 1.0:
        raise InvalidInputError("tolerance", tolerance, "> 0 and < 1")
    return number


def natural_residual(problem: Problem, z: Vector) -> float:
    """Return max |min(z, M z + q)|, with bounds max |z - mid(lower, z - w, upper)|: zero exactly at the solutions.

    It is 0.0 for n = 0.

    Parameters
    ----------
    problem : LCP or MixedLCP
    z : Vector, shape (n,)

    Examples
    --------
    >>> natural_residual(LCP([[2.0]], [-4.0]), np.array([1.0]))
    2.0
    """
    check_problem(problem)
    return _natural(problem, z, problem.slack(z))


def scaled_residual(problem: Problem, z: Vector) -> float:
    """Return the natural residual with every quantity measured on its own scale, at most about 1.

    s = |M| |z| + |q| is the size of the terms that make up w, and t_i = z_i max_k |m_ki| / s_k is the
    weight of z_i in the row where it matters most. The value is max |min(t_i, w_i / s_i)|, with bounds the middle one
    of w_i / s_i and the weights of z_i - lower_i and z_i - upper_i. It does not change
    when rows or columns of the problem are multiplied by positive numbers. Where it is not at rounding level, rows
    with much smaller terms than the rows that they depend on are measured again with s_i at least 1e-6 of what
    reaches them from there (`row_scales.floored`), since their terms may be rounding alone. Then rounding makes it a
    small multiple of 1e-16 times the amplification of rounding by M, whatever the units.

    Examples
    --------
    >>> scaled_residual(LCP([[2e-12]], [-6e12]), np.array([1e24]))
    0.5
    """
    check_problem(problem)
    slack = problem.slack(z)
    sizes = _term_sizes(problem, z)
    error = _largest_part(problem, z, slack, sizes)
    if error <= ROUNDED or is_operator(problem.M):
        return error
    return _largest_part(problem, z, slack, floored(problem.M, z, sizes))


def scaled_parts(problem: Problem, z: Vector) -> tuple[Vector, Vector]:
    """Return (t, w / s) of `scaled_residual`, both of shape (n,), without a floor; w_i / s_i = 0 where s_i = 0."""
    weights, slack = weights_and_slack(problem, z)
    return z * weights, slack


def weights_and_slack(problem: Problem, z: Vector) -> tuple[Vector, Vector]:
    """Return the factors max_k |m_ki| / s_k that give z_i its weight, and w / s, both of shape (n,)."""
    inverse = _inverse(_term_sizes(problem, z))
    return _weights(problem, z, inverse), problem.slack(z) * inverse


def check_problem(problem: Problem) -> None:
    """Raise InvalidInputError unless it is a problem with or without bounds."""
    if not isinstance(problem, LCP | MixedLCP):
        raise InvalidInputError("problem", problem, "an object of class LCP or MixedLCP")


def _natural(problem: Problem, z: Vector, slack: Vector) -> float:
    if isinstance(problem, LCP):
        return float(np.abs(np.minimum(z, slack)).max(initial=0.0))
    # z - mid(lower, z - w, upper) is the middle one of w, z - lower and z - upper, without cancellation.
    middle = np.clip(slack, z - problem.upper, z - problem.lower)
    outside = np.maximum(problem.lower - z, z - problem.upper)
    return float(max(np.abs(middle).max(initial=0.0), outside.max(initial=0.0)))


def _inverse(sizes: Vector) -> Vector:
    return np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > SMALLEST_SCALE)


def _parts(problem: Problem, z: Vector, slack: Vector, sizes: Vector) -> Vector:
    inverse = _inverse(sizes)
    weight = _weights(problem, z, inverse)
    if isinstance(problem, LCP):
        return np.minimum(z * weight, slack * inverse)
    with np.errstate(invalid="ignore"):  # infinity times a weight of zero: as good as unbounded
        below = np.nan_to_num((z - problem.lower) * weight, nan=np.inf, posinf=np.inf)
        above = np.nan_to_num((z - problem.upper) * weight, nan=-np.inf, neginf=-np.inf)
    return np.minimum(np.maximum(slack * inverse, above), below)


def _largest_part(problem: Problem, z: Vector, slack: Vector, sizes: Vector) -> float:
    return float(np.abs(_parts(problem, z, slack, sizes)).max(initial=0.0))


def solution_of(problem: Problem, z: Vector, iterations: int, method: str) -> LCPSolution:
    """Return the LCPSolution of z, with w and the residual computed afresh from M, z and q."""
    return LCPSolution(z, problem.slack(z), natural_residual(problem, z), iterations, method)


def verified(
    problem: Problem, z: Vector, iterations: int, method: str, tolerance: float, remedy: str
) -> LCPSolution:
    """Return the LCPSolution of z, moved between the bounds, if its scaled residual is at most `tolerance`.

    Raises
    ------
    NumericalError
        It is not, or z is not finite, or so large that the residual says nothing; `remedy` ends the message, and
        `best` is the point, where it is finite.
    """
    if not np.isfinite(z).all():
        raise NumericalError(f"{method} produced numbers that are not finite: {remedy}")
    clipped = inside(problem, z)
    sizes, slack = _term_sizes(problem, clipped), problem.slack(clipped)
    error = _largest_part(problem, clipped, slack, sizes)
    if not error <= min(tolerance, ROUNDED):
        error = scaled_residual(problem, clipped)
        if not error <= tolerance and isinstance(problem, MixedLCP) and not is_operator(problem.M):
            rounded = without_rounding(problem, clipped)
            if (rounded_error := scaled_residual(problem, rounded)) <= tolerance:
                clipped, error = rounded, rounded_error
                sizes, slack = _term_sizes(problem, clipped), problem.slack(clipped)
    found = LCPSolution(clipped, slack, _natural(problem, clipped, slack), iterations, method)
    if not error <= tolerance:
        raise missed(
            f"{method} left a scaled residual of {error:.1e}, more than {tolerance:.1e}: {remedy}", found
        )
    if not error <= LARGEST_SHARE_OF_Q * _weight_of_data(problem, clipped, sizes):
        raise missed(f"{method} ended so far out that q is lost in rounding: {remedy}", found)
    return found


def without_rounding(problem: Problem, z: Vector) -> Vector:
    """Return z with zero for the unknowns that, on the scales of rows and columns, are rounding beside the largest.

    An equation of free unknowns that are all such has no terms of any size of its own to measure its residual by.
    """
    _, column = equilibration(problem.M if isinstance(problem.M, np.ndarray) else sparse(problem.M))
    size = np.abs(z) / column
    return inside(problem, np.where(size <= NEGLIGIBLE * size.max(initial=0.0), 0.0, z))


def inside(problem: Problem, z: Vector) -> Vector:
    """Return the point between the bounds that is nearest to z, without a -0.0."""
    if isinstance(problem, LCP):
        return np.asarray(np.maximum(z, 0.0) + 0.0)
    return np.asarray(np.clip(z, problem.lower, problem.upper) + 0.0)


def missed(message: str, found: LCPSolution) -> NumericalError:
    """Return the NumericalError of a method whose last point, `best`, is no solution."""
    failure = NumericalError(message)
    failure.best = found
    return failure


def _weight_of_data(problem: Problem, z: Vector, sizes: Vector) -> float:
    """Return max |q_i| / s_i: tiny where z nearly solves M z = 0 and any q would do. A bound that z meets adds to q."""
    given = np.abs(problem.q)
    if isinstance(problem, MixedLCP) and not is_operator(problem.M):
        met = np.where((z == problem.lower) | (z == problem.upper), np.abs(z), 0.0)
        given = given + np.asarray(absolute(problem.M) @ met)
    return float(np.divide(given, sizes, out=np.zeros_like(sizes), where=sizes > 0.0).max(initial=0.0))


def _term_sizes(problem: Problem, z: Vector) -> Vector:
    """Return s = |M| |z| + |q|, shape (n,); for an operator max |M z| + max |q|, at most about the largest s."""
    if is_operator(problem.M):
        size = np.abs(problem.M @ z).max(initial=0.0) + np.abs(problem.q).max(initial=0.0)
        return np.full(problem.size, size)
    return np.asarray(absolute(problem.M) @ np.abs(z)) + np.abs(problem.q)


def _weights(problem: Problem, z: Vector, inverse: Vector) -> Vector:
    """Return what multiplies z_i in `scaled_residual`, shape (n,); for an operator 1 / max |z|."""
    if is_operator(problem.M):
        return np.full(problem.size, 1.0 / max(float(np.abs(z).max(initial=0.0)), SMALLEST_SCALE))
    return _largest_in_column(absolute(problem.M), inverse)


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
