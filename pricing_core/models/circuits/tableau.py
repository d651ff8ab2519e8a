"""The sparse tableau of a circuit: M s' = Phi a and P s + K a + R e = 0 in rational numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from flint import fmpq

from pricing_core.errors import InvalidInputError
from pricing_core.linalg.rational import RationalMatrix, from_flint, rational, to_flint
from pricing_core.linalg.rational_definite import is_exactly_positive_definite
from pricing_core.models.circuits.elements import (
    Branch,
    Capacitor,
    Coupling,
    Element,
    Inductor,
    pairs_of,
)
from pricing_core.models.circuits.equations import GROUND, ONE, Row, Symbol, current, symbols, total
from pricing_core.models.circuits.signals import Value
from pricing_core.models.circuits.sources import CurrentSource, VoltageSource


class Tableau(NamedTuple):
    """M s' = Phi a, P s + K a + R e = 0: s states, a node voltages, currents and reverse voltages, e sources.

    The rows are Kirchhoff's current law at every node but the ground, and the equations of the elements.
    """

    states: tuple[Symbol, ...]
    unknowns: tuple[Symbol, ...]
    sources: tuple[Symbol, ...]
    pairs: tuple[str, ...]
    M: RationalMatrix  # (n, n): capacitances and inductances
    Phi: RationalMatrix  # (n, a)
    P: RationalMatrix  # (m, n)
    K: RationalMatrix  # (m, a)
    R: RationalMatrix  # (m, e)

    @property
    def rate(self) -> RationalMatrix:
        """M^-1 Phi, shape (n, a)."""
        rest = self.M.copy()
        np.fill_diagonal(rest, fmpq(0))
        if not rest.any():
            return np.asarray(self.Phi / self.M.diagonal()[:, None])
        return from_flint(to_flint(self.M).solve(to_flint(self.Phi)))


def tableau(elements: Sequence[Element], *, with_one: bool = False) -> Tableau:
    """Return the equations of a circuit whose topology was checked.

    Raises
    ------
    InvalidInputError
        Coupled inductors whose inductance matrix is not positive definite.

    Examples
    --------
    A capacitor that discharges through a resistor, unknowns v(a), i(C1), i(R1):

    >>> from pricing_core.models.circuits.elements import Resistor
    >>> equations = tableau([Capacitor("C1", "a", "0", 2), Resistor("R1", "a", "0", 5)])
    >>> equations.K.tolist(), equations.P.T.tolist(), equations.M.tolist()
    ([[0, 1, 1], [1, 0, 0], [1, 0, -5]], [[0, -1, 0]], [[2]])
    """
    branches = [branch for element in elements for branch in element.branches]
    stores = [element for element in elements if isinstance(element, Capacitor | Inductor)]
    pairs = tuple(name for element in elements for name in pairs_of(element))
    nodes = dict.fromkeys(
        node for branch in branches for node in (branch.plus, branch.minus) if node != GROUND
    )
    rows = [
        *_current_laws(list(nodes), branches),
        *(row for element in elements for row in element.equations),
    ]
    given = [name for name, _ in source_values(elements, with_one=with_one)]
    states, sources = symbols("state", (store.name for store in stores)), symbols("source", given)
    unknowns = (
        *symbols("v", nodes),
        *symbols("i", dict.fromkeys((*(branch.name for branch in branches), *pairs))),
        *symbols("reverse", pairs),
    )
    forces = [store.force for store in stores]
    return Tableau(
        states,
        unknowns,
        sources,
        pairs,
        _storage(elements, stores),
        _matrix(forces, unknowns),
        *(_matrix(rows, columns) for columns in (states, unknowns, sources)),
    )


def source_values(elements: Sequence[Element], *, with_one: bool = False) -> list[tuple[str, Value]]:
    """Return the independent sources with their values, and the constant 1 where an equation measures in it.

    Or where that is wanted in any case.
    """
    values: list[tuple[str, Value]] = [
        (element.name, element.value)
        for element in elements
        if isinstance(element, VoltageSource | CurrentSource)
    ]
    if with_one or any(("source", ONE) in row for element in elements for row in element.equations):
        values.append((ONE, 1))
    return values


def _current_laws(nodes: list[str], branches: Sequence[Branch]) -> list[Row]:
    """Return, for every node, the sum of the currents that leave it."""
    laws: dict[str, Row] = {node: {} for node in nodes}
    for branch in branches:
        for node, sign in ((branch.plus, 1), (branch.minus, -1)):
            if node != GROUND:
                laws[node] = total(laws[node], current(branch.name, sign))
    return list(laws.values())


def _storage(elements: Sequence[Element], stores: Sequence[Capacitor | Inductor]) -> RationalMatrix:
    """Return M: capacitances on the diagonal, and the inductance matrix."""
    M = np.full((len(stores),) * 2, fmpq(0), dtype=object)
    place = {store.name: i for i, store in enumerate(stores)}
    for i, store in enumerate(stores):
        M[i, i] = rational(store.farads if isinstance(store, Capacitor) else store.henries)
    couplings = [element for element in elements if isinstance(element, Coupling)]
    for coupling in couplings:
        i, j = place[coupling.first], place[coupling.second]
        mutual = rational(coupling.coefficient) * rational(math.sqrt(float(M[i, i] * M[j, j])))
        M[i, j] = M[j, i] = M[i, j] + mutual
    if couplings and not is_exactly_positive_definite(M):
        names = ", ".join(coupling.name for coupling in couplings)
        raise InvalidInputError(
            "couplings", names, "weak enough for a positive stored energy: reduce a coefficient"
        )
    return M


def _matrix(rows: Sequence[Row], columns: Sequence[Symbol]) -> RationalMatrix:
    place = {symbol: j for j, symbol in enumerate(columns)}
    M = np.full((len(rows), len(columns)), fmpq(0), dtype=object)
    for i, row in enumerate(rows):
        for symbol in row.keys() & place.keys():
            M[i, place[symbol]] = row[symbol]
    return M
