"""A JSON object from bytes, refusing what Python's parser lets pass and RFC 8259 does not promise."""

from typing import Any

from pricing_core.american.contracts.json_text import DuplicateKeyError, JSONTextError, parse_json


class InvalidJsonError(ValueError):
    """The body is not one JSON object; the message repeats nothing of it."""


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
    app.service.strict_json.InvalidJsonError: the body holds NaN or Infinity, which are not JSON numbers
    """
    try:
        value = parse_json(raw.decode("utf-8"))
    except DuplicateKeyError:
        raise InvalidJsonError("the body holds an object with a key twice") from None
    except JSONTextError as fault:
        raise InvalidJsonError(f"the body {fault}") from None
    except UnicodeError:
        raise InvalidJsonError("the body is not UTF-8 text") from None
    if not isinstance(value, dict):
        raise InvalidJsonError("the body must be one JSON object")
    return value
