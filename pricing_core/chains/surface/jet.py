"""A function of x with its first two derivatives, and how they pass through sums, products and compositions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Jet:
    """A function f with f' and f'' at given places: three arrays of one shape, real or complex.

    Examples
    --------
    >>> x = Jet(np.array(3.0), np.array(1.0), np.array(0.0))
    >>> square = x * x
    >>> float(square.value), float(square.first), float(square.second)
    (9.0, 6.0, 2.0)
    """

    value: Any
    first: Any
    second: Any

    def __add__(self, other: Jet) -> Jet:
        """Return f + g."""
        return Jet(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Jet) -> Jet:
        """Return f - g."""
        return self + other.times(-1.0)

    def __mul__(self, other: Jet) -> Jet:
        """Return f g."""
        return Jet(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value + 2.0 * self.first * other.first + self.value * other.second,
        )

    def times(self, factor: Any) -> Jet:
        """Return the product of f and a factor that does not depend on x."""
        return Jet(self.value * factor, self.first * factor, self.second * factor)

    def reciprocal(self) -> Jet:
        """Return 1/f."""
        inverse = 1.0 / self.value
        return self.through(inverse, -(inverse**2), 2.0 * inverse**3)

    def exp(self) -> Jet:
        """Return e^f."""
        power = np.exp(self.value)
        return self.through(power, power, power)

    def log(self) -> Jet:
        """Return ln f."""
        inverse = 1.0 / self.value
        return self.through(np.log(self.value), inverse, -(inverse**2))

    def through(self, value: Any, slope: Any, bend: Any) -> Jet:
        """Return h(f), h given by its value and derivatives at f."""
        return Jet(value, slope * self.first, slope * self.second + bend * self.first**2)
