"""The elements of a circuit in a model file: the kinds, with their arguments by name."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from app.commands.model_keys import (
    TEXT,
    Key,
    built,
    choice,
    first_that_fits,
    list_of,
    object_schema,
    one_of,
    read_number,
    read_object,
)
from app.commands.models.characteristics import CHARACTERISTIC
from app.commands.models.inputs import CORNERS, GENERATED, PIECES
from pricing_core.errors import InvalidInputError, MissingInputError
from pricing_core.lcs import Exosystem, PiecewiseConstant, piecewise_linear
from pricing_core.models import Pulse, Sine
from pricing_core.models.circuits.quantity import quantity
from pricing_core.models.circuits.switches import Threshold


def _read_quantity(field: str, value: Any) -> float | Fraction:
    if not isinstance(value, str):
        return read_number(field, value)
    numerator, slash, denominator = value.partition("/")
    divisor = quantity(field, denominator) if slash else Fraction(1)
    if divisor == 0:
        raise InvalidInputError(field, value, "a number")
    return quantity(field, numerator) / divisor


QUANTITY = Key(_read_quantity, {"anyOf": [{"type": "number"}, {"type": "string"}]})
WAVE: Mapping[str, Key] = {
    "amplitude": QUANTITY.described("volts or amperes", required=True),
    "frequency": QUANTITY.described("hertz", required=True),
    "phase": QUANTITY.described("radians"),
    "offset": QUANTITY.described("added to it"),
}
SIGNALS: Mapping[str, Key] = {
    "sine": built(Sine, WAVE),
    "piecewise_constant": built(PiecewiseConstant, PIECES),
    "piecewise_linear": built(piecewise_linear, CORNERS),
    "exosystem": built(Exosystem, GENERATED),
}
SIGNAL = one_of(SIGNALS, "a number, or an object with one of " + ", ".join(SIGNALS))
VALUE = Key(
    first_that_fits([(dict, SIGNAL.read), (object, QUANTITY.read)], ""),
    {"anyOf": [*QUANTITY.schema["anyOf"], SIGNAL.schema]},
)

PULSE: Mapping[str, Key] = {
    "period": QUANTITY.described("seconds", required=True),
    "width": QUANTITY.described("seconds for which it is closed", required=True),
    "delay": QUANTITY.described("seconds before the first pulse; 0 where missing"),
}
THRESHOLD: Mapping[str, Key] = {
    "plus": TEXT.described("a node", required=True),
    "minus": TEXT.described("a node", required=True),
    "threshold": QUANTITY.described("volts between them", required=True),
    "hysteresis": QUANTITY.described("volts above which it closes and below which it opens; 0 where missing"),
}
CONTROLS: Mapping[str, Key] = {
    "pulse": built(Pulse, PULSE),
    "piecewise_constant": built(PiecewiseConstant, PIECES),
    "threshold": built(Threshold, THRESHOLD),
}
CLOCK = one_of(CONTROLS, "an object with one of " + ", ".join(CONTROLS))

NODE = TEXT.described('a node; the ground is "0"', required=True)
POSITIVE = QUANTITY.described('a positive number, or a text such as "4.7k" or "1/3"', required=True)
INITIAL = QUANTITY.described("0 where missing")
GAIN = QUANTITY.described("output over control", required=True)
ENDS = {"plus": NODE, "minus": NODE}
CONTROL_NODES = {"control_plus": NODE, "control_minus": NODE}
CONTROL = {"control": TEXT.described("the element whose current controls", required=True)}
INDUCTOR = TEXT.described("the name of an inductor", required=True)
# The methods of `DiodeCircuit`, with their arguments beside the name.
KINDS: Mapping[str, Mapping[str, Key]] = {
    "resistor": {**ENDS, "ohms": POSITIVE},
    "capacitor": {**ENDS, "farads": POSITIVE, "initial_voltage": INITIAL},
    "inductor": {**ENDS, "henries": POSITIVE, "initial_current": INITIAL},
    "coupling": {
        "first": INDUCTOR,
        "second": INDUCTOR,
        "coefficient": QUANTITY.described("between -1 and 1, and not 0", required=True),
    },
    "diode": {
        "anode": NODE,
        "cathode": NODE,
        "forward_voltage": INITIAL.described("volts while it conducts; 0 where missing"),
        "resistance": INITIAL.described("ohms while it conducts; 0 where missing"),
    },
    "nonlinear_resistor": {
        **ENDS,
        "characteristic": CHARACTERISTIC.described("points of volts and amperes", required=True),
    },
    "switch": {
        **ENDS,
        "control": CLOCK.described("what closes and opens it", required=True),
        "resistance": INITIAL.described("ohms while it is closed; 0 where missing"),
        "off_resistance": QUANTITY.described("ohms while it is open; without end where missing"),
    },
    "transistor": {
        "drain": NODE,
        "source": NODE,
        "control": CLOCK.described("what closes and opens it", required=True),
        "resistance": INITIAL.described("ohms while it is closed; 0 where missing"),
        "body_diode_voltage": INITIAL.described("volts while its body diode conducts; 0 where missing"),
    },
    "transformer": {
        **dict.fromkeys(("primary_plus", "primary_minus", "secondary_plus", "secondary_minus"), NODE),
        "ratio": QUANTITY.described("of the voltages, primary over secondary", required=True),
    },
    "voltage_source": {**ENDS, "value": VALUE.described("volts", required=True)},
    "current_source": {**ENDS, "value": VALUE.described("amperes", required=True)},
    "vcvs": {**ENDS, **CONTROL_NODES, "gain": GAIN},
    "vccs": {**ENDS, **CONTROL_NODES, "gain": GAIN},
    "ccvs": {**ENDS, **CONTROL, "gain": GAIN},
    "cccs": {**ENDS, **CONTROL, "gain": GAIN},
}


def _keys(kind: str) -> dict[str, Key]:
    name = TEXT.described("its own in the circuit", required=True)
    return {"kind": choice(kind).described("what it is", required=True), "name": name, **KINDS[kind]}


def _read_element(field: str, value: Any) -> dict[str, Any]:
    kinds = "one of " + ", ".join(KINDS)
    if not isinstance(value, dict):
        raise InvalidInputError(field, value, f'an object with "kind", which is {kinds}')
    if "kind" not in value:
        raise MissingInputError(f"{field}.kind", f"give {kinds}")
    kind = choice(*KINDS).read(f"{field}.kind", value["kind"])
    return read_object(field, value, _keys(kind))


ELEMENTS = list_of(
    Key(_read_element, {"oneOf": [object_schema(_keys(kind)) for kind in KINDS]}), "a list of elements"
)
