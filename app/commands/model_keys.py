"""The keys of a model file: how each value is read, and what the JSON Schema says of it."""

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, MissingInputError, Told, UnknownNameError

Number: TypeAlias = int | float | Fraction
Reader: TypeAlias = Callable[[str, Any], Any]

EXACT = r"[+-]?(\d{1,300}/\d{1,300}|(\d{1,300}(\.\d{0,300})?|\.\d{1,300})([eE][+-]?\d{1,3})?)"
NUMBER_IN_WORDS = 'a number such as 0.5, or the text of one that is taken exactly, such as "1/3"'
NUMBER_SCHEMA = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": f"^{EXACT}$"}]}


@dataclass(frozen=True, slots=True)
class Key:
    """One key of an object: how its value is read, and its JSON Schema.

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
    unknown = [name for name in value if name not in keys]
    if unknown:
        raise UnknownNameError("key", unknown, keys, field)
    for name, key in keys.items():
        if key.required and name not in value:
            raise MissingInputError(prefix + name, str(key.schema.get("description", "")))
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


def read_text(field: str, value: Any) -> str:
    """Read a text."""
    if not isinstance(value, str):
        raise InvalidInputError(field, value, "a text, in double quotes")
    return value


def whole_number(least: int, most: int | None = None) -> Key:
    """Return the key that takes a whole number from the least to the most."""
    limits = {"minimum": least} | ({} if most is None else {"maximum": most})
    return Key(lambda field, value: as_whole_number(field, value, least, most), {"type": "integer", **limits})


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


def list_of(entry: Key, allowed: str, **limits: int) -> Key:
    """Return the key that takes a list of such entries; the limits of its length are minItems and maxItems."""
    least, most = limits.get("minItems", 0), limits.get("maxItems", sys.maxsize)

    def read(field: str, value: Any) -> list[Any]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise InvalidInputError(field, value, allowed)
        return [entry.read(f"{field}[{i}]", part) for i, part in enumerate(value)]

    return Key(read, array_schema(entry.schema, **limits))


def matrix_of(row: Key, allowed: str) -> Key:
    """Return the key that takes a list of such rows, one or more and equally long."""
    rows = list_of(row, allowed, minItems=1)

    def read(field: str, value: Any) -> list[list[Any]]:
        found: list[list[Any]] = rows.read(field, value)
        for i, length in enumerate(map(len, found)):
            if length != len(found[0]):
                raise InvalidInputError(
                    f"{field}[{i}]", Told(f"{length} numbers"), f"as long as the first row: {len(found[0])}"
                )
        return found

    return Key(read, rows.schema)


def object_of(keys: Mapping[str, Key]) -> Key:
    """Return the key that takes an object of these keys."""
    return Key(lambda field, value: read_object(field, value, keys), object_schema(keys))


def built(make: Callable[..., Any], keys: Mapping[str, Key]) -> Key:
    """Return the key that takes an object of these keys, and makes of it what a function of the library returns."""

    def read(field: str, value: Any) -> Any:
        given = read_object(field, value, keys)
        try:
            return make(**given)
        except InvalidInputError as fault:  # the library does not know where in the file its argument stands
            raise fault.called(f"{field}.{fault.field}") from None

    return Key(read, object_schema(keys))


@contextmanager
def keys_for(arguments: Mapping[str, str]) -> Iterator[None]:
    """Let errors of the library name the keys of the file in the place of these arguments."""
    try:
        yield
    except InvalidInputError as fault:
        raise fault.called(arguments.get(fault.field, fault.field)) from None


def one_of(forms: Mapping[str, Key], allowed: str) -> Key:
    """Return the key that takes an object with exactly one of these keys, and reads as that key does.

    Examples
    --------
    >>> forms = {"power": built(pow, {"base": NUMBER, "exp": INTEGER})}
    >>> one_of(forms, "a power").read("f", {"power": {"base": "1/2", "exp": 2}})
    0.25
    """

    def read(field: str, value: Any) -> Any:
        name = next((name for name in forms if isinstance(value, dict) and name in value), None)
        if name is None:
            raise InvalidInputError(field, value, allowed)
        return read_object(field, value, {name: forms[name]})[name]

    return Key(read, {**object_schema(forms), "minProperties": 1, "maxProperties": 1})


def first_that_fits(alternatives: Sequence[tuple[type, Reader]], allowed: str) -> Reader:
    """Return the reader that goes by the kind of the value: list, dict, ..."""

    def read(field: str, value: Any) -> Any:
        for kind, reader in alternatives:
            if isinstance(value, kind):
                return reader(field, value)
        raise InvalidInputError(field, value, allowed)

    return read


NUMBER = Key(read_float, NUMBER_SCHEMA)
INTEGER = whole_number(1)
TEXT = Key(read_text, {"type": "string"})
VECTOR = list_of(Key(read_number, NUMBER_SCHEMA), "a list of numbers")
MATRIX = matrix_of(VECTOR, "a list of rows, which are lists of numbers")
