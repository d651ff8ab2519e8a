"""JSON as tables, command lines and requests write it, read strictly: RFC 8259 and nothing beyond."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from decimal import Decimal
from fractions import Fraction
from numbers import Real
from typing import Any

import numpy as np

from pricing_core.american.contracts.field import Field
from pricing_core.errors import InvalidInputError, shown


class JSONTextError(ValueError):
    """The text is not JSON; the message completes "it ...", and repeats no more of it than a key."""


class DuplicateKeyError(JSONTextError):
    """An object has a key twice, which the message names."""


def parse_json(text: str) -> Any:
    """Parse one JSON value with distinct keys, finite number literals and well-formed Unicode.

    Raises
    ------
    JSONTextError
        Anything else, however deep or long.

    Examples
    --------
    >>> parse_json('[{"time": 0.25, "amount": 1.0}]')
    [{'time': 0.25, 'amount': 1.0}]
    """
    try:
        value = DECODER.decode(text)
        if "\\u" in text:
            json.dumps(value, ensure_ascii=False).encode("utf-8")  # fails on half of a surrogate pair
    except JSONTextError:
        raise
    except UnicodeError:
        raise JSONTextError("is not well-formed UTF-8 text, escapes included") from None
    except json.JSONDecodeError as error:
        fault = f"is not JSON from character {error.pos} on" if text.strip() else "is empty"
        raise JSONTextError(fault) from None
    except RecursionError:
        raise JSONTextError("is nested too deeply") from None
    except ValueError:  # an integer literal beyond the interpreter's limit of digits
        raise JSONTextError("holds a number with too many digits") from None
    return value


def parse_cell(field: str, text: str, allowed: str) -> Any:
    """Parse the JSON in a cell.

    Parameters
    ----------
    allowed : str
        What the field takes, completing "must be ...".

    Raises
    ------
    InvalidInputError
        The text is not JSON.

    Examples
    --------
    >>> parse_cell("rate", "{0.5", "a curve")
    Traceback (most recent call last):
    ...
    pricing_core.errors.InvalidInputError: rate = '{0.5': must be a curve; it is not JSON from character 1 on
    """
    try:
        return parse_json(text)
    except JSONTextError as fault:
        raise InvalidInputError(field, text, f"{allowed}; it {fault}") from None


def from_text(field: Field, value: Any) -> Any:
    """Return the list or the curve that a text is the JSON of; what is no text as it is.

    Raises
    ------
    InvalidInputError
        The text is not JSON; the message names the field.
    """
    return parse_cell(field.name, value, field.allowed) if isinstance(value, str) else value


def cell_text(cell: Any) -> str | None:
    """Return the text that stands for a cell of a table: JSON for lists, curves and surfaces; None for nothing.

    Examples
    --------
    >>> cell_text([(0.25, 1.0)]), cell_text({"times": [1.0], "values": (0.2,)}), cell_text("put"), cell_text(0.5)
    ('[[0.25, 1.0]]', '{"times": [1.0], "values": [0.2]}', 'put', '0.5')
    """
    if cell is None or isinstance(cell, str):
        return cell
    if isinstance(cell, Mapping | list | tuple | np.ndarray) or is_dataclass(cell):
        return json.dumps(cell, default=plain_json)
    return repr(float(cell)) if isinstance(cell, Fraction | np.number) else str(cell)


def plain_json(value: Any) -> Any:
    """Return in a form that JSON can hold what it cannot: dataclasses, numbers and arrays of NumPy, dates, decimals."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, np.ndarray) or (isinstance(value, np.generic) and value.dtype.kind != "M"):
        return value.tolist()
    return float(value) if isinstance(value, Real | Decimal) else str(value)


def _refuse_constant(_: str) -> float:
    raise JSONTextError("holds NaN or Infinity, which are not JSON numbers")


def _distinct_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    distinct = dict(pairs)
    if len(distinct) < len(pairs):
        (twice, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        raise DuplicateKeyError(f"holds the key {shown(twice)} twice")
    return distinct


def _float(digits: str) -> float:
    return float(digits)


def _integer(digits: str) -> int:
    return int(digits)


# Raises a ValueError or RecursionError; half of a surrogate pair passes. Numbers are read by functions in Python so
# that other threads get the interpreter between two of them, and need not wait for the end of the text.
DECODER = json.JSONDecoder(
    parse_float=_float,
    parse_int=_integer,
    parse_constant=_refuse_constant,
    object_pairs_hook=_distinct_object,
)
