"""The relative degree of a small system in exact arithmetic, whatever the scales of its data."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

from flint import fmpz_poly

from pricing_core.arrays import IndexSet
from pricing_core.lcs.rational_system import rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.transfer_matrix import polynomial_transfer
from pricing_core.linalg.polynomial_tableau import Tableau
from pricing_core.linalg.principal_minors import PolynomialMatrix

LARGEST_EXACT = 6  # pairs up to which every mode is inverted in exact arithmetic
LARGEST_STATE = 12
LONGEST_COEFFICIENT = 4000  # binary digits of the polynomials


def exact_degree(system: LCS, modes: Iterable[IndexSet]) -> int | None:
    """Return the largest power of s in G_II(s)^-1 over the given modes I, at least 0, or None: too costly.

    The inverses are computed over the rational functions. Modes whose G_II is singular for every s are passed
    over.

    Cost: a millisecond for n = 2 and k = 4, a tenth of a second for n = 12 and k = 6, up to half a second where
    the numbers are dozens of orders of magnitude apart; None where n > 12 or they are hundreds apart.

    Examples
    --------
    G(s) = 1e-9 + 1/s tends to the feedthrough, 1/s alone to zero:

    >>> exact_degree(LCS([[0]], [[1]], [[1]], [[1e-9]]), [(0,)])
    0
    >>> exact_degree(LCS([[0]], [[1]], [[1]]), [(0,)])
    1
    """
    if system.shape[0] > LARGEST_STATE:
        return None
    p, N, *_ = polynomial_transfer(rational_system(system))
    if max(entry.height_bits() for entry in (p, *chain.from_iterable(N))) > LONGEST_COEFFICIENT:
        return None
    parts = ([[N[i][j] for j in mode] for i in mode] for mode in modes)
    degrees = (_degree_of_inverse(p, part) for part in parts)
    return max((degree for degree in degrees if degree is not None), default=0)


def _degree_of_inverse(p: fmpz_poly, N: PolynomialMatrix) -> int | None:
    """Return the largest power of s in (N / p)^-1, None where N is singular."""
    m = len(N)
    zero = fmpz_poly()
    rows = [[*(-entry for entry in row), zero] for row in N]  # p y - N u = 0
    tableau = Tableau(p, rows, tuple(range(m)), tuple(range(m, 2 * m)))
    for r in range(m):
        c = next((j for j in range(m) if tableau.nonbasic[j] >= m and tableau.rows[r][j]), None)
        if c is None:
            return None
        tableau = tableau.pivot(r, c)
    return int(max(entry.degree() for row in tableau.rows for entry in row) - tableau.d.degree())
