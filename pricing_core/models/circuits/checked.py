"""The names, nodes and numbers of elements: what is refused, and numbers as Python has them."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.equations import Number

SMALLEST, LARGEST = 1e-30, 1e30  # in ohms, farads, henries, volts, amperes, hertz


def checked_ends(name: str, plus: str, minus: str) -> None:
    """Refuse names and nodes that are no strings, and an element both of whose ends are the same node."""
    checked_words("name", name)
    checked_words(f"nodes of {name}", plus, minus)
    if plus == minus:
        raise InvalidInputError(f"nodes of {name}", plus, "two different nodes")


def checked_words(field: str, *words: object) -> None:
    """Refuse names that are no strings."""
    for word in words:
        if not isinstance(word, str):
            raise InvalidInputError(field, word, 'a string; the ground is "0"')


def checked_number(field: str, value: Number | np.integer[Any] | np.floating[Any]) -> Number:
    """Return a real number of Python's; refuse what is none, and what no circuit is made of.

    Examples
    --------
    >>> checked_number("ohms", np.int64(5)), checked_number("ohms", Fraction(1, 3))
    (5, Fraction(1, 3))
    """
    plain = (
        int(value)
        if isinstance(value, np.integer)
        else float(value)
        if isinstance(value, np.floating)
        else value
    )
    is_number = isinstance(plain, int | float | Fraction) and not isinstance(plain, bool)
    if not (is_number and -LARGEST <= plain <= LARGEST):
        raise InvalidInputError(field, value, f"a finite number of a size up to {LARGEST:g}")
    return plain


def checked_positive(field: str, value: Number) -> Number:
    """Return a positive number of Python's, or refuse."""
    plain = checked_number(field, value)
    if plain < SMALLEST:
        raise InvalidInputError(field, value, f"a positive number of at least {SMALLEST:g}")
    return plain


def checked_nonnegative(field: str, value: Number) -> Number:
    """Return a number of Python's that is zero, or as large as a circuit's numbers are, or refuse."""
    plain = checked_number(field, value)
    if plain < 0 or 0 < plain < SMALLEST:
        raise InvalidInputError(field, value, f"0 or a positive number of at least {SMALLEST:g}")
    return plain


def settle(element: object, name: str, value: object) -> None:
    """Set a field of a frozen value while it is made."""
    object.__setattr__(element, name, value)
