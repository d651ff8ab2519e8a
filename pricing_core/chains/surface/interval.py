"""Intervals of floating-point numbers that surely hold the real result of a calculation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """Intervals [low, high], one for each entry of an array, rounded outward by a unit in the last place.

    Examples
    --------
    >>> tenth = Interval.exactly(1.0) * Interval.exactly(0.1)
    >>> bool(tenth.low < 0.1 < tenth.high)
    True
    """

    low: Numbers
    high: Numbers

    @classmethod
    def exactly(cls, value: ArrayLike) -> Interval:
        """Return the interval that holds a number, which is taken as it is."""
        number = np.asarray(value, dtype=np.float64)
        return cls(number, number)

    def __getitem__(self, key: Any) -> Interval:
        """Return some of the entries."""
        return Interval(self.low[key], self.high[key])

    def __neg__(self) -> Interval:
        """Return -a."""
        return Interval(-self.high, -self.low)

    def __add__(self, other: Interval) -> Interval:
        """Return a + b."""
        return _outward(self.low + other.low, self.high + other.high)

    def __sub__(self, other: Interval) -> Interval:
        """Return a - b."""
        return _outward(self.low - other.high, self.high - other.low)

    def __mul__(self, other: Interval) -> Interval:
        """Return a b."""
        ends = (
            self.low * other.low,
            self.low * other.high,
            self.high * other.low,
            self.high * other.high,
        )
        low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
        high = np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
        return _outward(low, high)

    def __truediv__(self, other: Interval) -> Interval:
        """Return a/b, b not holding 0."""
        return self * _outward(1.0 / other.high, 1.0 / other.low)

    def square(self) -> Interval:
        """Return a^2, which is not negative."""
        product = self * self
        return Interval(np.maximum(product.low, 0.0), product.high)


def stacked(parts: list[Interval]) -> Interval:
    """Return intervals side by side along a new last axis."""
    return Interval(np.stack([p.low for p in parts], axis=-1), np.stack([p.high for p in parts], axis=-1))


def joined(parts: list[Interval]) -> Interval:
    """Return intervals one after the other along the first axis."""
    return Interval(np.concatenate([p.low for p in parts]), np.concatenate([p.high for p in parts]))


def _outward(low: Numbers, high: Numbers) -> Interval:
    return Interval(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))
