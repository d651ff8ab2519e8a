"""The elements that the cards of a netlist state, one reader for each first letter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.elements import (
    Capacitor,
    Coupling,
    Diode,
    Element,
    Inductor,
    Resistor,
    Transformer,
)
from pricing_core.models.circuits.netlist.lines import Card
from pricing_core.models.circuits.netlist.models import DiodeModel, SwitchModel
from pricing_core.models.circuits.netlist.subcircuits import Place
from pricing_core.models.circuits.netlist.waveforms import waveform
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)
from pricing_core.models.circuits.switches import Switch, Threshold


def element_of(card: Card, place: Place) -> Element:
    """Return the element that a card states."""
    letter = card.words[0][0].upper()
    if letter in "MQJ":
        allowed = (
            "a switch, S<name> with a model of type SW, and a diode beside it: transistors are read as such"
        )
        raise card.line.fault(allowed)
    if letter not in READERS:
        allowed = f"an element whose name begins with one of {' '.join(READERS)}; a title begins with *"
        raise InvalidInputError(card.field, card.words[0], allowed)
    try:
        return READERS[letter](card, place)
    except InvalidInputError as fault:  # the element does not know its line
        if fault.field.startswith(card.field):
            raise
        raise fault.called(f"{card.field}: {fault.field}") from None


def _two_nodes(card: Card, place: Place) -> tuple[str, str, str]:
    return place.prefix + card.words[0], place.node(card.words[1]), place.node(card.words[2])


def _resistor(card: Card, place: Place) -> Element:
    card.check("R<name> node node ohms", 4)
    return Resistor(*_two_nodes(card, place), card.number(3))


def _capacitor(card: Card, place: Place) -> Element:
    initial = card.check("C<name> node node farads [IC=volts]", 4, "ic")
    return Capacitor(*_two_nodes(card, place), card.number(3), initial)


def _inductor(card: Card, place: Place) -> Element:
    initial = card.check("L<name> node node henries [IC=amperes]", 4, "ic")
    return Inductor(*_two_nodes(card, place), card.number(3), initial)


def _diode(card: Card, place: Place) -> Element:
    if len(card.words) == 3:
        card.check("D<name> anode cathode [model]", 3)
        return Diode(*_two_nodes(card, place))
    card.check("D<name> anode cathode [model]", 4)
    model = place.models.get(card.words[3].lower())
    if not isinstance(model, DiodeModel):
        known = [name for name, other in place.models.items() if isinstance(other, DiodeModel)]
        allowed = f"a diode of a model that the netlist has: {', '.join(known) or 'it has none'}"
        raise card.line.fault(allowed)
    return Diode(*_two_nodes(card, place), model.forward_voltage, model.resistance)


def _switch(card: Card, place: Place) -> Element:
    by_current = card.words[0][0].upper() == "W"
    count = 5 if by_current else 6
    form = (
        "W<name> node node element model [ON|OFF]"
        if by_current
        else "S<name> node node plus minus model [ON|OFF]"
    )
    words = card.words
    state = words[-1].lower() if len(words) == count + 1 else "off"
    if len(words) not in (count, count + 1) or card.options or state not in ("on", "off"):
        raise card.line.fault(f"of the form {form}")
    model = place.models.get(words[count - 1].lower())
    if not isinstance(model, SwitchModel) or model.of_current != by_current:
        kind = "CSW" if by_current else "SW or VSWITCH"
        raise card.line.fault(f"a switch of a model of type {kind} that the netlist has")
    numbers = model.threshold, model.hysteresis, state == "on"
    if by_current:
        control = Threshold(place.element(words[3]), "", *numbers)
    else:
        control = Threshold(place.node(words[3]), place.node(words[4]), *numbers)
    return Switch(*_two_nodes(card, place), control, model.resistance, model.off_resistance)


def _voltage_source(card: Card, place: Place) -> Element:
    card.check_least("V<name> plus minus value", 4)
    return VoltageSource(*_two_nodes(card, place), waveform(card))


def _current_source(card: Card, place: Place) -> Element:
    card.check_least("I<name> plus minus value", 4)
    return CurrentSource(*_two_nodes(card, place), waveform(card))


def _voltage_controlled(card: Card, place: Place) -> Element:
    letter = card.words[0][0].upper()
    card.check(f"{letter}<name> plus minus control_plus control_minus gain", 6)
    nodes = tuple(place.node(word) for word in card.words[3:5])
    gain = card.number(5)
    return VoltageControlled(*_two_nodes(card, place), nodes[0], nodes[1], gain, of_voltage=letter == "E")


def _current_controlled(card: Card, place: Place) -> Element:
    letter = card.words[0][0].upper()
    card.check(f"{letter}<name> plus minus element gain", 5)
    control = place.element(card.words[3])
    return CurrentControlled(*_two_nodes(card, place), control, card.number(4), of_voltage=letter == "H")


def _coupling(card: Card, place: Place) -> Element:
    card.check("K<name> inductor inductor coefficient", 4)
    first, second = (place.element(word) for word in card.words[1:3])
    return Coupling(place.prefix + card.words[0], first, second, card.number(3))


def _transformer(card: Card, place: Place) -> Element:
    form = "X<name> primary_plus primary_minus secondary_plus secondary_minus ratio, or X<name> node ... SUBCIRCUIT"
    card.check(form, 6)
    a, b, c, d = (place.node(word) for word in card.words[1:5])
    return Transformer(place.prefix + card.words[0], a, b, c, d, card.number(5))


_Reader: TypeAlias = Callable[[Card, Place], Element]

READERS: dict[str, _Reader] = {
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
    "S": _switch,
    "W": _switch,
    "X": _transformer,
}
