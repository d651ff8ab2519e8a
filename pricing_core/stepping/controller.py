"""Step-size controllers: from the error of the last steps to the size of the next.

Source: Hairer and Wanner, Solving ODEs II, IV.2; the PI exponents are Gustafsson's, (0.7, 0.4)/(p + 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_extended_number, as_number, as_real_array
from pricing_core.errors import InvalidInputError, NumericalError

SAFETY = 0.9
LARGEST_GROWTH = 4.0
LARGEST_CUT = 0.1
# A smaller error of the step before counts for this: it says no more (Hairer, Norsett, Wanner, Solving ODEs I, II.4).
LEAST_PREVIOUS = 1e-4
PI_INTEGRAL, PI_PROPORTIONAL = 0.7, 0.4


@dataclass(frozen=True, slots=True)
class Decision:
    """Whether a step is kept, and how long the next one is.

    Parameters
    ----------
    accept : bool
    next_h : float
        Size of the next step.
    scaled_error : float
        Estimated error over the largest one allowed, so that 1 is the limit.
    """

    accept: bool
    next_h: float
    scaled_error: float


class StepSizeController(Protocol):
    """A rule that accepts or rejects steps and chooses their sizes."""

    def first_h(self, span: float) -> float:
        """Return the first step for an interval of length `span`."""
        ...

    def decide(self, value: Vector, error: Vector | None, h: float, order: int, previous: float) -> Decision:
        """Accept or reject a step of size h, and choose the next.

        Parameters
        ----------
        value : Vector
            The state at the end of the step.
        error : Vector or None
            The estimated error of each component; None where the method has no estimate.
        h : float
            Size of the step.
        order : int
            Order of the method.
        previous : float
            Scaled error of the last step that was accepted.
        """
        ...


@dataclass(frozen=True, slots=True)
class FixedStep:
    """Steps of a constant size h; with h = inf the stop times alone are the steps."""

    h: float = math.inf

    def __post_init__(self) -> None:
        h = as_extended_number("h", self.h)
        if not h > 0:
            raise InvalidInputError("h", self.h, "a number > 0")
        object.__setattr__(self, "h", h)

    def first_h(self, span: float) -> float:
        """Return h, whatever the length `span` of the interval."""
        return self.h

    def decide(self, value: Vector, error: Vector | None, h: float, order: int, previous: float) -> Decision:
        """Accept every step; `value`, `error`, `h`, `order` and `previous` play no part."""
        return Decision(True, self.h, 0.0)


@dataclass(frozen=True, slots=True)
class IController:
    """The elementary controller: h_next = h * safety * error**(-1/(p + 1)).

    The error is scaled by atol + rtol |value|, in the largest component.

    Parameters
    ----------
    rtol, atol : float or Vector
        Relative and absolute tolerance per step.
    start : float
        First step as a fraction of the interval.
    """

    rtol: float = 1e-4
    atol: ArrayLike = 1e-7
    start: float = 1e-4

    def __post_init__(self) -> None:
        rtol, start = as_number("rtol", self.rtol), as_number("start", self.start)
        atol = as_real_array("atol", self.atol)
        if not rtol >= 0:
            raise InvalidInputError("rtol", self.rtol, "a finite number >= 0")
        if not np.all(atol > 0):
            raise InvalidInputError("atol", self.atol, "> 0")
        if not 0 < start <= 1:
            raise InvalidInputError("start", self.start, "a fraction of the interval, > 0 and <= 1")
        for name, value in (("rtol", rtol), ("atol", atol), ("start", start)):
            object.__setattr__(self, name, value)

    def first_h(self, span: float) -> float:
        """Return the first step for an interval of length `span`."""
        return self.start * span

    def decide(self, value: Vector, error: Vector | None, h: float, order: int, previous: float) -> Decision:
        """Accept a step of size h where its scaled error is at most 1, and choose the next.

        The arguments `value`, `error`, `h`, `order` and `previous` are those of `StepSizeController.decide`.
        """
        scaled = scaled_error(value, error, self.rtol, self.atol)
        growth = self._growth(scaled, previous) if scaled else math.inf
        return Decision(scaled <= 1.0, h * limited(growth ** (1.0 / (order + 1))), scaled)

    def _growth(self, scaled: float, previous: float) -> float:
        """Return (next_h / h)**(p + 1), before the safety factor."""
        return 1.0 / scaled


@dataclass(frozen=True, slots=True)
class PIController(IController):
    """The proportional-integral controller: smoother step sizes, fewer rejections.

    h_next = h * safety * error**(-0.7/(p + 1)) * previous_error**(0.4/(p + 1)); after a rejection as
    `IController`.
    """

    def _growth(self, scaled: float, previous: float) -> float:
        if scaled > 1.0 or previous == 0.0:
            return 1.0 / scaled
        before = max(previous, LEAST_PREVIOUS)
        return math.pow(scaled, -PI_INTEGRAL) * math.pow(before, PI_PROPORTIONAL)


def scaled_error(value: Vector, error: Vector | None, rtol: float, atol: ArrayLike) -> float:
    """Return max |error| / (atol + rtol |value|).

    Raises
    ------
    NumericalError
        The method gives no error estimate: wrap it in `StepDoubling`.
    """
    if error is None:
        raise NumericalError(
            "an adaptive controller needs an error estimate: wrap the method in StepDoubling"
        )
    if error.size == 0:
        return 0.0
    scaled = float(np.max(np.abs(error) / (np.asarray(atol) + rtol * np.abs(value))))
    return scaled if math.isfinite(scaled) else 1e30  # an overflowing step is rejected, not accepted


def limited(factor: float) -> float:
    """Return the growth factor with the safety factor applied, between a tenth and four."""
    return min(LARGEST_GROWTH, max(LARGEST_CUT, SAFETY * factor))
