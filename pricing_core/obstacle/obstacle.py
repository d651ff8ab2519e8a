"""What a value may not fall below, or not rise above, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pricing_core.arrays import Matrix, Vector, as_number, as_vector, check_list
from pricing_core.errors import InvalidInputError
from pricing_core.obstacle.event import SHORTEST_TIME
from pricing_core.obstacle.functions import Function, Given, read_function


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A value, with the places where its slope jumps and the times at which it acts.

    Parameters
    ----------
    value : float or callable
        Money: a number, f(x) or f(x, t); x an array of shape (n,), t in years from now.
    kinks : sequence of float or callable
        Places where the slope jumps: numbers or f(t).
    during : (float, float), optional
        A window of time in which it acts.
    at : sequence of float, optional
        Dates on which it acts; with a window, on either. Without both it acts always.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.

    Examples
    --------
    The payoff of a put with strike 1 over x = ln S:

    >>> put = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
    >>> put(np.log([0.75, 2.0]), 0.0)
    array([0.25, 0.  ])
    """

    value: Given
    kinks: Sequence[Given] = ()
    during: tuple[float, float] | None = None
    at: Sequence[float] | None = None
    function: Function = field(init=False, repr=False)
    kink_functions: tuple[Function, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "function", read_function("obstacle", self.value))
        check_list("kinks", self.kinks)
        read = tuple(read_function("kinks", kink, always=("t",)) for kink in self.kinks)
        object.__setattr__(self, "kink_functions", read)
        if self.during is not None:
            check_list("during", self.during)
            if len(self.during) != 2:
                raise InvalidInputError("during", self.during, "a pair (start, end)")
            start, end = (as_number("during", time) for time in self.during)
            if not end - start >= SHORTEST_TIME:
                allowed = f"a pair with start < end, {SHORTEST_TIME:g} apart at least"
                raise InvalidInputError("during", self.during, allowed)
            object.__setattr__(self, "during", (start, end))
        if self.at is not None:
            object.__setattr__(self, "at", tuple(sorted(as_vector("at", self.at).tolist())))

    def __call__(self, x: Vector, t: float) -> Vector:
        """Return the values at x, shape (n,), at the time t."""
        return self.function(x, t)

    def derivatives(self, x: Vector, t: float, width: float) -> Matrix:
        """Return the value, its slope and its curvature at x, by differences over a width, shape (3, n)."""
        places = x + width * np.arange(-1.0, 2.0)[:, None]
        before, at, after = self(places.ravel(), t).reshape(3, -1)
        return np.array([at, (after - before) / (2.0 * width), (before - 2.0 * at + after) / width**2])

    @property
    def is_constant(self) -> bool:
        """Whether neither its value nor its kinks depend on the time."""
        return not (self.function.has_t or any(kink.has_t for kink in self.kink_functions))

    def kinks_at(self, t: float) -> Vector:
        """Return the places of the kinks at the time t in order, shape (k,)."""
        return np.sort([float(kink(np.zeros(1), t)[0]) for kink in self.kink_functions])

    def acts_between(self, start: float, end: float) -> bool:
        """Tell whether it acts all through from `start` to `end`, with none of its `times` inside."""
        if self.during is None:
            return self.at is None
        return self.during[0] <= start and end <= self.during[1]

    def acts_at(self, t: float) -> bool:
        """Tell whether it acts at the time t, its window's two ends included."""
        if self.during is None and self.at is None:
            return True
        in_window = self.during is not None and self.during[0] <= t <= self.during[1]
        return in_window or (self.at is not None and t in self.at)

    @property
    def times(self) -> tuple[float, ...]:
        """The dates, and the ends of the window."""
        return (*(self.during or ()), *(self.at or ()))
