"""The option contract: what the holder may do and what it pays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.errors import InvalidInputError, Told

OptionType: TypeAlias = Literal["put", "call"]
Exercise: TypeAlias = Literal["american", "european", "bermudan"]
OPTION_TYPES = ("put", "call")
EXERCISES = ("american", "european", "bermudan")
LARGEST_EXPIRY = 200.0  # years
MOST_EXERCISE_TIMES = 1000
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
    exercise : {"american", "european", "bermudan"}
        At any time, at expiry only, or at the exercise times and at expiry.
    exercise_times : sequence of float
        Years from now, in (0, expiry], in any order; with "bermudan" only, and at least one.
    exercise_start : float
        Years from now, 0 to expiry: before it an American option may not be exercised.

    At an exercise time that is an ex-time the holder decides before the dividend.

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
    exercise_times: tuple[float, ...] = ()
    exercise_start: float = 0.0

    def __post_init__(self) -> None:
        if self.option_type not in OPTION_TYPES:
            raise InvalidInputError("option_type", self.option_type, '"put" or "call"')
        if self.exercise not in EXERCISES:
            raise InvalidInputError("exercise", self.exercise, '"american", "european" or "bermudan"')
        object.__setattr__(self, "strike", real_number("strike", self.strike, SMALLEST_MONEY, LARGEST_MONEY))
        object.__setattr__(self, "expiry", real_number("expiry", self.expiry, 0.0, LARGEST_EXPIRY))
        if self.exercise == "bermudan" or type(self.exercise_times) is not tuple or self.exercise_times:
            object.__setattr__(self, "exercise_times", self._checked_times())
        if self.exercise_start != 0.0 or not isinstance(self.exercise_start, float):
            object.__setattr__(self, "exercise_start", self._checked_start())

    def _checked_times(self) -> tuple[float, ...]:
        """Return the exercise times in order, each once."""
        times = self.exercise_times
        if not isinstance(times, Sequence | np.ndarray) or isinstance(times, str | bytes):
            raise InvalidInputError("exercise_times", times, "a list of times")
        if self.exercise != "bermudan":
            if len(times) == 0:
                return ()
            raise InvalidInputError("exercise_times", list(times), 'empty unless exercise is "bermudan"')
        if not 1 <= len(times) <= MOST_EXERCISE_TIMES:
            raise InvalidInputError(
                "exercise_times", Told(f"{len(times)} times"), f"1 to {MOST_EXERCISE_TIMES} times"
            )
        read = {real_number("exercise_times", time, 0.0, LARGEST_EXPIRY) for time in times}
        for time in read:
            if not 0.0 < time <= self.expiry:
                raise InvalidInputError(
                    "exercise_times", time, f"above 0 and at most the expiry, {self.expiry:g}"
                )
        return tuple(sorted(read))

    def _checked_start(self) -> float:
        start = real_number("exercise_start", self.exercise_start, 0.0, LARGEST_EXPIRY)
        if start > self.expiry:
            raise InvalidInputError("exercise_start", start, f"at most the expiry, {self.expiry:g}")
        if start > 0.0 and self.exercise != "american":
            raise InvalidInputError("exercise_start", start, '0 unless exercise is "american"')
        return start

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
    allowed = range_in_words(least, most)
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


def range_in_words(least: float, most: float) -> str:
    """Return what a number must be, completing "must be ..."."""
    if math.isfinite(least) and math.isfinite(most):
        return f"a number from {least:g} to {most:g}"
    if math.isfinite(least):
        return f"a finite number >= {least:g}"
    return "a finite number"
