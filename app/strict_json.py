"""A JSON object from bytes, refusing what Python's parser lets pass and RFC 8259 does not promise."""

import json
from typing import Any


class InvalidJsonError(ValueError):
    """The body is not one JSON object; the message does not repeat any of it."""


def parse_object(raw: bytes) -> dict[str, Any]:
    """Parse one JSON object with distinct keys, finite number literals and well-formed Unicode.

    Raises
    ------
    InvalidJsonError
        Anything else, however deep or long.

    Examples
    --------
    >>> parse_object(b'{"spot": 100}')
    {'spot': 100}
    >>> parse_object(b'{"spot": NaN}')
    Traceback (most recent call last):
    ...
    app.strict_json.InvalidJsonError: NaN and Infinity are not JSON numbers
    """
    try:
        value = json.loads(
            raw.decode("utf-8"), parse_constant=_refuse_constant, object_pairs_hook=_distinct_object
        )
        json.dumps(value, ensure_ascii=False).encode("utf-8")  # fails on half of a surrogate pair
    except InvalidJsonError:
        raise
    except UnicodeError:
        raise InvalidJsonError("the body must be well-formed UTF-8 text, escapes included") from None
    except json.JSONDecodeError as error:
        raise InvalidJsonError(f"the body is not JSON from character {error.pos} on") from None
    except RecursionError:
        raise InvalidJsonError("the body is nested too deeply") from None
    except ValueError:  # an integer literal beyond the interpreter's limit of digits
        raise InvalidJsonError("the body holds a number with too many digits") from None
    if not isinstance(value, dict):
        raise InvalidJsonError("the body must be one JSON object")
    return value


def _refuse_constant(_: str) -> float:
    raise InvalidJsonError("NaN and Infinity are not JSON numbers")


def _distinct_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    distinct = dict(pairs)
    if len(distinct) < len(pairs):
        raise InvalidJsonError("the body holds a key twice")
    return distinct
