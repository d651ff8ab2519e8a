"""A number as tables and command lines write it."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import TypeAlias

from pricing_core.errors import InvalidInputError

Cell: TypeAlias = str | float | int | Decimal

PLAIN_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
PLAIN_NUMBER_IN_WORDS = "a number such as 0.05 or 5e-2"


def read_number(field: str, cell: Cell) -> float:
    """Read one cell as a number; whether it is in range is checked where it is used.

    Raises
    ------
    InvalidInputError
        The cell is not a number in plain decimal or exponent notation.

    Examples
    --------
    >>> read_number("strike", " 1.5e2 ")
    150.0
    >>> read_number("strike", "1_000")
    Traceback (most recent call last):
    ...
    pricing_core.errors.InvalidInputError: strike = '1_000': must be a number such as 0.05 or 5e-2
    """
    if not isinstance(cell, str):
        return float(cell)
    if not PLAIN_NUMBER.fullmatch(cell.strip(" \t")):
        raise InvalidInputError(field, cell, PLAIN_NUMBER_IN_WORDS)
    number = float(cell)
    if math.isinf(number):
        raise InvalidInputError(field, cell, "a finite number")
    return number
