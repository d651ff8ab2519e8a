"""A reader for the linear part of SPICE netlists, with ideal diodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models.circuits.elements import (
    Capacitor,
    Coupling,
    Diode,
    Element,
    Inductor,
    Resistor,
    Transformer,
)
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.netlist_lines import Card, cards
from pricing_core.models.circuits.quantity import quantity
from pricing_core.models.circuits.signals import Sine, Value
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)


def read_netlist(text: str) -> tuple[Element, ...]:
    """Return the elements of a netlist; see `DiodeCircuit.from_netlist` for what it may contain.

    Examples
    --------
    >>> read_netlist("C1 out gnd 10u IC=5 ; charged")
    (Capacitor(name='C1', plus='out', minus='0', farads=Fraction(1, 100000), initial_voltage=Fraction(5, 1)),)
    """
    if not isinstance(text, str):
        raise InvalidInputError("netlist", text, "a text")
    names = _Names()
    return tuple(_element(card, names) for card in _registered(cards(text), names))


class _Names:
    """The spelling that came first of names that differ in case only."""

    def __init__(self) -> None:
        self.nodes: dict[str, str] = {"0": GROUND, "gnd": GROUND}
        self.elements: dict[str, str] = {}

    def node(self, text: str) -> str:
        return self.nodes.setdefault(text.lower(), text)

    def element(self, text: str) -> str:
        return self.elements.get(text.lower(), text)


def _registered(found: list[Card], names: _Names) -> list[Card]:
    """Return the cards, having noted the name of every element."""
    for card in found:
        name = card.words[0]
        if name.lower() in names.elements:
            raise InvalidInputError(card.field, name, "a name that no other element has")
        names.elements[name.lower()] = name
    return found


def _element(card: Card, names: _Names) -> Element:
    """Return the element that a card states."""
    letter = card.words[0][0].upper()
    if letter not in _READERS:
        allowed = f"an element whose name begins with one of {' '.join(_READERS)}; a title begins with *"
        raise InvalidInputError(card.field, card.words[0], allowed)
    try:
        return _READERS[letter](card, names)
    except InvalidInputError as fault:  # the element does not know its line
        if fault.field == card.field:
            raise
        raise InvalidInputError(f"{card.field}: {fault.field}", fault.value, fault.allowed) from None


def _two_nodes(card: Card, names: _Names) -> tuple[str, str, str]:
    return card.words[0], names.node(card.words[1]), names.node(card.words[2])


def _resistor(card: Card, names: _Names) -> Element:
    card.check("R<name> node node ohms", 4)
    return Resistor(*_two_nodes(card, names), card.number(3))


def _capacitor(card: Card, names: _Names) -> Element:
    initial = card.check("C<name> node node farads [IC=volts]", 4, "ic")
    return Capacitor(*_two_nodes(card, names), card.number(3), initial)


def _inductor(card: Card, names: _Names) -> Element:
    initial = card.check("L<name> node node henries [IC=amperes]", 4, "ic")
    return Inductor(*_two_nodes(card, names), card.number(3), initial)


def _diode(card: Card, names: _Names) -> Element:
    if len(card.words) != 4:  # with the name of a model, which is ideal all the same
        card.check("D<name> anode cathode [model]", 3)
    return Diode(*_two_nodes(card, names))


def _voltage_source(card: Card, names: _Names) -> Element:
    card.check_least("V<name> plus minus value", 4)
    return VoltageSource(*_two_nodes(card, names), _value(card))


def _current_source(card: Card, names: _Names) -> Element:
    card.check_least("I<name> plus minus value", 4)
    return CurrentSource(*_two_nodes(card, names), _value(card))


def _voltage_controlled(card: Card, names: _Names) -> Element:
    letter = card.words[0][0].upper()
    card.check(f"{letter}<name> plus minus control_plus control_minus gain", 6)
    name, plus, minus = _two_nodes(card, names)
    plus_control, minus_control = (names.node(word) for word in card.words[3:5])
    gain = card.number(5)
    return VoltageControlled(name, plus, minus, plus_control, minus_control, gain, of_voltage=letter == "E")


def _current_controlled(card: Card, names: _Names) -> Element:
    letter = card.words[0][0].upper()
    card.check(f"{letter}<name> plus minus element gain", 5)
    control = names.element(card.words[3])
    return CurrentControlled(*_two_nodes(card, names), control, card.number(4), of_voltage=letter == "H")


def _coupling(card: Card, names: _Names) -> Element:
    card.check("K<name> inductor inductor coefficient", 4)
    first, second = (names.element(word) for word in card.words[1:3])
    return Coupling(card.words[0], first, second, card.number(3))


def _transformer(card: Card, names: _Names) -> Element:
    card.check("X<name> primary_plus primary_minus secondary_plus secondary_minus ratio", 6)
    a, b, c, d = (names.node(word) for word in card.words[1:5])
    return Transformer(card.words[0], a, b, c, d, card.number(5))


def _value(card: Card) -> Value:
    """Return the value of an independent source: a number, SIN(...) or PWL(...)."""
    words = card.words[4:] if card.words[3].lower() == "dc" else card.words[3:]
    shape = words[0].lower() if words else ""
    if shape.isalpha() and shape not in ("sin", "pwl"):
        raise InvalidInputError(card.field, " ".join(words), "one value: a number, SIN(...) or PWL(...)")
    numbers = [quantity(card.field, word) for word in (words[1:] if shape in ("sin", "pwl") else words)]
    if shape == "sin":
        allowed = "SIN(offset amplitude hertz [delay=0 damping=0 degrees])"
        if not 3 <= len(numbers) <= 6 or any(numbers[3:5]):
            raise InvalidInputError(card.field, " ".join(words), allowed)
        offset, amplitude, frequency = (float(number) for number in numbers[:3])
        return Sine(amplitude, frequency, math.radians(numbers[5]) if numbers[5:] else 0.0, offset)
    if shape == "pwl":
        if len(numbers) < 4 or len(numbers) % 2:
            raise InvalidInputError(card.field, " ".join(words), "PWL(time value time value ...)")
        return piecewise_linear([float(t) for t in numbers[::2]], [float(value) for value in numbers[1::2]])
    if len(numbers) != 1:
        raise InvalidInputError(card.field, " ".join(words), "one value: a number, SIN(...) or PWL(...)")
    return numbers[0]


_Reader: TypeAlias = Callable[[Card, _Names], Element]

_READERS: dict[str, _Reader] = {
    "R": _resistor,
    "C": _capacitor,
    "L": _inductor,
    "D": _diode,
    "V": _voltage_source,
    "I": _current_source,
    "E": _voltage_controlled,
    "F": _current_controlled,
    "G": _voltage_controlled,
    "H": _current_controlled,
    "K": _coupling,
    "X": _transformer,
}
