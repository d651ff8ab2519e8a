"""Howard's policy iteration for the largest cycle ratio of every class of a graph.

One algorithm, two users
------------------------
The spectral problem of the max-plus algebra and the complementarity problem of an American option are both
of the form

    min over the choices k of row i of (N_k x + q_k)_i = 0    for all rows i,

and Howard's iteration (1960) solves both: take one choice per row (a *policy*), *evaluate* it, that is solve
the equations that are left, and *improve* it, that is take in each row a choice whose residual is least, until
no residual is negative.

* Here the choices of row i are the arcs j -> i; their residuals are x_i + lambda h_ij - A_ij - x_j. A policy
  leaves a graph with one arc into each node, and its equations are solved along trees and circuits.
* For an LCP there are two choices in row i, z_i and (M z + q)_i; a policy is a basic set. For the option they
  are "exercise" and "continue", and the equations are tridiagonal (`pricing_core.lcp.solve_policy_iteration`).
* With any number of affine choices per row the equations are the vertical LCP of Cottle and Dantzig (1970),
  see `pricing_core.max_plus.vertical`, which contains both: (11.66)-(11.67) is its row with two choices.

Where x = A x + b has one arc per row, the equations min(x - b, x - P x - c) = 0 are an LCP, and both
implementations go through the same policies; the tests hold them against each other.
All three run the loop of `pricing_core.lcp.policies`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.lcp.policies import iterate_policies
from pricing_core.max_plus.arcs import Arcs, IntVector
from pricing_core.max_plus.matrices import EPSILON, Numbers, is_exact, zero_like
from pricing_core.max_plus.policies import Classes, present
from pricing_core.max_plus.scalars import UNIT

TIE = 8.0  # roundings more than there are nodes: ratios that differ by less may be one


@dataclass(frozen=True, slots=True, eq=False)
class HowardSolution:
    """The largest cycle ratio of every class, and the potential that proves it.

    On the arcs j -> i inside a class, reduced = weight + potential_j - potential_i - ratio * holding <= 0, and
    equality holds for the arc of the policy; on circuits this says that no ratio is larger. For floats the
    inequality may fail by the rounding of the numbers in it.
    """

    label: IntVector  # (n,): the class of each node
    ratio: Numbers  # (n,): of its class; -inf where the node is on no circuit
    potential: Numbers  # (n,): 0 there
    arc: IntVector  # (n,): index of the policy's arc into each node; -1 there
    reduced: Numbers  # (m,): at most 0 inside classes; epsilon between them
    slack: Numbers  # (m,): what rounding may make of a reduced weight of zero
    error: Numbers  # (n,): what rounding may make of the ratio
    iterations: int

    @property
    def inner(self) -> BoolVector:
        """Which arcs lie inside a class, shape (m,)."""
        return np.asarray(self.reduced != EPSILON)


def howard(graph: Arcs, holding: Numbers, *, max_iterations: int = 1000) -> HowardSolution:
    """Find the largest ratio of weight to holding over the circuits of every class.

    Parameters
    ----------
    graph : Arcs
        n nodes and m arcs; all classes are treated at once.
    holding : array, shape (m,)
        What each arc counts, >= 0, with a positive sum on every circuit; ones for the cycle mean.
    max_iterations : int
        A few tens are usual, whatever the size.

    Raises
    ------
    IterationLimitError
        `max_iterations` were not enough.

    Notes
    -----
    Each iteration costs O(m + n log n), all in NumPy and SciPy. The ratio is that of a circuit, its sum rounded
    once. With floats the iteration goes in rounds: what a round finds is taken off the weights, whose circuits
    keep their order, and the next one starts from what is left; so that weights of any size beside each other
    are told apart. The last round leaves no reduced weight above the rounding of its own arc.
    Source: Cochet-Terrasson, Cohen, Gaubert, McGettrick, Quadrat 1998; the repair is that of Dasdan 2004.
    """
    label = graph.classes()
    inner = np.flatnonzero(label[graph.head] == label[graph.tail])
    n = graph.size
    zero = zero_like(graph.weight)
    ratio = np.full(n, EPSILON, dtype=graph.weight.dtype)
    potential, error = np.full(n, zero), np.full(n, zero)
    arc = np.full(n, -1)
    reduced = np.full(graph.head.size, EPSILON, dtype=graph.weight.dtype)
    slack = np.full(graph.head.size, zero)
    if not inner.size:
        return HowardSolution(label, ratio, potential, arc, reduced, slack, error, 0)
    nodes = present(graph.head[inner], n)
    place = np.empty(n, dtype=np.int64)
    place[nodes] = np.arange(nodes.size)
    classes = Classes(
        Arcs(nodes.size, place[graph.head[inner]], place[graph.tail[inner]], graph.weight[inner]),
        holding[inner],
        np.unique(label[nodes], return_inverse=True)[1],
    )
    found = _in_rounds(classes, max_iterations)
    ratio[nodes], error[nodes] = found.ratio[classes.label], found.error[classes.label]
    potential[nodes], arc[nodes] = found.potential, inner[found.arc]
    reduced[inner], slack[inner] = found.reduced, found.slack
    return HowardSolution(label, ratio, potential, arc, reduced, slack, error, found.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What the rounds end with."""

    arc: IntVector
    ratio: Numbers  # one for each class
    error: Numbers
    potential: Numbers
    reduced: Numbers
    slack: Numbers
    iterations: int


def _in_rounds(classes: Classes, max_iterations: int) -> _Found:
    graph, label = classes.graph, classes.label
    reduced, arc = graph.weight, classes.heaviest_arcs()
    potential, used = np.full(graph.size, zero_like(reduced)), 0
    while True:
        value, iterations = iterate_policies(
            partial(classes.evaluate, reduced),
            partial(classes.improve, reduced),
            arc,
            limit=max_iterations - used,
        )
        arc, used = value.arc, used + iterations
        potential = potential + value.potential
        reduced = reduced - value.ratio[label[graph.head]] * classes.holding
        reduced = reduced + (value.potential[graph.tail] - value.potential[graph.head])
        ratio, largest = classes.circuits_of(arc)
        if is_exact(reduced):
            none = zero_like(reduced)
            return _Found(arc, ratio, largest * none, potential, reduced, reduced * none, used)
        least = UNIT * classes.sizes(ratio)
        if (reduced <= least).all() and (np.abs(reduced[arc]) <= least[arc]).all():
            break
    many = (np.bincount(label) + TIE) * UNIT
    slack = many[label[graph.head]] * (np.abs(graph.weight) + largest[label[graph.head]])
    return _Found(arc, ratio, many * largest, potential, np.minimum(reduced, 0.0), slack, used)
