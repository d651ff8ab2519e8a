"""What an event does to the option's value as a function of the spot: V(s, t-) = max(g(s), V(s (1 - f) - d, t+)).

The value after the event is known at nodes; between them it is a cubic on each cell with fourth-order slopes, limited
so that it is monotone where the values are (Hyman 1983). Kinks are kept apart: a function with the kink
jump (s - k)^+ enters a grid as its projection on hat functions, which differs from the function's own values at the
two nodes next to k only. The error of a smooth functional of the values is then regular, O(h**2), wherever k lies
between them (Pooley, Vetzal, Forsyth 2003).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.roots import find_root

STENCIL = 5  # Number of nodes whose quartic gives a slope.
SMALLEST_GAIN = 1e-13  # Smallest gain of exercise that is more than rounding, in strikes; measured.
STEEPEST = 3.0  # Largest slope over the smaller neighbouring chord with which a cubic is monotone; derived.


@dataclass(frozen=True, slots=True)
class Kink:
    """A place where the slope jumps, in units of the strike."""

    place: float
    jump: float


class ValueFunction(Protocol):
    """A function of s = S/K >= 0."""

    @property
    def kinks(self) -> tuple[Kink, ...]:
        """The kinks, where the function is not smooth."""
        ...

    def value(self, s: Vector) -> Vector:
        """Return the values of the function at s."""
        ...

    def slope(self, s: Vector) -> Vector:
        """Return the derivatives of the function at s."""
        ...


@dataclass(frozen=True, slots=True)
class Payoff:
    """The payoff max(sign (1 - s), 0), sign 1 for a put and -1 for a call (11.47)."""

    sign: float

    @property
    def kinks(self) -> tuple[Kink, ...]:
        """The kink at the strike."""
        return (Kink(1.0, 1.0),)

    def value(self, s: Vector) -> Vector:
        """Return the payoff."""
        return np.maximum(self.sign * (1.0 - s), 0.0)

    def slope(self, s: Vector) -> Vector:
        """Return the derivative of the payoff at s."""
        return np.where(self.sign * (1.0 - s) > 0.0, -self.sign, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SlopeWeights:
    """Weights of the derivative of the quartic through five neighbouring nodes, at each node."""

    windows: NDArray[np.intp]  # (n, 5)
    weights: Matrix  # (n, 5)

    @classmethod
    def of(cls, nodes: Vector) -> SlopeWeights:
        """Return the weights on `nodes`, shape (n,), n >= 5."""
        n = nodes.size
        start = np.clip(np.arange(n) - STENCIL // 2, 0, n - STENCIL)
        windows = start[:, None] + np.arange(STENCIL)
        x, own = nodes[windows], np.arange(n) - start
        center = nodes[:, None]
        weights = np.zeros((n, STENCIL))
        for j in range(STENCIL):
            others = [k for k in range(STENCIL) if k != j]
            factor = np.where(np.arange(STENCIL) == own[:, None], 1.0, center - x)[:, others].prod(axis=1)
            weights[:, j] = factor / (x[:, [j]] - x[:, others]).prod(axis=1)
        weights[np.arange(n), own] = 0.0
        weights[np.arange(n), own] = -weights.sum(axis=1)
        return cls(windows, weights)

    def slopes(self, values: Vector) -> Vector:
        """Return the derivatives of values given at the nodes."""
        result: Vector = (self.weights * values[self.windows]).sum(axis=1)
        return result


@dataclass(frozen=True, slots=True, eq=False)
class GridFunction:
    """Monotone piecewise cubic through values at nodes; linear from 0 to the first node and beyond the last."""

    nodes: Vector  # (n,)
    values: Vector  # (n,)
    slopes: Vector  # (n,)
    at_zero: float

    @classmethod
    def through(cls, nodes: Vector, values: Vector, at_zero: float, weights: SlopeWeights) -> GridFunction:
        """Return the function through the values."""
        chords = np.diff(values) / np.diff(nodes)
        slopes = weights.slopes(values)
        before, after = np.append(chords[0], chords), np.append(chords, chords[-1])
        limit = STEEPEST * np.minimum(np.abs(before), np.abs(after))
        monotone = before * after > 0.0
        limited = np.clip(slopes, -limit, limit)
        limited[monotone & (slopes * after < 0.0)] = 0.0
        return cls(nodes, values, np.where(monotone, limited, 0.0), at_zero)

    @property
    def kinks(self) -> tuple[Kink, ...]:
        """No kinks: the function is smooth between its nodes."""
        return ()

    def value(self, s: Vector) -> Vector:
        """Return the values of the function at s."""
        cell, h, u = self._place(s)
        a, b = self.values[cell], self.values[cell + 1]
        da, db = h * self.slopes[cell], h * self.slopes[cell + 1]
        # With the chord taken out first, a straight line is met to rounding.
        bend = u * (1.0 - u) * ((1.0 - u) * (da - (b - a)) - u * (db - (b - a)))
        inside: Vector = a + u * (b - a) + bend
        inside = np.where(
            s > self.nodes[-1], self.values[-1] + (s - self.nodes[-1]) * self._last_chord(), inside
        )
        return np.where(s < self.nodes[0], self.at_zero + s * self._first_chord(), inside)

    def slope(self, s: Vector) -> Vector:
        """Return the derivatives of the function at s."""
        cell, h, u = self._place(s)
        chord = (self.values[cell + 1] - self.values[cell]) / h
        da, db = self.slopes[cell] - chord, self.slopes[cell + 1] - chord
        inside: Vector = chord + (1.0 - u) * (1.0 - 3.0 * u) * da - u * (2.0 - 3.0 * u) * db
        inside = np.where(s > self.nodes[-1], self._last_chord(), inside)
        return np.where(s < self.nodes[0], self._first_chord(), inside)

    def _place(self, s: Vector) -> tuple[NDArray[np.intp], Vector, Vector]:
        cell = np.clip(np.searchsorted(self.nodes, s, side="right") - 1, 0, self.nodes.size - 2)
        h = self.nodes[cell + 1] - self.nodes[cell]
        return cell, h, np.clip((s - self.nodes[cell]) / h, 0.0, 1.0)

    def _first_chord(self) -> float:
        return float((self.values[0] - self.at_zero) / self.nodes[0]) if self.nodes[0] > 0.0 else 0.0

    def _last_chord(self) -> float:
        return float((self.values[-1] - self.values[-2]) / (self.nodes[-1] - self.nodes[-2]))


@dataclass(frozen=True, slots=True)
class Dropped:
    """The value before dividends: s -> after(max(s (1 - fraction) - amount, 0))."""

    after: ValueFunction
    fraction: float
    amount: float

    @property
    def kinks(self) -> tuple[Kink, ...]:
        """Those of the value after, and the spot that the amount takes to zero."""
        kept = 1.0 - self.fraction
        if kept <= 0.0:
            return ()
        moved = tuple(Kink((k.place + self.amount) / kept, k.jump * kept) for k in self.after.kinks)
        if self.amount == 0.0:
            return moved
        slope = float(self.after.slope(np.zeros(1))[0])
        return (*moved, Kink(self.amount / kept, slope * kept))

    def value(self, s: Vector) -> Vector:
        """Return the values before the dividends at s."""
        return self.after.value(np.maximum(s * (1.0 - self.fraction) - self.amount, 0.0))

    def slope(self, s: Vector) -> Vector:
        """Return the derivatives of the value before the dividends at s."""
        kept = 1.0 - self.fraction
        ex = s * kept - self.amount
        return np.where(ex > 0.0, kept * self.after.slope(np.maximum(ex, 0.0)), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class EventValue:
    """The value just before an event at the nodes, and where the holder exercises there, in units of the strike."""

    values: Vector  # (n,)
    at_zero: float
    region: ExerciseRegion
    exercised: BoolVector  # (n,)
    crossings: tuple[float, ...]  # where exercise gains nothing
    exercised_at_zero: bool


def before_event(
    after: ValueFunction, at_zero: float, segment: Segment, sign: float, strike: float, nodes: Vector
) -> EventValue:
    """Return the value just before the event at the end of `segment`.

    Parameters
    ----------
    after : ValueFunction
        The value just after it; `at_zero` is its exact value at s = 0.
    sign : float
        1 for a put, -1 for a call.
    """
    held = dropped(after, segment, strike)
    values, kinks = held.value(nodes), list(held.kinks)
    if not segment.exercise_at_end:
        nowhere = np.zeros(nodes.size, dtype=bool)
        return EventValue(values + _projection(nodes, kinks), at_zero, EMPTY_REGION, nowhere, (), False)
    escrow = segment.escrow / strike

    def gain(s: float) -> float:
        return sign * (1.0 - escrow - s) - float(held.value(np.array([s]))[0])

    payoff = sign * (1.0 - escrow - nodes)
    exercised = payoff - values > SMALLEST_GAIN
    crossings = [_root(gain, nodes[i], nodes[i + 1]) for i in np.flatnonzero(exercised[1:] != exercised[:-1])]
    kinks = [kink for kink in kinks if gain(kink.place) <= SMALLEST_GAIN]
    kinks += [Kink(s, abs(-sign - float(held.slope(np.array([s]))[0]))) for s in crossings]
    values = np.maximum(np.maximum(values, payoff) + _projection(nodes, kinks), payoff)
    region = _region(nodes, exercised, crossings)
    earned = sign * (1.0 - escrow)
    return EventValue(values, max(at_zero, earned), region, exercised, tuple(crossings), earned > at_zero)


def dropped(after: ValueFunction, segment: Segment, strike: float) -> ValueFunction:
    """Return the value before the dividends at the end of `segment`, from that after them."""
    if segment.fraction > 0.0 or segment.amount > 0.0:
        return Dropped(after, segment.fraction, segment.amount / strike)
    return after


def _root(gain: Callable[[float], float], a: float, b: float) -> float:
    """Return where exercise gains nothing, between two nodes of which one gains and one does not."""
    ends = gain(a), gain(b)
    if ends[0] * ends[1] >= 0.0:
        return a if abs(ends[0]) < abs(ends[1]) else b
    return find_root(gain, a, b)


def _region(nodes: Vector, exercised: BoolVector, crossings: list[float]) -> ExerciseRegion:
    if not exercised.any():
        return EMPTY_REGION
    lower = -math.inf if exercised[0] else crossings[0]
    return ExerciseRegion(lower, math.inf if exercised[-1] else crossings[-1])


def _projection(nodes: Vector, kinks: list[Kink]) -> Vector:
    """Return what projecting the kinks on hat functions adds to their values at the nodes."""
    added = np.zeros(nodes.size)
    for kink in kinks:
        if not nodes[1] < kink.place < nodes[-2]:
            continue
        i = int(np.searchsorted(nodes, kink.place, side="right")) - 1
        h = nodes[i + 1] - nodes[i]
        right = (kink.place - nodes[i]) / h
        for node, near in ((i, 1.0 - right), (i + 1, right)):
            weight = 0.5 * (nodes[node + 1] - nodes[node - 1])
            added[node] += kink.jump * h**2 * near**3 / (6.0 * weight)
    return added
