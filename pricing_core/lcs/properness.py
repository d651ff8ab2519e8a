"""Row and column properness of the transfer matrix, with leading coefficient matrices (11.84)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from pricing_core.arrays import Matrix, check_type
from pricing_core.lcs.markov import exact_markov_parameters
from pricing_core.lcs.rational_system import RationalSystem, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import RationalMatrix, exact_rank, rounded


@dataclass(frozen=True, slots=True, eq=False)
class LeadingCoefficients:
    """G(s) = diag(s**degrees) (B_0 + B_1 / s + ...) by rows, or the same with the diagonal on the right.

    Parameters
    ----------
    degrees : tuple of (int or None)
        The exponent of each row or column, at most 0; None where it is zero for every s.
    matrix : Matrix, shape (k, k)
        B_0, the leading coefficient matrix, zero in the rows or columns that vanish.
    exact : array of rationals, shape (k, k)
    """

    degrees: tuple[int | None, ...]
    matrix: Matrix
    exact: RationalMatrix

    @property
    def is_invertible(self) -> bool:
        """Whether B_0 is invertible: G is then row proper, or column proper."""
        return exact_rank(self.exact) == len(self.degrees)


def leading_row_coefficients(system: LCS) -> LeadingCoefficients:
    """Return degrees and leading coefficients of the rows of G(s); exact.

    Cost: up to n + 1 Markov parameters in rational arithmetic.

    Parameters
    ----------
    system : LCS

    Examples
    --------
    G = [[1/s, 1/s**2], [0, 1/s]]:

    >>> G = LCS([[0, 1], [0, 0]], [[1, 0], [0, 1]], [[1, 0], [0, 1]])
    >>> leading = leading_row_coefficients(G)
    >>> leading.degrees, leading.matrix.tolist()
    ((-1, -1), [[1.0, 0.0], [0.0, 1.0]])
    """
    check_type("system", system, LCS)
    return _leading_rows(rational_system(system))


def leading_column_coefficients(system: LCS) -> LeadingCoefficients:
    """Return degrees and leading coefficients of the columns of G(s); exact, at the cost of those of the rows.

    Parameters
    ----------
    system : LCS
    """
    check_type("system", system, LCS)
    A, B, C, D = rational_system(system)
    rows = _leading_rows(RationalSystem(A.T, C.T, B.T, D.T))
    return LeadingCoefficients(rows.degrees, rows.matrix.T, rows.exact.T)


def is_row_proper(system: LCS) -> bool:
    """Tell whether G(s) = diag(s**m_i) B(s) with B and its inverse proper (11.84); exact.

    Parameters
    ----------
    system : LCS

    Examples
    --------
    >>> is_row_proper(LCS([[0]], [[1, 1]], [[1], [1]]))
    False
    """
    check_type("system", system, LCS)
    return leading_row_coefficients(system).is_invertible


def is_column_proper(system: LCS) -> bool:
    """Tell whether G(s) = B(s) diag(s**m_j) with B and its inverse proper (11.84); exact.

    Parameters
    ----------
    system : LCS

    Examples
    --------
    G = [[1/s, 1/s**2], [1, 1]] is row proper and not column proper:

    >>> G = LCS([[0, 1], [0, 0]], [[1, 0], [0, 1]], [[1, 0], [0, 0]], [[0, 0], [1, 1]])
    >>> is_row_proper(G), is_column_proper(G)
    (True, False)
    """
    check_type("system", system, LCS)
    return leading_column_coefficients(system).is_invertible


def _leading_rows(system: RationalSystem) -> LeadingCoefficients:
    n, k = system.shape
    degrees: list[int | None] = [None] * k
    exact = np.full((k, k), fmpq(0), dtype=object)
    for j, H in enumerate(exact_markov_parameters(system, n + 1)):
        for i in range(k):
            if degrees[i] is None and H[i].any():
                degrees[i], exact[i] = -j, H[i]
        if None not in degrees:
            break
    return LeadingCoefficients(tuple(degrees), rounded(exact), exact)
