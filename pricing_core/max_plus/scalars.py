"""Single numbers as arguments: times and weights, tolerances."""

from __future__ import annotations

from fractions import Fraction
from math import isfinite

import numpy as np

from pricing_core.errors import InvalidInputError, Told

# Largest size of weights and results: sums of as many as fit into memory stay far from infinity.
LARGEST = 1e150
UNIT = 2.0**-52  # the distance from 1 to the next float
LARGEST_WHOLE = 2**53  # up to here every whole number is a float


def as_number(
    field: str, value: object, *, least: float = -LARGEST, what: str = "number"
) -> float | Fraction:
    """Return a finite number: a Fraction, or a float for anything else.

    Raises
    ------
    InvalidInputError
        It is none, below `least`, beyond 1e150 in size, or a whole number that no float is.
    """
    if isinstance(value, Fraction) and abs(value) <= LARGEST:
        number: float | Fraction = value
    elif isinstance(value, int | np.integer) and not isinstance(value, bool):
        if abs(int(value)) > LARGEST_WHOLE:
            raise InvalidInputError(field, Told("a longer one"), "a whole number up to 2**53, or a Fraction")
        number = float(value)
    elif isinstance(value, float | np.floating) and isfinite(value) and abs(float(value)) <= LARGEST:
        number = float(value)
    else:
        raise InvalidInputError(field, value, _in_words(least, what))
    if number < least:
        raise InvalidInputError(field, value, _in_words(least, what))
    return number


def as_tolerance(field: str, value: object) -> float | None:
    """Return a finite number >= 0, or None.

    Raises
    ------
    InvalidInputError
        It is something else.
    """
    return None if value is None else float(as_number(field, value, least=0.0))


def _in_words(least: float, what: str) -> str:
    return f"a finite {what}" + (f" >= {least:g}" if least > -LARGEST else f" up to {LARGEST:g} in size")
