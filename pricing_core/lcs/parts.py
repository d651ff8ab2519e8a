"""The parts of a linear complementarity system that do not act on each other, or in one direction only."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pricing_core.arrays import BoolVector, IndexSet
from pricing_core.lcs.exosystem import Exosystem
from pricing_core.lcs.system import LCS, PiecewiseConstant


class Part(NamedTuple):
    """States and pairs of a system, and the system that they make by themselves."""

    states: IndexSet
    pairs: IndexSet
    system: LCS


def independent_parts(system: LCS) -> list[Part]:
    """Return the parts between which no entry of A, B, C, D is nonzero: each moves as if it were alone.

    Examples
    --------
    >>> [part[:2] for part in independent_parts(LCS([[0, 0], [0, 1]], [[0], [1]], [[0, 1]]))]
    [((0,), ()), ((1,), (0,))]
    """
    return _parts(system, "weak")


def strongly_connected_parts(system: LCS) -> list[Part]:
    """Return the parts within which everything acts on everything: G is block triangular over their pairs.

    det G_II is the product over the parts, with the G of each part alone.

    Examples
    --------
    >>> [part[:2] for part in strongly_connected_parts(LCS([[0, 1], [0, 0]], [[0], [1]], [[0, 1]]))]
    [((0,), ()), ((1,), (0,))]
    """
    return _parts(system, "strong")


def is_independent(system: LCS, part: Part) -> bool:
    """Tell whether the multipliers of the part act on nothing outside it."""
    _, B, _, D = system.given
    rows, pairs = (_outside(size, chosen) for size, chosen in zip(system.shape, part[:2], strict=True))
    columns = list(part.pairs)
    return not (np.any(B[:, columns][rows] != 0) or np.any(D[:, columns][pairs] != 0))


def _outside(size: int, chosen: IndexSet) -> BoolVector:
    outside = np.ones(size, dtype=np.bool_)
    outside[list(chosen)] = False
    return outside


def _parts(system: LCS, connection: Literal["weak", "strong"]) -> list[Part]:
    n = system.shape[0]
    A, B, C, D = (np.asarray(matrix != 0, dtype=bool) for matrix in system.given)
    graph = csr_array(np.block([[A, B], [C, D]]).T)  # from what acts to what it acts on
    count, labels = connected_components(graph, connection=connection)
    found = []
    for label in range(count):
        members = np.flatnonzero(labels == label).tolist()
        states = tuple(i for i in members if i < n)
        pairs = tuple(i - n for i in members if i >= n)
        found.append(Part(states, pairs, _restricted(system, states, pairs)))
    return found


def _restricted(system: LCS, states: IndexSet, pairs: IndexSet) -> LCS:
    A, B, C, D = system.given
    return LCS(
        A[np.ix_(states, states)],
        B[np.ix_(states, pairs)],
        C[np.ix_(pairs, states)],
        D[np.ix_(pairs, pairs)],
        _components(system.f, states),
        _components(system.g, pairs),
    )


def _components(signal: PiecewiseConstant | Exosystem, chosen: IndexSet) -> PiecewiseConstant | Exosystem:
    rows = list(chosen)
    if isinstance(signal, Exosystem):
        return Exosystem(signal.generator, signal.output[rows], signal.states, signal.times)
    return PiecewiseConstant(signal.times, signal.given[:, rows])
