"""Circuits with names: any circuit of a graph, and the one that its policy runs through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pricing_core.max_plus.arcs import Arcs
from pricing_core.max_plus.howard import HowardSolution


def a_circuit(graph: Arcs) -> tuple[int, ...]:
    """Return the nodes of some circuit, tail before head, or () where there is none.

    Examples
    --------
    >>> from pricing_core.max_plus.arcs import arcs_of
    >>> a_circuit(arcs_of(np.array([[-np.inf, 1.0], [1.0, -np.inf]])))
    (0, 1)
    """
    inner = graph.inside_classes()
    if not inner.head.size:
        return ()
    before = np.full(graph.size, -1)
    before[inner.head] = inner.tail
    return _around(before, int(inner.head[0]))


def heaviest_circuit(graph: Arcs, solution: HowardSolution) -> tuple[int, ...]:
    """Return the nodes of a circuit of the largest ratio, tail before head, or () where there is none."""
    before = np.where(solution.arc >= 0, graph.tail[solution.arc], -1) if graph.head.size else solution.arc
    start = int(np.argmax(solution.ratio))
    return _around(before, start) if before[start] >= 0 else ()


def named(circuit: Sequence[int], names: Sequence[str] = ()) -> str:
    """Return the circuit as a closed list of names, in the order in which it is passed.

    Examples
    --------
    >>> named((0, 2)), named((0, 1), ("press", "drill"))
    ('0 -> 2 -> 0', 'press -> drill -> press')
    """
    words = [names[node] if names else str(node) for node in circuit]
    return " -> ".join([*words, words[0]])


def _around(before: np.ndarray, node: int) -> tuple[int, ...]:
    """Walk back until a node returns; return the circuit from its least node on, in the arcs' direction."""
    seen: dict[int, int] = {}
    while node not in seen:
        seen[node] = len(seen)
        node = int(before[node])
    circuit = list(seen)[seen[node] :][::-1]
    least = circuit.index(min(circuit))
    return tuple(circuit[least:] + circuit[:least])
