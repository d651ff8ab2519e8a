"""The model "piecewise-linear": x' = Ax + Bu, y = Cx + Du, (y_i, u_i) on the graph of characteristic i (11.34)."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from app.model_keys import NUMBER_SCHEMA, VECTOR, Key, array_schema, read_number
from app.models.method import METHOD, method_in
from app.models.plant import PLANT
from app.models.times import SPAN_AND_TIMES, times_in
from app.simulation import Simulation, of_model
from pricing_core.errors import InvalidInputError
from pricing_core.models import Characteristic, PiecewiseLinearSystem
from pricing_core.models.characteristic_file import NAMED, characteristic_from_json

NUMBERS = array_schema(NUMBER_SCHEMA)
SLOPE = {"anyOf": [NUMBER_SCHEMA, {"enum": ["inf", "-inf"]}]}
POINTS = {
    "type": "object",
    "properties": {
        "points": {
            "type": "array",
            "items": array_schema(NUMBER_SCHEMA, minItems=2, maxItems=2),
            "minItems": 1,
        },
        "left_slope": {**SLOPE, "description": "0 where missing"},
        "right_slope": {**SLOPE, "description": "0 where missing"},
    },
    "required": ["points"],
    "additionalProperties": False,
}
BY_NAME = {
    "type": "object",
    "description": "one name, with its arguments",
    "properties": {
        name: {"type": "object", "additionalProperties": {"anyOf": [NUMBER_SCHEMA, NUMBERS]}}
        for name in NAMED
    },
    "minProperties": 1,
    "maxProperties": 1,
    "additionalProperties": False,
}


def _read_characteristics(field: str, value: Any) -> list[Characteristic]:
    if not isinstance(value, list):
        raise InvalidInputError(field, value, "a list with one characteristic for each input")
    return [characteristic_from_json(f"{field}[{i}]", _with_numbers(entry)) for i, entry in enumerate(value)]


def _with_numbers(value: Any) -> Any:
    """Return the same with numbers in the place of the texts that state one."""
    if isinstance(value, dict):
        return {key: _with_numbers(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_with_numbers(entry) for entry in value]
    if isinstance(value, str):
        with suppress(InvalidInputError):
            return read_number("", value)
    return value


CHARACTERISTICS = Key(_read_characteristics, array_schema({"anyOf": [POINTS, BY_NAME]}))
KEYS: Mapping[str, Key] = {
    **PLANT,
    "characteristics": CHARACTERISTICS.described("k of them, each a polyline in (y, u)", required=True),
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the piecewise linear system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    system = PiecewiseLinearSystem(
        values["A"], values["B"], values["C"], values.get("D"), values["characteristics"]
    )
    run = system.simulate(values["x0"], values["t_span"], method=method_in(values), t_eval=times_in(values))
    return of_model(run, ("value u", "argument y"))
