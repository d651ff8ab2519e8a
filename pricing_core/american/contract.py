"""The option contract: what the holder may do and what it pays."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.errors import InvalidInputError

OptionType: TypeAlias = Literal["put", "call"]
Exercise: TypeAlias = Literal["american", "european"]
OPTION_TYPES = ("put", "call")
EXERCISES = ("american", "european")
LARGEST_EXPIRY = 200.0  # years
SMALLEST_MONEY, LARGEST_MONEY = 1e-30, 1e30  # for strike and, unless it is 0, spot


@dataclass(frozen=True, slots=True)
class Option:
    """The right to sell (put) or buy (call) one unit of the underlying for the strike.

    Parameters
    ----------
    option_type : {"put", "call"}
    strike : float
        Money per unit of underlying, 1e-30 to 1e30.
    expiry : float
        Time to expiry in years, 0 to 200.
    exercise : {"american", "european"}

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.

    Examples
    --------
    >>> Option("put", strike=100.0, expiry=1.0).payoff(90.0)
    10.0
    """

    option_type: OptionType
    strike: float
    expiry: float
    exercise: Exercise = "american"

    def __post_init__(self) -> None:
        if self.option_type not in OPTION_TYPES:
            raise InvalidInputError("option_type", self.option_type, '"put" or "call"')
        if self.exercise not in EXERCISES:
            raise InvalidInputError("exercise", self.exercise, '"american" or "european"')
        object.__setattr__(self, "strike", real_number("strike", self.strike, SMALLEST_MONEY, LARGEST_MONEY))
        object.__setattr__(self, "expiry", real_number("expiry", self.expiry, 0.0, LARGEST_EXPIRY))

    @property
    def is_put(self) -> bool:
        """Whether the holder may sell."""
        return self.option_type == "put"

    def payoff(self, spot: float) -> float:
        """Return what exercise brings at `spot`, in money per unit of underlying (11.47)."""
        return max(self.strike - spot if self.is_put else spot - self.strike, 0.0)


def real_number(
    field: str,
    value: object,
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    """Return `value` as a float if it is a finite number with least <= value <= most.

    Raises
    ------
    InvalidInputError
        It is not; the message names `field` and the range.
    """
    allowed = _range_in_words(least, most)
    if isinstance(value, (str, bytes, bool)) or value is None:
        raise InvalidInputError(field, value, allowed)
    if isinstance(value, np.generic) and value.dtype.kind not in "fiu":  # truth values, dates, durations
        raise InvalidInputError(field, value, allowed)
    try:
        number = float(value)  # type: ignore[arg-type]
    except Exception:  # whatever a stranger's __float__ raises, this is no number
        raise InvalidInputError(field, value, allowed) from None
    if not (math.isfinite(number) and least <= number <= most):
        raise InvalidInputError(field, value, allowed)
    return number


def check_kind(field: str, value: object, kind: type, allowed: str) -> None:
    """Raise InvalidInputError where an argument is of another kind."""
    if not isinstance(value, kind):
        raise InvalidInputError(field, value, allowed)


def _range_in_words(least: float, most: float) -> str:
    if math.isfinite(least) and math.isfinite(most):
        return f"a number from {least:g} to {most:g}"
    if math.isfinite(least):
        return f"a finite number >= {least:g}"
    return "a finite number"
