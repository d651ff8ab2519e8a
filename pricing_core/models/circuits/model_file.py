"""Circuits as parsed JSON objects: a netlist, or a list of elements with the names of their arguments."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from fractions import Fraction
from typing import Any

import numpy as np

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Exosystem, PiecewiseConstant, piecewise_linear
from pricing_core.linalg.rational import rational
from pricing_core.models.circuits.diode_circuit import DiodeCircuit
from pricing_core.models.circuits.elements import (
    Capacitor,
    Coupling,
    Diode,
    Element,
    Inductor,
    Resistor,
    Transformer,
)
from pricing_core.models.circuits.quantity import quantity
from pricing_core.models.circuits.signals import Sine
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)

# How each kind of element is called, its class, and what the kind settles of its arguments.
KINDS: dict[str, tuple[Callable[..., Element], dict[str, bool]]] = {
    "resistor": (Resistor, {}),
    "capacitor": (Capacitor, {}),
    "inductor": (Inductor, {}),
    "coupling": (Coupling, {}),
    "diode": (Diode, {}),
    "transformer": (Transformer, {}),
    "voltage_source": (VoltageSource, {}),
    "current_source": (CurrentSource, {}),
    "vcvs": (VoltageControlled, {"of_voltage": True}),
    "vccs": (VoltageControlled, {"of_voltage": False}),
    "ccvs": (CurrentControlled, {"of_voltage": True}),
    "cccs": (CurrentControlled, {"of_voltage": False}),
}
SIGNALS: dict[str, Callable[..., Sine | PiecewiseConstant | Exosystem]] = {
    "sine": Sine,
    "piecewise_constant": PiecewiseConstant,
    "piecewise_linear": piecewise_linear,
    "exosystem": Exosystem,
}


def circuit_from_json(parsed: Mapping[str, Any]) -> DiodeCircuit:
    """Return the circuit of {"model": "circuit", "netlist": TEXT} or {"model": "circuit", "elements": [...]}.

    An element is {"kind": KIND, ...} with the builder's method for KIND and its arguments for the other keys. Numbers
    may be strings, such as "4.7k" or "1/3"; the value of a source may be {"sine": {"amplitude": 10, "frequency": 50}},
    {"piecewise_constant": ...}, {"piecewise_linear": {"times": [...], "values": [...]}} or {"exosystem": ...}. The keys
    x0, t_span and t_eval, which say what to simulate, are left to the caller.

    Raises
    ------
    InvalidInputError
        It is none of these.

    Examples
    --------
    >>> parsed = {"model": "circuit", "elements": [
    ...     {"kind": "capacitor", "name": "C1", "plus": "a", "minus": "0", "farads": "1u", "initial_voltage": 5},
    ...     {"kind": "resistor", "name": "R1", "plus": "a", "minus": "0", "ohms": 1000}]}
    >>> circuit_from_json(parsed).to_lcs().system.A
    array([[-1000.]])
    """
    model = parsed.get("model") if isinstance(parsed, Mapping) else parsed
    if model != "circuit":
        raise InvalidInputError("model", model, '"circuit"')
    unknown = set(parsed) - {"model", "netlist", "elements", "x0", "t_span", "t_eval"}
    if unknown:
        raise InvalidInputError("circuit", sorted(unknown), 'without keys but "netlist" or "elements"')
    if ("netlist" in parsed) == ("elements" in parsed):
        raise InvalidInputError("circuit", sorted(parsed), 'given either as "netlist" or as "elements"')
    if "netlist" in parsed:
        return DiodeCircuit.from_netlist(parsed["netlist"])
    if not isinstance(parsed["elements"], list):
        raise InvalidInputError("elements", parsed["elements"], "a list")
    circuit = DiodeCircuit()
    for element in parsed["elements"]:
        circuit.add(_element(element))
    return circuit


def circuit_to_json(circuit: DiodeCircuit) -> dict[str, Any]:
    """Return the object, ready for JSON, from which `circuit_from_json` makes the same circuit.

    Examples
    --------
    >>> circuit_to_json(DiodeCircuit().resistor("R1", "a", "0", Fraction(1, 3)))["elements"]
    [{'kind': 'resistor', 'name': 'R1', 'plus': 'a', 'minus': '0', 'ohms': '1/3'}]
    """
    return {"model": "circuit", "elements": [_stated(element) for element in circuit.elements]}


def _element(stated: Mapping[str, Any]) -> Element:
    kind = stated.get("kind") if isinstance(stated, Mapping) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise InvalidInputError("kind of an element", kind, f"one of {', '.join(KINDS)}")
    make, settled = KINDS[kind]
    arguments = {key: value for key, value in stated.items() if key != "kind"}
    label = f"{kind} {arguments['name']}" if isinstance(arguments.get("name"), str) else kind
    known = [field.name for field in fields(make) if field.name not in settled]  # type: ignore[arg-type]
    for key in arguments:
        if key not in known:
            raise InvalidInputError(label, key, f"given by {', '.join(known)}")
    numbers = set(known) & {"ohms", "farads", "henries", "initial_voltage", "initial_current", "coefficient"}
    for key in (numbers | {"ratio", "gain", "value"}) & set(arguments):
        arguments[key] = _value(f"{key} of {label}", arguments[key])
    try:
        return make(**arguments, **settled)
    except TypeError as error:
        raise InvalidInputError(label, sorted(arguments), f"given by all of {', '.join(known)}") from error


def _value(field: str, stated: Any) -> Any:
    """Return a number from a string, a signal from an object, and anything else as it is, to be checked later."""
    if isinstance(stated, str):
        numerator, slash, denominator = stated.partition("/")
        divisor = quantity(field, denominator) if slash else Fraction(1)
        if divisor == 0:
            raise InvalidInputError(field, stated, "a number")
        return quantity(field, numerator) / divisor
    if isinstance(stated, Mapping):
        if len(stated) != 1 or not set(stated) <= set(SIGNALS):
            raise InvalidInputError(field, sorted(stated), f"one of {', '.join(SIGNALS)}")
        ((name, arguments),) = stated.items()
        try:
            return SIGNALS[name](**arguments)
        except TypeError as error:
            raise InvalidInputError(field, arguments, f"the arguments of {name}") from error
    return stated


def _stated(element: Element) -> dict[str, Any]:
    """Return the object that states an element."""
    kind, settled = next(
        (kind, settled)
        for kind, (make, settled) in KINDS.items()
        if type(element) is make and all(getattr(element, key) == value for key, value in settled.items())
    )
    names = [field.name for field in fields(element) if field.name not in settled]  # type: ignore[arg-type]
    return {"kind": kind} | {name: _plain(getattr(element, name)) for name in names}


def _plain(value: Any) -> Any:
    """Return what JSON has for a name, a number or a signal."""
    if isinstance(value, Fraction):
        return float(value) if rational(float(value)) == rational(value) else str(value)
    for name, kind in (("sine", Sine), ("piecewise_constant", PiecewiseConstant), ("exosystem", Exosystem)):
        if isinstance(value, kind):
            parts = {
                field.name: getattr(value, field.name) for field in fields(kind) if field.name != "given"
            }
            lists = {
                key: part.tolist() if isinstance(part, np.ndarray) else part for key, part in parts.items()
            }
            return {name: lists}
    return value
