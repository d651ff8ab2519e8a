"""Throughput and latency of a max-plus linear system."""

from __future__ import annotations

import numpy as np

from pricing_core.errors import NumericalError
from pricing_core.max_plus.algebra import add, multiply
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.cycle_time import cycle_time
from pricing_core.max_plus.divergence import diverging
from pricing_core.max_plus.matrices import EPSILON, TOP, Numbers, Scalar, alike, all_alike, dense, exact
from pricing_core.max_plus.scalars import as_number
from pricing_core.max_plus.star import dense_star
from pricing_core.max_plus.system import MaxPlusSystem, as_system


def throughput(system: MaxPlusSystem) -> Numbers:
    """Return how often each output happens per unit of time if inputs never make it wait, shape (p,).

    It is the inverse of the largest cycle time that the output sees; inf where it sees none above 0.

    Parameters
    ----------
    system : MaxPlusSystem, with p outputs

    Examples
    --------
    >>> throughput(MaxPlusSystem([[2.0, 5.0], [3.0, 3.0]]))
    array([0.25, 0.25])
    """
    paces = np.where(as_system("system", system).C == EPSILON, EPSILON, cycle_time(system.A)).max(axis=1)
    return np.array([1 / pace if pace > 0 else TOP for pace in paces])


def latency(system: MaxPlusSystem, period: Scalar | None = None) -> Numbers:
    """Return how long after the k-th input, at k times `period`, the k-th output is at most: shape (p, m).

    If u(k) = k period then y(k) <= k period + latency, and equality holds from some k on. Entries are epsilon
    where no path leads from the input to the output, and top where it falls behind without end.

    Parameters
    ----------
    system : MaxPlusSystem
        Starting from epsilon.
    period : float or Fraction, optional
        Time between inputs. Default: the largest cycle time of the system.

    Raises
    ------
    InvalidInputError
        The period is no finite number.
    NumericalError
        No period was told, and the system has no circuit.

    Notes
    -----
    The latency is D + C (A - period)* (B - period). Cost: O(n**3).
    Source: Geilen, Stuijk 2010 (latency of a max-plus matrix).

    Examples
    --------
    >>> latency(MaxPlusSystem([[2.0]], [[3.0]], [[1.0]]))
    array([[2.]])
    """
    own, given = all_alike(as_system("system", system).A, None if period is None else _one("period", period))
    pace = max(cycle_time(own)) if given[0] is None else given[0][0]
    if pace == EPSILON:
        raise NumericalError("the system has no circuit and so no period of its own: tell one")
    own, inputs = alike(own, system.B)
    graph, ahead = arcs_of(own), np.asarray(own - pace)
    endless = diverging(arcs_of(ahead), sizes=np.abs(graph.weight) + abs(pace))
    states = multiply(dense_star(ahead, endless), inputs - pace)
    return dense(add(system.D, multiply(system.C, states)))


def _one(field: str, number: object) -> Numbers:
    """Return a whole number or a Fraction as an exact vector of length 1, a float as one of floats."""
    value = as_number(field, number)
    return exact([value]) if not isinstance(number, float | np.floating) else np.array([value])
