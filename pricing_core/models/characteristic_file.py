"""Characteristics as parsed JSON: by their points and slopes, or by name with arguments."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from pricing_core.arrays import as_number, as_real_array
from pricing_core.errors import InvalidInputError, Told
from pricing_core.models import named_characteristics
from pricing_core.models.characteristic import Characteristic

NAMED: dict[str, Callable[..., Characteristic]] = {
    "saturation": named_characteristics.saturation,
    "dead_zone": named_characteristics.dead_zone,
    "relay_step": named_characteristics.relay_step,
    "coulomb_friction": named_characteristics.coulomb_friction,
    "ideal_diode": named_characteristics.ideal_diode,
    "resistor": named_characteristics.resistor,
    "gain_schedule": named_characteristics.gain_schedule,
}


def characteristic_from_json(field: str, entry: Any) -> Characteristic:
    """Return the characteristic that an object states.

    It is {"points": [[y, u], ...], "left_slope"?, "right_slope"?} with slopes that are numbers, "inf" or "-inf", or
    one of the named ones with its arguments, such as {"saturation": {"limit": 2}}.

    Parameters
    ----------
    field : str
        What errors call it.
    entry : parsed JSON

    Raises
    ------
    InvalidInputError
        It is no characteristic; `field` may be "characteristics[0].points".

    Examples
    --------
    >>> characteristic_from_json("friction", {"coulomb_friction": {"level": 2}}).points.tolist()
    [[0.0, 2.0], [0.0, -2.0]]
    """
    if not isinstance(entry, Mapping):
        raise InvalidInputError(field, entry, 'an object such as {"points": [[0, 1], [0, -1]]}')
    try:
        if "points" in entry:
            _check_keys("", entry, ("points",), ("left_slope", "right_slope"))
            slopes = [_slope(name, entry.get(name, 0.0)) for name in ("left_slope", "right_slope")]
            return Characteristic(as_real_array("points", entry["points"]), *slopes)
        if len(entry) != 1 or (name := next(iter(entry))) not in NAMED:
            raise InvalidInputError("points", Told("missing"), "given, or one of " + ", ".join(NAMED))
        return _named(name, entry[name])
    except InvalidInputError as error:
        raise InvalidInputError(f"{field}.{error.field}", error.value, error.allowed) from None


def _check_keys(
    field: str, document: Mapping[str, Any], required: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    prefix = f"{field}." if field else ""
    for key in document:
        if key not in required and key not in optional:
            raise InvalidInputError(
                f"{prefix}{key}", document[key], "left out; known are " + ", ".join(required + optional)
            )
    for key in required:
        if key not in document:
            raise InvalidInputError(f"{prefix}{key}", Told("missing"), "given")


def _named(name: str, arguments: Any) -> Characteristic:
    make = NAMED[name]
    names = make.__code__.co_varnames[: make.__code__.co_argcount]
    if not isinstance(arguments, Mapping):
        raise InvalidInputError(name, arguments, "an object with the arguments " + ", ".join(names))
    defaults = len(make.__defaults__ or ())
    _check_keys(name, arguments, names[: len(names) - defaults], names[len(names) - defaults :])
    values = {key: as_real_array(f"{name}.{key}", value) for key, value in arguments.items()}
    for key, value in values.items():
        if make.__annotations__[key] is float and value.ndim > 0:
            raise InvalidInputError(f"{name}.{key}", arguments[key], "one number")
    return make(**{key: value.item() if value.ndim == 0 else value for key, value in values.items()})


def _slope(name: str, value: Any) -> float:
    if value in ("inf", "-inf"):
        return math.inf if value == "inf" else -math.inf
    try:
        return as_number(name, value)
    except InvalidInputError as error:
        raise InvalidInputError(name, value, 'a number, "inf" or "-inf"') from error
