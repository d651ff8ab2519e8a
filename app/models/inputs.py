"""The inputs f and g of a system in a model file: constants, pieces, sines, piecewise linear signals, exosystems."""

from typing import Any

from app.model_keys import (
    MATRIX,
    NUMBER,
    VECTOR,
    Key,
    array_schema,
    first_that_fits,
    object_schema,
    read_matrix,
    read_object,
    read_vector,
)
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Exosystem, PiecewiseConstant, piecewise_linear, sine

NUMBER_OR_VECTOR = Key(
    first_that_fits([(list, read_vector), (object, NUMBER.read)], ""),
    {"anyOf": [NUMBER.schema, VECTOR.schema]},
)
VECTOR_OR_MATRIX = Key(
    lambda field, value: (
        read_matrix(field, value)
        if isinstance(value, list) and value and isinstance(value[0], list)
        else read_vector(field, value)
    ),
    {"anyOf": [VECTOR.schema, MATRIX.schema]},
)
PIECES = {
    "times": VECTOR.described("increasing", required=True),
    "values": VECTOR_OR_MATRIX.described("values[i] holds up to times[i], the last for ever", required=True),
}
CORNERS = {
    "times": VECTOR.described("increasing", required=True),
    "values": VECTOR_OR_MATRIX.described("one row for each of the times", required=True),
}
WAVE = {
    "amplitude": NUMBER_OR_VECTOR.described("a number, or one for each component", required=True),
    "frequency": NUMBER.described("per unit of time", required=True),
    "phase": NUMBER.described("radians"),
    "offset": NUMBER_OR_VECTOR.described("added to it"),
}
GENERATED = {
    "generator": MATRIX.described("S in w' = S w", required=True),
    "output": MATRIX.described("E: the input is E w", required=True),
    "states": VECTOR_OR_MATRIX.described("w just after each of the times", required=True),
    "times": VECTOR.described("when w starts anew; 0 where missing"),
}
FORMS = 'a list of numbers, {"times", "values"}, {"sine"}, {"piecewise_linear"}, or {"generator", "output", "states"}'


def _read_signal(field: str, value: dict[str, Any]) -> Exosystem | PiecewiseConstant:
    try:
        if "sine" in value:
            return sine(**_only(field, value, "sine", WAVE))
        if "piecewise_linear" in value:
            return piecewise_linear(**_only(field, value, "piecewise_linear", CORNERS))
        if "generator" in value:
            return Exosystem(**read_object(field, value, GENERATED))
        if "values" in value or "times" in value:
            return PiecewiseConstant(**read_object(field, value, PIECES))
    except InvalidInputError as fault:  # the library does not know which input it is
        if fault.field == "key" or fault.field.startswith(field):
            raise
        raise InvalidInputError(f"{field}.{fault.field}", fault.value, fault.allowed) from None
    raise InvalidInputError(field, value, FORMS)


def _only(field: str, value: dict[str, Any], form: str, keys: dict[str, Key]) -> dict[str, Any]:
    """Read the object under the only key of another."""
    read_object(field, value, {form: Key(lambda _, entry: entry, {})})
    return read_object(f"{field}.{form}", value[form], keys)


INPUT = Key(
    first_that_fits([(list, read_vector), (dict, _read_signal)], FORMS),
    {
        "anyOf": [
            array_schema(NUMBER.schema),
            object_schema(PIECES),
            object_schema({"sine": Key(lambda _, value: value, object_schema(WAVE), required=True)}),
            object_schema(
                {"piecewise_linear": Key(lambda _, value: value, object_schema(CORNERS), required=True)}
            ),
            object_schema(GENERATED),
        ]
    },
)
