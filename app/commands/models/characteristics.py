"""Characteristics in a model file: by their points and slopes, or by name with arguments."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import NUMBER, NUMBER_SCHEMA, VECTOR, Key, built, list_of, one_of, read_float
from pricing_core.errors import InvalidInputError
from pricing_core.models import (
    Characteristic,
    coulomb_friction,
    dead_zone,
    gain_schedule,
    ideal_diode,
    relay_step,
    resistor,
    saturation,
)


def _read_slope(field: str, value: Any) -> float:
    if value in ("inf", "-inf"):
        return float(value)
    try:
        return read_float(field, value)
    except InvalidInputError as fault:
        raise InvalidInputError(field, value, f'{fault.allowed}, or "inf" or "-inf"') from None


SLOPE = Key(_read_slope, {"anyOf": [NUMBER_SCHEMA, {"enum": ["inf", "-inf"]}]})
PAIR = list_of(NUMBER, "a pair [y, u]", minItems=2, maxItems=2)
POINTS: Mapping[str, Key] = {
    "points": list_of(PAIR, "a list of pairs [y, u]", minItems=1).described("pairs [y, u]", required=True),
    "left_slope": SLOPE.described("0 where missing"),
    "right_slope": SLOPE.described("0 where missing"),
}
NAMED: Mapping[str, Key] = {
    "saturation": built(saturation, {"gain": NUMBER, "limit": NUMBER}),
    "dead_zone": built(dead_zone, {"width": NUMBER, "gain": NUMBER}),
    "relay_step": built(relay_step, {"lower": NUMBER, "upper": NUMBER}),
    "coulomb_friction": built(coulomb_friction, {"level": NUMBER, "viscosity": NUMBER}),
    "ideal_diode": built(ideal_diode, {}),
    "resistor": built(
        resistor,
        {
            "voltages": VECTOR.described("one for each corner", required=True),
            "currents": VECTOR.described("one for each corner", required=True),
            "left_conductance": NUMBER.described("before the first corner", required=True),
            "right_conductance": NUMBER.described("beyond the last corner", required=True),
        },
    ),
    "gain_schedule": built(
        gain_schedule,
        {
            "thresholds": VECTOR.described("increasing", required=True),
            "gains": VECTOR.described("one more than thresholds", required=True),
            "offsets": VECTOR.described("as many as gains; continuous with u(0) = 0 where missing"),
        },
    ),
}
BY_POINTS = built(Characteristic, POINTS)
BY_NAME = one_of(NAMED, 'an object with "points", or with one of ' + ", ".join(NAMED))


def _read_characteristic(field: str, value: Any) -> Characteristic:
    by_points = isinstance(value, dict) and "points" in value
    characteristic: Characteristic = (BY_POINTS if by_points else BY_NAME).read(field, value)
    return characteristic


CHARACTERISTIC = Key(_read_characteristic, {"anyOf": [BY_POINTS.schema, BY_NAME.schema]})
CHARACTERISTICS = list_of(
    CHARACTERISTIC,
    "a list with one characteristic for each input",
)
