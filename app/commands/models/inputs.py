"""The inputs f and g of a system in a model file: constants, pieces, sines, piecewise linear signals, exosystems."""

from typing import Any

from app.commands.model_keys import MATRIX, NUMBER, VECTOR, Key, built, first_that_fits, one_of
from pricing_core.lcs import Exosystem, PiecewiseConstant, piecewise_linear, sine

NUMBER_OR_VECTOR = Key(
    first_that_fits([(list, VECTOR.read), (object, NUMBER.read)], ""),
    {"anyOf": [NUMBER.schema, VECTOR.schema]},
)
VECTOR_OR_MATRIX = Key(
    lambda field, value: (
        MATRIX.read(field, value)
        if isinstance(value, list) and value and isinstance(value[0], list)
        else VECTOR.read(field, value)
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
NAMED = one_of({"sine": built(sine, WAVE), "piecewise_linear": built(piecewise_linear, CORNERS)}, FORMS)
PIECEWISE = built(PiecewiseConstant, PIECES)
EXOSYSTEM = built(Exosystem, GENERATED)
BY_KEY = {
    "sine": NAMED,
    "piecewise_linear": NAMED,
    "generator": EXOSYSTEM,
    "times": PIECEWISE,
    "values": PIECEWISE,
}


def _read_signal(field: str, value: dict[str, Any]) -> Exosystem | PiecewiseConstant:
    form = next((form for key, form in BY_KEY.items() if key in value), NAMED)
    signal: Exosystem | PiecewiseConstant = form.read(field, value)
    return signal


INPUT = Key(
    first_that_fits([(list, VECTOR.read), (dict, _read_signal)], FORMS),
    {"anyOf": [key.schema for key in (VECTOR, PIECEWISE, NAMED, EXOSYSTEM)]},
)
