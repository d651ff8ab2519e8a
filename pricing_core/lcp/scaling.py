"""Equilibration: an equivalent problem whose rows and columns are of size about one."""

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp.problem import LCP

ROUNDS = 12  # each halves the logarithm of what is left; 1e24 is within 2 % of 1 after twelve
LARGEST_EXPONENT = 400  # keeps the factors, and products of two of them, inside the range of a double


@dataclass(frozen=True, slots=True, eq=False)
class ScaledProblem:
    """M' = R M C, q' = R q / size: z = size C z' solves the original problem iff z' solves this one.

    R, C and size are powers of two, so no entry is rounded.
    """

    M: Matrix  # (n, n)
    q: Vector  # (n,)
    row: Vector  # (n,) the diagonal of R
    column: Vector  # (n,) the diagonal of C
    size: float

    def original(self, z: Vector) -> Vector:
        """Return the z of the original problem, for z' of shape (n,) or (m, n)."""
        return np.asarray(self.size * self.column * z)

    def original_ray(self, r: Vector) -> Vector:
        """Return the original direction, largest component 1, for r' of shape (n,) or (m, n)."""
        direction = self.column * r
        return np.asarray(direction / np.max(np.abs(direction), axis=-1, keepdims=True, initial=1e-300))


def equilibrate(problem: LCP) -> ScaledProblem:
    """Scale rows and columns by powers of two until their largest entries are near 1 (Ruiz 2001).

    A symmetric M stays symmetric. Cost: O(n**2).

    Examples
    --------
    >>> equilibrate(LCP([[4.0, 0.0], [0.0, 64.0]], [-8.0, 1.0])).M
    array([[1., 0.],
           [0., 1.]])
    """
    M = np.array(problem.dense())
    row, column = np.ones(problem.size), np.ones(problem.size)
    for _ in range(ROUNDS):
        magnitude = np.abs(M)
        row = row * _inverse_root(np.max(magnitude, axis=1, initial=0.0))
        column = column * _inverse_root(np.max(magnitude, axis=0, initial=0.0))
        M = row[:, None] * problem.dense() * column
    row, column = _power_of_two(row), _power_of_two(column)
    q = row * problem.q
    size = float(_power_of_two(np.array([np.max(np.abs(q), initial=0.0) or 1.0]))[0])
    return ScaledProblem(row[:, None] * problem.dense() * column, q / size, row, column, size)


def span_of_scales(scaled: ScaledProblem) -> float:
    """Return the ratio of the largest to the smallest nonzero |number| in M' and q', 1 where all are zero.

    Examples
    --------
    >>> span_of_scales(equilibrate(LCP([[4.0, 0.0], [0.0, 64.0]], [-8.0, 1.0])))
    32.0
    """
    magnitudes = np.abs(np.append(scaled.M, scaled.q))
    nonzero = magnitudes[magnitudes > 0.0]
    return float(nonzero.max() / nonzero.min()) if nonzero.size else 1.0


def _inverse_root(largest: Vector) -> Vector:
    return np.asarray(1.0 / np.sqrt(np.where(largest > 0.0, largest, 1.0)))


def _power_of_two(x: Vector) -> Vector:
    exponent = np.clip(np.rint(np.log2(x)), -LARGEST_EXPONENT, LARGEST_EXPONENT)
    return np.asarray(np.exp2(exponent))
