"""The hybrid representation of section 11.2.1: at each diode, current or reverse voltage as the multiplier."""

from __future__ import annotations

import numpy as np

from pricing_core.errors import InvalidInputError
from pricing_core.linalg.rational import RationalMatrix, exact_kernel, exact_rank, sparse_product
from pricing_core.models.circuits.tableau import Tableau


def chosen_multipliers(equations: Tableau, K: RationalMatrix) -> tuple[list[int], list[int]]:
    """Return the columns of a that are the multipliers u, and those that are the slacks y.

    With states and sources at zero, the values that the diodes' currents and reverse voltages can take form a space of
    dimension k. One diode after the other its current, or else its reverse voltage, is taken for u_i so that the
    multipliers chosen so far are independent on that space. In a passive network one of the two always is: otherwise
    the remaining diodes, to which no power could come, would leave too large a space. With controlled sources an
    earlier choice may have to be taken back.

    Parameters
    ----------
    K : RationalMatrix
        The coefficients of a, derivatives of hidden constraints included.

    Raises
    ------
    InvalidInputError
        Neither will do, which takes controlled sources; or some voltage or current is not determined at all.

    Examples
    --------
    Across a capacitor the voltage cannot be chosen, in series with an inductor the current cannot:

    >>> from pricing_core.models.circuits.elements import Capacitor, Diode, Inductor
    >>> from pricing_core.models.circuits.tableau import tableau
    >>> for store in (Capacitor("S", "a", "0", 1), Inductor("S", "a", "0", 1)):
    ...     equations = tableau([store, Diode("D1", "0", "a")])
    ...     (u,), _ = chosen_multipliers(equations, equations.K)
    ...     equations.unknowns[u]
    ('i', 'D1')
    ('reverse', 'D1')
    """
    possible = exact_kernel(K)
    place = {symbol: j for j, symbol in enumerate(equations.unknowns)}
    pairs = [(place["i", diode], place["reverse", diode]) for diode in equations.pairs]
    multipliers = _independent(possible, pairs, [])
    if multipliers is None:
        remedy = "free to conduct or block: controlled sources fix both the current and the voltage of one"
        raise InvalidInputError("diodes", ", ".join(equations.pairs), remedy)
    loose = sparse_product(possible, exact_kernel(possible[multipliers]))
    if loose.shape[1]:
        moved = [equations.unknowns[j] for j in np.flatnonzero(np.any(loose != 0, axis=1))]
        names = ", ".join(f"{kind}({name})" for kind, name in moved if kind != "reverse")
        remedy = (
            "determined by the circuit: tie a floating part to ground, or put resistors into loops of sources"
        )
        raise InvalidInputError("voltages and currents", names, remedy)
    return multipliers, [i + v - u for (i, v), u in zip(pairs, multipliers, strict=True)]


def _independent(
    possible: RationalMatrix, pairs: list[tuple[int, int]], chosen: list[int]
) -> list[int] | None:
    """Choose one row of each further pair so that all chosen rows are independent; None if that cannot be."""
    if len(chosen) == len(pairs):
        return chosen
    for row in pairs[len(chosen)]:
        if exact_rank(possible[[*chosen, row]]) > len(chosen):
            found = _independent(possible, pairs, [*chosen, row])
            if found is not None:
                return found
    return None
