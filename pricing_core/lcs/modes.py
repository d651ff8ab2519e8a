"""The modes of a linear complementarity system: index sets and their equations (11.70)-(11.72)."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from operator import index
from typing import Any, NamedTuple

from numpy.typing import NDArray

from pricing_core.arrays import IndexSet
from pricing_core.errors import InvalidInputError


class ModeEquations(NamedTuple):
    """x' = A x + B_I u_I, 0 = C_I x + D_II u_I (11.71), in floating-point or rational numbers."""

    A: NDArray[Any]  # (n, n)
    B: NDArray[Any]  # (n, |I|)
    C: NDArray[Any]  # (|I|, n)
    D: NDArray[Any]  # (|I|, |I|)


def as_mode(mode: Iterable[int], k: int) -> IndexSet:
    """Return the index set sorted, or raise InvalidInputError.

    Raises
    ------
    InvalidInputError
        An index is no integer, appears twice, or lies outside 0 ... k - 1.

    Examples
    --------
    >>> as_mode([2, 0], 3)
    (0, 2)
    """
    try:
        indices = tuple(sorted(index(i) for i in mode))
    except TypeError as error:
        raise InvalidInputError("mode", mode, "a sequence of integers") from error
    if len(set(indices)) < len(indices) or any(not 0 <= i < k for i in indices):
        raise InvalidInputError("mode", mode, f"distinct indices from 0 to {k - 1}")
    return indices


def all_modes(k: int) -> Iterator[IndexSet]:
    """Return the 2**k index sets, by size and then in lexicographic order.

    Examples
    --------
    >>> list(all_modes(2))
    [(), (0,), (1,), (0, 1)]
    """
    return itertools.chain.from_iterable(itertools.combinations(range(k), size) for size in range(k + 1))


def mode_equations(
    A: NDArray[Any], B: NDArray[Any], C: NDArray[Any], D: NDArray[Any], mode: IndexSet
) -> ModeEquations:
    """Return the matrices of (11.71)."""
    chosen = list(mode)
    return ModeEquations(A, B[:, chosen], C[chosen], D[chosen][:, chosen])
