"""JSON as tables, command lines and requests write it, read strictly: RFC 8259 and nothing beyond."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

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
        raise JSONTextError(f"is not JSON from character {error.pos} on") from None
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
