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

from dataclasses import dataclass
from functools import cached_property, partial
from math import fsum

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order

from pricing_core.arrays import BoolVector
from pricing_core.lcp.policies import iterate_policies
from pricing_core.max_plus.arcs import Arcs, IntVector
from pricing_core.max_plus.matrices import EPSILON, Numbers, is_exact, zero_like

UNIT = float(np.finfo(np.float64).eps)
ROUNDING = (
    2.0**-44
)  # of the largest potential of a class: what is gained below that is no gain, until the next round
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


@dataclass(frozen=True, slots=True, eq=False)
class _Value:
    """What a policy is worth: after the repair in `_Classes.evaluate` it has one circuit per class."""

    arc: IntVector
    ratio: Numbers  # one for each class
    potential: Numbers
    tolerance: Numbers  # one for each class: gains below are rounding


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
    nodes, ends = np.unique(np.concatenate([graph.head[inner], graph.tail[inner]]), return_inverse=True)
    head, tail = np.split(ends, 2)
    classes = _Classes(
        Arcs(nodes.size, head, tail, graph.weight[inner]),
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


def _in_rounds(classes: "_Classes", max_iterations: int) -> _Found:
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


@dataclass(frozen=True, eq=False)
class _Classes:
    """A disjoint union of strongly connected graphs with a circuit each."""

    graph: Arcs
    holding: Numbers  # (m,)
    label: IntVector  # (n,): 0 ... number of classes - 1

    @cached_property
    def _key(self) -> IntVector:
        return np.asarray(self.graph.head * self.graph.size + self.graph.tail)

    @cached_property
    def _heads_by_tail(self) -> csr_array:
        n = self.graph.size
        ones = np.ones(self.graph.head.size, dtype=np.int8)
        return csr_array((ones, (self.graph.tail, self.graph.head)), shape=(n, n))

    @cached_property
    def _by_label(self) -> tuple[IntVector, IntVector]:
        """The nodes in the order of their classes, and where each class begins."""
        order = np.argsort(self.label, kind="stable")
        return order, np.flatnonzero(np.diff(self.label[order], prepend=-1))

    def _rounding(self, weight: Numbers, potential: Numbers, missed: Numbers) -> Numbers:
        """Return for each class the gain below which a float comparison says nothing.

        `missed` is by how much the potentials fail the policy's own equations, which along a circuit of many arcs
        is more than the rounding of one sum.
        """
        order, start = self._by_label
        if is_exact(potential):
            return np.full(start.size, zero_like(potential))
        size = ROUNDING * np.maximum(np.abs(potential), np.abs(weight)) + 4.0 * np.abs(missed)
        return np.asarray(np.maximum.reduceat(size[order], start))

    def sizes(self, ratio: Numbers) -> Numbers:
        """Return the size of the numbers added on each arc, or of the least weight in its class."""
        of = self.label[self.graph.head]
        weight = np.abs(self.graph.weight)
        least = np.full(ratio.size, np.inf)
        np.minimum.at(least, of, np.where(weight == 0.0, np.inf, weight))
        least[least == np.inf] = 0.0
        return np.asarray(weight + np.abs(ratio[of] * self.holding) + least[of])

    def heaviest_arcs(self) -> IntVector:
        """Return the policy of the heaviest arc into each node."""
        return self._attaining(self.graph.weight, self.graph.largest_by_head(self.graph.weight))

    def evaluate(self, weight: Numbers, arc: IntVector) -> _Value:
        """Find the best circuit of each class, lead all its nodes there, and measure the ways."""
        before = self.graph.tail[arc]
        root, ratio = self._best_circuits(weight, arc, before)
        n = self.graph.size
        is_root = np.zeros(n, dtype=np.bool_)
        is_root[root] = True
        end, _ = follow(np.where(is_root, np.arange(n), before), np.zeros(n))
        arc = self._led_to(arc, is_root[end])
        own = weight[arc] - ratio[self.label] * self.holding[arc]
        reduced = own.copy()
        reduced[is_root] = zero_like(own)
        _, potential = follow(np.where(is_root, np.arange(n), self.graph.tail[arc]), reduced)
        missed = own + potential[self.graph.tail[arc]] - potential
        return _Value(arc, ratio, potential, self._rounding(weight[arc], potential, missed))

    def improve(self, weight: Numbers, value: _Value) -> IntVector | None:
        """Return the policy of the arcs that gain most, or None where none gains."""
        gain = weight + value.potential[self.graph.tail]
        gain = gain - value.ratio[self.label[self.graph.head]] * self.holding
        best = self.graph.largest_by_head(gain)
        better = best > value.potential + value.tolerance[self.label]
        return np.where(better, self._attaining(gain, best), value.arc) if better.any() else None

    def circuits_of(self, arc: IntVector) -> tuple[Numbers, Numbers]:
        """Return for the circuit of each class in this policy its ratio and its largest weight in size.

        The sum of floats is rounded once.
        """
        on_circuit = _on_circuits(self.graph.tail[arc])
        order = on_circuit[np.argsort(self.label[on_circuit], kind="stable")]
        start = np.flatnonzero(np.diff(self.label[order], prepend=-1))
        weight, holding = self.graph.weight[arc[order]], self.holding[arc[order]]
        total = np.add.reduceat(holding, start)
        if is_exact(weight):
            return np.add.reduceat(weight, start) / total, np.maximum.reduceat(np.abs(weight), start)
        values, ends = weight.tolist(), [*start[1:].tolist(), weight.size]
        sums = [fsum(values[first:last]) for first, last in zip(start.tolist(), ends, strict=True)]
        return np.array(sums) / total, np.maximum.reduceat(np.abs(weight), start)

    def _attaining(self, value: Numbers, best: Numbers) -> IntVector:
        attaining = np.flatnonzero(value == best[self.graph.head])
        found = np.empty(self.graph.size, dtype=np.int64)
        found[self.graph.head[attaining[::-1]]] = attaining[::-1]  # the first one stays
        return found

    def _best_circuits(self, weight: Numbers, arc: IntVector, before: IntVector) -> tuple[IntVector, Numbers]:
        """Return for each class a node of the policy's best circuit, and its ratio."""
        on_circuit = _on_circuits(before)
        place = np.searchsorted(on_circuit, before[on_circuit])
        least = np.arange(on_circuit.size)
        steps = 1
        while steps < 2 * on_circuit.size:
            least, place, steps = np.minimum(least, least[place]), place[place], 2 * steps
        roots, circuit = np.unique(least, return_inverse=True)
        total = _sums(circuit, weight[arc[on_circuit]], roots.size)
        ratio = total / _sums(circuit, self.holding[arc[on_circuit]], roots.size)
        root = on_circuit[roots]
        if is_exact(ratio):
            order = np.array(
                sorted(range(root.size), key=lambda k: (self.label[root[k]], ratio[k], -root[k]))
            )
        else:
            order = np.lexsort((-root, ratio, self.label[root]))
        last = np.flatnonzero(np.diff(self.label[root[order]], append=-1))
        return root[order[last]], ratio[order[last]]

    def _led_to(self, arc: IntVector, led: np.ndarray) -> IntVector:
        """Return the policy with the other nodes led, by the fewest arcs, to those that are."""
        if led.all():
            return arc
        n, graph = self.graph.size, self._heads_by_tail
        start = np.flatnonzero(led)
        extended = csr_array(
            (
                np.ones(graph.nnz + start.size, dtype=np.int8),
                np.concatenate([graph.indices, start]),
                np.append(graph.indptr, graph.nnz + start.size),
            ),
            shape=(n + 1, n + 1),
        )
        before = breadth_first_order(extended, n, directed=True, return_predecessors=True)[1]
        lost = np.flatnonzero(~led)
        repaired = arc.copy()
        repaired[lost] = np.searchsorted(self._key, lost * n + before[lost])
        return repaired


def _on_circuits(before: IntVector) -> IntVector:
    """Return the nodes on the circuits of a graph with one arc into each node."""
    far, steps = before, 1
    while steps < before.size:
        far, steps = far[far], 2 * steps
    return np.unique(far)


def follow(before: IntVector, weight: Numbers) -> tuple[IntVector, Numbers]:
    """Follow a graph with one arc into each node back for at least n arcs; return the ends and the weights.

    Roots are their own predecessors, of weight zero. By doubling: O(n log n).
    """
    total, steps = weight, 1
    while steps < before.size:
        further = before[before]
        if np.array_equal(further, before):
            break
        total, before, steps = total + total[before], further, 2 * steps
    return before, total


def _sums(label: IntVector, values: Numbers, count: int) -> Numbers:
    if is_exact(values):
        sums = np.zeros(count, dtype=object)
        np.add.at(sums, label, values)
        return sums
    return np.bincount(label, values, minlength=count)
