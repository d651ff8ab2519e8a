"""A JSON object from bytes, refusing what Python's parser lets pass and RFC 8259 does not promise."""

from typing import Any

from app.service.decoded_size import bytes_of_json
from pricing_core.american.contracts.json_text import DuplicateKeyError, JSONTextError, parse_json


class InvalidJsonError(ValueError):
    """The body is not one JSON object; the message repeats nothing of it."""


LARGEST_OBJECT = (
    1 << 24
)  # bytes that the values of one contract may take; chosen: a hundred times those of any


def parse_object(raw: bytes | bytearray, most_bytes: int | None = LARGEST_OBJECT) -> dict[str, Any]:
    """Parse one JSON object with distinct keys, finite number literals and well-formed Unicode.

    Parameters
    ----------
    most_bytes : int or None
        Memory that its values may take, by `bytes_of_json`; None where the caller has counted it.

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
    if most_bytes is not None and bytes_of_json(raw) > most_bytes:
        raise InvalidJsonError("the body holds more values than are read as one object")
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
