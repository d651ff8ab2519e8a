"""Circuits of positive weight: where a star diverges."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.arcs import Arcs
from pricing_core.max_plus.circuits import heaviest_circuit
from pricing_core.max_plus.matrices import TOP, Numbers, is_exact
from pricing_core.max_plus.scalars import UNIT
from pricing_core.max_plus.spectrum import mean_of_circuits


def diverging(graph: Arcs, *, tolerance: float | None = None, sizes: Numbers | None = None) -> BoolVector:
    """Return which nodes lie in a class with a circuit of positive weight, shape (n,).

    Parameters
    ----------
    graph : Arcs
        Top is allowed.
    tolerance : float, optional
        A circuit counts if its mean weight is larger. Default: 0 for exact weights; for floats what rounding
        may make of a circuit of weight zero, n 2**-52 times the mean size of its own weights, n being the number
        of nodes in its class.
    sizes : array, shape (m,), optional
        Sizes of the numbers whose sums are the weights. Default: those of the weights themselves.
    """
    label, finite = graph.classes(), graph.weight < TOP
    endless = (label[graph.head] == label[graph.tail]) & ~finite
    part = graph.only(np.asarray(finite))
    sizes = np.abs(part.weight) if sizes is None else sizes[finite]
    found = mean_of_circuits(part.with_weights(_lowered(part, sizes, tolerance))).ratio > 0
    return np.asarray(found | np.isin(label, label[graph.head[endless]]))


def diverging_circuit(graph: Arcs) -> tuple[int, ...]:
    """Return the nodes of a circuit of positive weight, tail before head, or () where there is none."""
    lowered = graph.with_weights(_lowered(graph, np.abs(graph.weight), None))
    solution = mean_of_circuits(lowered)
    return heaviest_circuit(lowered, solution) if solution.ratio.max() > 0 else ()


def _lowered(graph: Arcs, sizes: Numbers, tolerance: float | None) -> Numbers:
    """Return the weights less the share of each in what is still zero."""
    if is_exact(graph.weight):
        return np.asarray(graph.weight - Fraction(tolerance or 0))
    if tolerance is not None:
        return np.asarray(graph.weight - tolerance)
    label = graph.classes()
    return np.asarray(graph.weight - UNIT * np.bincount(label)[label[graph.head]] * sizes)
