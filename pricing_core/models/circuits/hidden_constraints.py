"""Capacitor loops and inductor cut-sets: constraints on the states that the equations hide, and how states jump.

s' = L a, P s + K a + R e = 0. Whatever combination of the rows has no a in it binds the states to the sources; its
derivative in time is a further equation for a. This is repeated until nothing new is found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import fmpq

from pricing_core.errors import InvalidInputError
from pricing_core.linalg.rational import (
    RationalMatrix,
    exact_image,
    exact_kernel,
    exact_solution,
    sparse_product,
)
from pricing_core.models.circuits.tableau import Tableau


class CompletedEquations(NamedTuple):
    """P s + K a + R e = 0 with all derivatives that bind a, and P_s s + R_s e = 0 free of a.

    Here e stands for the sources and their derivatives (e, e', e'', ...), as many as the columns of R.
    """

    P: RationalMatrix
    K: RationalMatrix
    R: RationalMatrix
    P_s: RationalMatrix
    R_s: RationalMatrix


def completed(equations: Tableau) -> CompletedEquations:
    """Differentiate the hidden constraints until they are all known.

    Raises
    ------
    InvalidInputError
        The sources would have to satisfy an equation of their own.

    Examples
    --------
    Two capacitors in parallel hide that their voltages are equal, and so how they share their current:

    >>> from pricing_core.models.circuits.elements import Capacitor
    >>> from pricing_core.models.circuits.tableau import tableau
    >>> pair = tableau([Capacitor("C1", "a", "0", 1), Capacitor("C2", "a", "0", 3)])
    >>> completed(pair).P_s.tolist()
    [[1, -1]]
    """
    rate, sources = equations.rate, len(equations.sources)
    P, K, R = equations.P, equations.K, equations.R
    found = -1
    while True:
        free = exact_kernel(K.T).T  # combinations without a
        P_s, R_s = _independent(sparse_product(free, P), sparse_product(free, R), equations, sources)
        if len(P_s) == found:
            return CompletedEquations(P, K, R, P_s, R_s)
        found = len(P_s)
        zero = np.full((len(P_s), sources), fmpq(0), dtype=object)
        wider = np.hstack([equations.R, np.full((len(equations.R), R.shape[1]), fmpq(0), dtype=object)])
        P = np.vstack([equations.P, 0 * P_s])
        K = np.vstack([equations.K, sparse_product(P_s, rate)])
        R = np.vstack([wider, np.hstack([zero, R_s])])


def _independent(
    P: RationalMatrix, R: RationalMatrix, equations: Tableau, sources: int
) -> tuple[RationalMatrix, RationalMatrix]:
    """Return independent rows that span those of P, R; refuse a row that binds sources alone."""
    alone = sparse_product(exact_kernel(P.T).T, R)
    if np.any(alone):
        columns = np.flatnonzero(np.any(alone != 0, axis=0)) % sources
        names = ", ".join(equations.sources[j][1] for j in sorted(set(columns.tolist())))
        remedy = "free to take any value: add a resistor in series with a voltage or beside a current source"
        raise InvalidInputError("sources", names, remedy)
    rows = exact_image(np.hstack([P, R]).T).T
    return rows[:, : P.shape[1]], rows[:, P.shape[1] :]


def continuous_coordinates(
    equations: Tableau, constraint: RationalMatrix, multipliers: list[int]
) -> RationalMatrix:
    """Return W for which x = W s is continuous when the sources step, and x = s' for some of the states s.

    W is zero on the jump space {L a : K a = 0}, continued as in (11.76), of the circuit whose multipliers are zero, and
    takes the states that satisfy the constraint P_s s = 0 to some of their entries, the first possible ones.

    Examples
    --------
    Capacitors of 1 and 3 in parallel: what stays when they share their charge is the mean (v1 + 3 v2)/4.

    >>> from pricing_core.models.circuits.elements import Capacitor
    >>> from pricing_core.models.circuits.tableau import tableau
    >>> pair = tableau([Capacitor("C1", "a", "0", 1), Capacitor("C2", "a", "0", 3)])
    >>> continuous_coordinates(pair, completed(pair).P_s, []).tolist()
    [[1/4, 3/4]]
    """
    n = len(equations.states)
    K = np.delete(equations.K, multipliers, axis=1)
    rate = np.delete(equations.rate, multipliers, axis=1)
    jumps = np.full((n, 0), fmpq(0), dtype=object)
    while True:
        pairs = exact_kernel(np.hstack([sparse_product(equations.P, jumps), K]))
        larger = exact_image(sparse_product(rate, pairs[jumps.shape[1] :]))
        if larger.shape[1] == jumps.shape[1]:
            break
        jumps = larger
    consistent = exact_kernel(constraint[:, ::-1])[::-1, ::-1]
    identity = np.array([[fmpq(int(i == j)) for j in range(n)] for i in range(n)], dtype=object).reshape(n, n)
    coordinates = exact_solution(np.hstack([consistent, jumps]), identity)
    assert coordinates is not None  # the pencil is regular, since a is determined
    return coordinates[: consistent.shape[1]]
