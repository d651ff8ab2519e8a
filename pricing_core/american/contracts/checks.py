"""Checks of single arguments, whose messages say what is allowed."""

from __future__ import annotations

import math

import numpy as np

from pricing_core.errors import InvalidInputError


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
    if type(value) is float and least <= value <= most and not math.isinf(value):
        return value
    number = _as_float(value)
    if number is None or not (math.isfinite(number) and least <= number <= most):
        raise InvalidInputError(field, value, range_in_words(least, most))
    return number


def _as_float(value: object) -> float | None:
    """Return a number as a float; None for what is no number, whatever it makes of itself."""
    if isinstance(value, (str, bytes, bool)) or value is None:
        return None
    if isinstance(value, np.generic) and value.dtype.kind not in "fiu":  # truth values, dates, durations
        return None
    try:
        return float(value)  # type: ignore[arg-type]
    except Exception:  # whatever a stranger's __float__ raises, this is no number
        return None


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
