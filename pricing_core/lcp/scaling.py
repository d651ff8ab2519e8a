"""Equilibration: an equivalent problem whose rows and columns are of size about one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp.problem import LCP
from pricing_core.linalg.equilibration import equilibration


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

    Raises
    ------
    NumericalError
        Scaled so, q exceeds the range of floating-point numbers.

    Examples
    --------
    >>> equilibrate(LCP([[4.0, 0.0], [0.0, 64.0]], [-8.0, 1.0])).M
    array([[1., 0.],
           [0., 1.]])
    """
    M = problem.dense()
    row, column = equilibration(M)
    with np.errstate(over="ignore"):
        q = row * problem.q
    largest = float(np.abs(q).max(initial=0.0))
    if not math.isfinite(largest):
        raise NumericalError("q is too large for M: no floating-point number scales both to a size near one")
    size = math.ldexp(1.0, math.frexp(largest)[1] - 1) if largest > 0.0 else 1.0
    return ScaledProblem(row[:, None] * M * column, q / size, row, column, size)
