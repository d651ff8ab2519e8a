"""A linear complementarity system with rational data."""

from __future__ import annotations

from decimal import Decimal
from typing import NamedTuple

import numpy as np
from flint import fmpq

from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import RationalMatrix, rational_array

MOST_DIGITS = 12
EXACT_SIZE = 24  # n + k up to which exact arithmetic costs no more than milliseconds a mode


class RationalSystem(NamedTuple):
    """A, B, C, D of (11.69) as arrays of rationals."""

    A: RationalMatrix  # (n, n)
    B: RationalMatrix  # (n, k)
    C: RationalMatrix  # (k, n)
    D: RationalMatrix  # (k, k)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, k): the number of states and of complementary pairs."""
        return self.B.shape[0], self.B.shape[1]


def rational_system(system: LCS) -> RationalSystem:
    """Return the rational data of the system: what was given, by `pricing_core.linalg.rational.rational`.

    Examples
    --------
    >>> rational_system(LCS([[-0.1]], [[1]], [[1]])).A.tolist()
    [[-1/10]]
    """
    return RationalSystem(*(rational_array(matrix) for matrix in system.given))


def has_short_numbers(system: LCS) -> bool:
    """Tell whether the data look meant as they are: integers, fractions, decimals of at most 12 digits.

    Numbers that come out of a computation carry rounding, and what is singular without it must not count as regular.

    Examples
    --------
    >>> has_short_numbers(LCS([[-0.1]], [[1]], [[1e-6]])), has_short_numbers(LCS([[-0.1]], [[2**0.5]], [[1]]))
    (True, False)
    """
    return all(
        not isinstance(entry, float) or len(Decimal(repr(entry)).normalize().as_tuple().digits) <= MOST_DIGITS
        for matrix in system.given
        for entry in matrix.ravel().tolist()
    )


def rational_offsets(system: LCS, t: float) -> tuple[RationalMatrix, RationalMatrix]:
    """Return f and g as they hold just after t, shapes (n,) and (k,)."""
    return rational_array(system.f.given_after(t)), rational_array(system.g.given_after(t))


def with_constant_state(system: RationalSystem, f: RationalMatrix, g: RationalMatrix) -> RationalSystem:
    """Return the system without offsets whose last state is the constant 1: (A, f; 0, 0), (B; 0), (C, g), D."""
    n, k = system.shape
    bottom = np.full((1, n + 1 + k), fmpq(0), dtype=object)
    return RationalSystem(
        np.vstack([np.hstack([system.A, f[:, None]]), bottom[:, : n + 1]]),
        np.vstack([system.B, bottom[:, n + 1 :]]),
        np.hstack([system.C, g[:, None]]),
        system.D,
    )
