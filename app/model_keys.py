"""The keys of a model file: how each value is read, and what the JSON Schema says of it."""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

from pricing_core.errors import InvalidInputError, Told

Number: TypeAlias = int | float | Fraction
Reader: TypeAlias = Callable[[str, Any], Any]

EXACT = r"[+-]?(\d{1,300}/\d{1,300}|(\d{1,300}(\.\d{0,300})?|\.\d{1,300})([eE][+-]?\d{1,3})?)"
NUMBER_IN_WORDS = 'a number such as 0.5, or the text of one that is taken exactly, such as "1/3"'
NUMBER_SCHEMA = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": f"^{EXACT}$"}]}


@dataclass(frozen=True, slots=True)
class Key:
    """What one key of an object takes.

    Parameters
    ----------
    read : function of (field, value)
        Returns the value as the library takes it, or raises InvalidInputError naming the field.
    schema : mapping
        Its JSON Schema.
    required : bool
    """

    read: Reader
    schema: Mapping[str, Any]
    required: bool = False

    def described(self, text: str, *, required: bool = False) -> "Key":
        """Return the key with a description."""
        return Key(self.read, {"description": text, **self.schema}, required)


def read_object(field: str, value: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
    """Read an object of known keys; `field` is its own name, empty for the file itself.

    Raises
    ------
    InvalidInputError
        It is no object, a key is unknown or missing, or a value is not what the key takes.

    Examples
    --------
    >>> read_object("f", {"times": [1, "3/2"]}, {"times": VECTOR})
    {'times': [1, Fraction(3, 2)]}
    """
    if not isinstance(value, dict):
        raise InvalidInputError(field, value, "an object with the keys " + ", ".join(keys))
    prefix = f"{field}." if field else ""
    for name in value:
        if name not in keys:
            raise InvalidInputError("key", prefix + name, "one of " + ", ".join(keys))
    for name, key in keys.items():
        if key.required and name not in value:
            raise InvalidInputError(
                prefix + name, Told("missing"), str(key.schema.get("description", "given"))
            )
    return {name: keys[name].read(prefix + name, entry) for name, entry in value.items()}


def object_schema(keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return the JSON Schema of such an object."""
    return {
        "type": "object",
        "properties": {name: dict(key.schema) for name, key in keys.items()},
        "required": [name for name, key in keys.items() if key.required],
        "additionalProperties": False,
    }


def read_number(field: str, value: Any) -> Number:
    """Read a number: integers and texts exactly, others as they round.

    Examples
    --------
    >>> read_number("h", "1/3"), read_number("h", "0.1"), read_number("h", 0.1)
    (Fraction(1, 3), Fraction(1, 10), 0.1)
    """
    number: Number | None = None
    if isinstance(value, str) and re.fullmatch(EXACT, value, re.ASCII):
        with suppress(ZeroDivisionError):
            number = Fraction(value)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = value
    if number is None:
        raise InvalidInputError(field, value, NUMBER_IN_WORDS)
    try:
        float(number)
    except OverflowError:
        raise InvalidInputError(field, value, "of a size that floating-point numbers reach") from None
    return number


def read_float(field: str, value: Any) -> float:
    """Read a number, rounded."""
    return float(read_number(field, value))


def read_vector(field: str, value: Any) -> list[Number]:
    """Read a list of numbers."""
    if not isinstance(value, list):
        raise InvalidInputError(field, value, "a list of numbers")
    return [read_number(f"{field}[{i}]", entry) for i, entry in enumerate(value)]


def read_matrix(field: str, value: Any) -> list[list[Number]]:
    """Read a list of rows, which are equally long lists of numbers."""
    if not isinstance(value, list) or not value:
        raise InvalidInputError(field, value, "a list of rows, which are lists of numbers")
    rows = [read_vector(f"{field}[{i}]", row) for i, row in enumerate(value)]
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise InvalidInputError(
                f"{field}[{i}]", Told(f"{len(row)} numbers"), f"as long as the first row: {len(rows[0])}"
            )
    return rows


def read_integer(field: str, value: Any) -> int:
    """Read a whole number above 0."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise InvalidInputError(field, value, "a whole number >= 1")
    return value


def choice(*allowed: str) -> Key:
    """Return the key that takes one of these texts."""

    def read(field: str, value: Any) -> str:
        if not isinstance(value, str) or value not in allowed:
            raise InvalidInputError(field, value, "one of " + ", ".join(f'"{name}"' for name in allowed))
        return value

    return Key(read, {"enum": list(allowed)})


def array_schema(entries: Mapping[str, Any], **limits: int) -> dict[str, Any]:
    """Return the JSON Schema of a list."""
    return {"type": "array", "items": dict(entries), **limits}


def first_that_fits(alternatives: Sequence[tuple[type, Reader]], allowed: str) -> Reader:
    """Return the reader that goes by the kind of the value: list, dict, ..."""

    def read(field: str, value: Any) -> Any:
        for kind, reader in alternatives:
            if isinstance(value, kind):
                return reader(field, value)
        raise InvalidInputError(field, value, allowed)

    return read


NUMBER = Key(read_float, NUMBER_SCHEMA)
INTEGER = Key(read_integer, {"type": "integer", "minimum": 1})
VECTOR = Key(read_vector, array_schema(NUMBER_SCHEMA))
MATRIX = Key(read_matrix, array_schema(array_schema(NUMBER_SCHEMA), minItems=1))
