"""A tridiagonal matrix: product, sum with a multiple of the identity, solve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dgtsv

from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError, NumericalError


@dataclass(frozen=True, slots=True, eq=False)
class Tridiagonal:
    """The matrix with T[i, i-1] = lower[i-1], T[i, i] = diagonal[i], T[i, i+1] = upper[i].

    Examples
    --------
    >>> T = Tridiagonal([-1.0, -1.0], [2.0, 2.0, 2.0], [-1.0, -1.0])
    >>> T @ np.array([1.0, 2.0, 3.0])
    array([0., 0., 4.])
    >>> T.solve(np.array([0.0, 0.0, 4.0]))
    array([1., 2., 3.])
    """

    lower: Vector  # (n - 1,)
    diagonal: Vector  # (n,)
    upper: Vector  # (n - 1,)

    def __init__(self, lower: ArrayLike, diagonal: ArrayLike, upper: ArrayLike) -> None:
        main = as_vector("diagonal", diagonal)
        if main.size == 0:
            raise InvalidInputError("diagonal", "an empty vector", "a vector of length >= 1")
        object.__setattr__(self, "diagonal", main)
        object.__setattr__(self, "lower", as_vector("lower", lower, main.size - 1))
        object.__setattr__(self, "upper", as_vector("upper", upper, main.size - 1))

    @property
    def shape(self) -> tuple[int, int]:
        """The shape (n, n)."""
        return self.diagonal.size, self.diagonal.size

    def __matmul__(self, x: Vector) -> Vector:
        y: Vector = self.diagonal * x
        y[1:] += self.lower * x[:-1]
        y[:-1] += self.upper * x[1:]
        return y

    def plus_identity(self, shift: float, scale: float = 1.0) -> Tridiagonal:
        """Return shift I + scale T."""
        return Tridiagonal(scale * self.lower, shift + scale * self.diagonal, scale * self.upper)

    def solve(self, rhs: Matrix) -> Matrix:
        """Solve T x = rhs, shape (n,) or (n, m): see `solve_tridiagonal`."""
        return solve_tridiagonal(self.lower, self.diagonal, self.upper, rhs)

    def dense(self) -> Matrix:
        """Return the matrix as an array, shape (n, n)."""
        return np.diag(self.diagonal) + np.diag(self.lower, -1) + np.diag(self.upper, 1)


def solve_tridiagonal(lower: Vector, diagonal: Vector, upper: Vector, rhs: Matrix) -> Matrix:
    """Solve T x = rhs by LAPACK's pivoted elimination in O(n).

    Parameters
    ----------
    lower, diagonal, upper : array, shapes (n - 1,), (n,), (n - 1,)
        The bands of T, as in `Tridiagonal`.
    rhs : array, shape (n,) or (n, m)

    Raises
    ------
    NumericalError
        T is singular.
    """
    if diagonal.size == 1:
        lower = upper = np.zeros(1)  # the LAPACK wrapper refuses empty bands
    *_, x, info = dgtsv(lower, diagonal, upper, rhs)
    if info:
        raise NumericalError(f"the tridiagonal matrix is singular: pivot {info} is zero")
    return np.asarray(x)
