"""Total invertibility of the transfer matrix: the modes with singular G_II (Theorem 11.1)."""

from __future__ import annotations

import math

from flint import fmpz_poly

from pricing_core.arrays import IndexSet, check_type
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.modes import all_modes
from pricing_core.lcs.rational_system import rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.transfer_matrix import polynomial_transfer
from pricing_core.linalg.principal_minors import principal_minors

LARGEST_PAIRS = 12  # 2**k modes


def singular_modes(system: LCS) -> tuple[IndexSet, ...]:
    """Return the index sets I with det G_II(s) = 0 for every s; exact.

    None of them means that G is totally invertible, and by Theorem 11.1 that V_I (+) T_I = R^n in every mode.

    Parameters
    ----------
    system : LCS

    Raises
    ------
    InvalidInputError
        k > 12: there are too many modes.

    Notes
    -----
    Cost: see `pricing_core.linalg.principal_minors`; 0.1 s for n = k = 10.

    Examples
    --------
    >>> singular_modes(LCS([[0]], [[1, 1]], [[1], [1]]))
    ((0, 1),)
    """
    check_type("system", system, LCS)
    return modes_of_zero_minors(transfer_minors(system))


def transfer_minors(system: LCS) -> list[fmpz_poly]:
    """Return det G_II(s) times one positive polynomial for all I; bit i of the position tells whether i is in I.

    Raises
    ------
    InvalidInputError
        k > 12.

    Examples
    --------
    G = 0.3/(s + 1): the numerator and the denominator, both times 10.

    >>> transfer_minors(LCS([[-1]], [[1]], [[0.3]]))
    [10*x + 10, 3]
    """
    k = system.shape[1]
    if k > LARGEST_PAIRS:
        raise InvalidInputError("k", k, f"at most {LARGEST_PAIRS} where all 2**k modes are examined")
    p, N, _, row_scale = polynomial_transfer(rational_system(system))
    minors = principal_minors(p, N)  # the set I has the factors row_scale[i], i in I: it lacks the others
    return [
        minor * math.prod(scale for i, scale in enumerate(row_scale) if not members >> i & 1)
        for members, minor in enumerate(minors)
    ]


def modes_of_zero_minors(minors: list[fmpz_poly]) -> tuple[IndexSet, ...]:
    """Return the index sets whose minor vanishes, by size and then in lexicographic order."""
    k = len(minors).bit_length() - 1
    return tuple(mode for mode in all_modes(k) if not minors[sum(1 << i for i in mode)])
