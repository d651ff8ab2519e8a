"""Linear systems with complementarity and algebraic equations: a DAE (11.31) in which no side is the input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import BoolVector, IndexSet, Matrix, Vector, as_matrix, as_square_matrix, as_vector
from pricing_core.lcp.complementary_basis import complementary_basis
from pricing_core.lcs import LCS
from pricing_core.linalg.rational import exact_solution, rational_array, rounded


@dataclass(frozen=True, slots=True, eq=False)
class HorizontalSystem:
    """x' = A x + B_w w + B_z z + f, M w = N z + C x + g, 0 <= w _|_ z >= 0.

    Parameters
    ----------
    A : array_like, shape (n, n)
    B_w, B_z : array_like, shape (n, k)
    C : array_like, shape (k, n)
    M, N : array_like, shape (k, k)
        Either may be singular.
    f, g : array_like, shape (n,) and (k,)

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite.
    NumericalError
        No choice of one unknown of each pair is determined by the others.
    """

    A: Matrix
    B_w: Matrix
    B_z: Matrix
    C: Matrix
    M: Matrix
    N: Matrix
    f: Vector
    g: Vector
    traded: BoolVector  # (k,): whether z_i, rather than w_i, is an output of `to_lcs`

    def __init__(
        self,
        A: ArrayLike,
        B_w: ArrayLike,
        B_z: ArrayLike,
        C: ArrayLike,
        M: ArrayLike,
        N: ArrayLike,
        f: ArrayLike,
        g: ArrayLike,
    ) -> None:
        state, pairs = as_square_matrix("A", A), as_square_matrix("M", M)
        n, k = len(state), len(pairs)
        object.__setattr__(self, "A", state)
        object.__setattr__(self, "B_w", as_matrix("B_w", B_w, (n, k)))
        object.__setattr__(self, "B_z", as_matrix("B_z", B_z, (n, k)))
        object.__setattr__(self, "C", as_matrix("C", C, (k, n)))
        object.__setattr__(self, "M", pairs)
        object.__setattr__(self, "N", as_matrix("N", N, (k, k)))
        object.__setattr__(self, "f", as_vector("f", f, n))
        object.__setattr__(self, "g", as_vector("g", g, k))
        object.__setattr__(self, "traded", complementary_basis(pairs, self.N))

    def to_lcs(self) -> LCS:
        """Return the LCS whose outputs are the w_i, or the z_i of the traded pairs, and whose inputs are the others.

        Examples
        --------
        x' = -z with z = w + x, whose output may be either of the two:

        >>> HorizontalSystem([[0]], [[0]], [[-1]], [[1]], [[1]], [[1]], [0], [0]).to_lcs().C
        array([[1.]])
        """
        A, B_w, B_z, C, M, N, f, g = (
            rational_array(part)
            for part in (self.A, self.B_w, self.B_z, self.C, self.M, self.N, self.f, self.g)
        )
        k = len(M)
        dependent, independent = np.where(self.traded, -N, M), np.where(self.traded, -M, N)
        table = exact_solution(dependent, np.column_stack([independent, C, g]))
        assert table is not None  # the traded pairs make it regular
        D, C, g = table[:, :k], table[:, k:-1], table[:, -1]
        outputs = np.where(self.traded, B_z, B_w)
        inputs = np.where(self.traded, B_w, B_z)
        parts = A + outputs @ C, inputs + outputs @ D, C, D, f + outputs @ g, g
        return LCS(*(rounded(part) for part in parts))

    def pairs(self, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
        """Return w and z from the inputs and outputs of `to_lcs`, all of shape (m, k)."""
        return np.where(self.traded, u, y), np.where(self.traded, y, u)

    def where_w_vanishes(self, mode: IndexSet) -> BoolVector:
        """Return which w_i = 0 the mode of `to_lcs` imposes, z_i = 0 being imposed on the others, shape (k,)."""
        return np.isin(np.arange(self.traded.size), mode) ^ self.traded
