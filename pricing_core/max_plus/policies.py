"""Policies of one arc into each node: how they are evaluated and improved, in all classes at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import fsum

import numpy as np
from scipy.sparse.csgraph import breadth_first_order

from pricing_core.arrays import BoolVector
from pricing_core.max_plus.arcs import Arcs, IntVector, first_of_runs, graph_of_rows
from pricing_core.max_plus.matrices import Numbers, is_exact, zero_like

# Share of the largest potential of a class below which a gain is none, until the next round.
ROUNDING = 2.0**-44


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    """The value of a policy: after the repair in `Classes.evaluate` it has one circuit per class."""

    arc: IntVector
    ratio: Numbers  # one for each class
    potential: Numbers
    tolerance: Numbers  # one for each class: gains below are rounding


@dataclass(frozen=True, eq=False)
class Classes:
    """A disjoint union of strongly connected graphs with a circuit each."""

    graph: Arcs
    holding: Numbers  # (m,)
    label: IntVector  # (n,): 0 ... number of classes - 1

    @cached_property
    def _key(self) -> IntVector:
        return np.asarray(self.graph.head * self.graph.size + self.graph.tail)

    @cached_property
    def _heads_by_tail(self) -> tuple[IntVector, IntVector]:
        """The heads of the arcs in the order of their tails, and where each tail's begin."""
        order, start = self.graph.by_tail
        return self.graph.head[order], start

    @cached_property
    def _label_of_arc(self) -> IntVector:
        return self.label[self.graph.head]

    @cached_property
    def _by_label(self) -> tuple[IntVector, IntVector]:
        """The nodes in the order of their classes, and where each class begins."""
        order = np.argsort(self.label, kind="stable")
        return order, first_of_runs(self.label[order])

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
        of = self._label_of_arc
        weight = np.abs(self.graph.weight)
        least = np.full(ratio.size, np.inf)
        np.minimum.at(least, of, np.where(weight == 0.0, np.inf, weight))
        least[least == np.inf] = 0.0
        return np.asarray(weight + np.abs(ratio[of] * self.holding) + least[of])

    def heaviest_arcs(self) -> IntVector:
        """Return the policy of the heaviest arc into each node."""
        return self._attaining(self.graph.weight, self.graph.largest_by_head(self.graph.weight))

    def evaluate(self, weight: Numbers, arc: IntVector) -> Value:
        """Find the best circuit of each class, lead all its nodes there, and measure the ways."""
        before = self.graph.tail[arc]
        root, ratio, led = self._best_circuits(weight, arc, before)
        if not led.all():
            arc = self._led_to(arc, led)
            before = self.graph.tail[arc]
        own = weight[arc] - ratio[self.label] * self.holding[arc]
        ways, reduced = before.copy(), own.copy()
        ways[root], reduced[root] = root, zero_like(own)
        _, potential = follow(ways, reduced)
        missed = own + potential[before] - potential
        return Value(arc, ratio, potential, self._rounding(weight[arc], potential, missed))

    def improve(self, weight: Numbers, value: Value) -> IntVector | None:
        """Return the policy of the arcs that gain most, or None where none gains."""
        gain = weight + value.potential[self.graph.tail]
        gain = gain - value.ratio[self._label_of_arc] * self.holding
        best = self.graph.largest_by_head(gain)
        better = best > value.potential + value.tolerance[self.label]
        return np.where(better, self._attaining(gain, best), value.arc) if better.any() else None

    def circuits_of(self, arc: IntVector) -> tuple[Numbers, Numbers]:
        """Return for the circuit of each class in this policy its ratio and its largest weight in size.

        The sum of floats is rounded once.
        """
        on_circuit = present(far_back(self.graph.tail[arc]), self.graph.size)
        order = on_circuit[np.argsort(self.label[on_circuit], kind="stable")]
        start = first_of_runs(self.label[order])
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

    def _best_circuits(
        self, weight: Numbers, arc: IntVector, before: IntVector
    ) -> tuple[IntVector, Numbers, BoolVector]:
        """Return for each class a node of the policy's best circuit, and its ratio; and which nodes it leads."""
        far = far_back(before)
        on_circuit = present(far, before.size)
        number = np.empty(before.size, dtype=np.int64)
        number[on_circuit] = np.arange(on_circuit.size)
        place = number[before[on_circuit]]
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
        best = order[np.append(first_of_runs(self.label[root[order]])[1:], order.size) - 1]
        chosen = np.zeros(root.size, dtype=np.bool_)
        chosen[best] = True
        return root[best], ratio[best], chosen[circuit][number[far]]

    def _led_to(self, arc: IntVector, led: BoolVector) -> IntVector:
        """Return the policy with the other nodes led, by the fewest arcs, to those that are."""
        n, source = self.graph.size, np.flatnonzero(led)
        heads, start = self._heads_by_tail
        extended = graph_of_rows(
            np.append(start, start[-1] + source.size), np.concatenate([heads, source])
        )  # node n leads to all that are led
        before = breadth_first_order(extended, n, directed=True, return_predecessors=True)[1]
        lost = np.flatnonzero(~led)
        repaired = arc.copy()
        repaired[lost] = np.searchsorted(self._key, lost * n + before[lost])
        return repaired


def far_back(before: IntVector) -> IntVector:
    """Return for each node of a graph with one arc into each the node n arcs back or more, which is on a circuit."""
    far, steps = before, 1
    while steps < before.size:
        far, steps = far[far], 2 * steps
    return far


def present(nodes: IntVector, size: int) -> IntVector:
    """Return the nodes among these, each once and sorted; all are below `size`."""
    found = np.zeros(size, dtype=np.bool_)
    found[nodes] = True
    return np.flatnonzero(found)


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
