"""The elements of a circuit, added one after the other by methods of their own."""

from __future__ import annotations

from typing import Self

from pricing_core.errors import InvalidInputError
from pricing_core.models.characteristic import Characteristic
from pricing_core.models.circuits.characteristic_element import NonlinearResistor
from pricing_core.models.circuits.checked import checked_words
from pricing_core.models.circuits.elements import (
    Capacitor,
    Coupling,
    Diode,
    Element,
    Inductor,
    Resistor,
    Transformer,
)
from pricing_core.models.circuits.equations import Number
from pricing_core.models.circuits.signals import Value
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)
from pricing_core.models.circuits.switches import Control, Switch


class CircuitBuilder:
    """A circuit that its methods build up; each returns the circuit itself."""

    def __init__(self) -> None:
        self._elements: dict[str, Element] = {}
        self._taken: dict[str, str] = {}  # every name of an element or branch, and whose it is

    @property
    def elements(self) -> tuple[Element, ...]:
        """All elements, in the order in which they were added."""
        return tuple(self._elements.values())

    def add(self, element: Element) -> Self:
        """Add an element.

        Raises
        ------
        InvalidInputError
            There is one of that name already, or a transformer's winding, or the name is no string.
        """
        checked_words("name", getattr(element, "name", element))
        if not hasattr(element, "branches"):
            raise InvalidInputError("element", element, "an element of a circuit")
        names = {element.name, *(branch.name for branch in element.branches)}  # those of windings too
        for name in sorted(names & self._taken.keys()):
            raise InvalidInputError(
                "name", name, f"used by one element only, and {self._taken[name]} uses it"
            )
        self._elements[element.name] = element
        self._taken |= dict.fromkeys(names, element.name)
        return self

    def resistor(self, name: str, plus: str, minus: str, ohms: Number) -> Self:
        """Add a resistor: v = ohms i."""
        return self.add(Resistor(name, plus, minus, ohms))

    def capacitor(
        self, name: str, plus: str, minus: str, farads: Number, initial_voltage: Number = 0
    ) -> Self:
        """Add a capacitor: farads v' = i."""
        return self.add(Capacitor(name, plus, minus, farads, initial_voltage))

    def inductor(
        self, name: str, plus: str, minus: str, henries: Number, initial_current: Number = 0
    ) -> Self:
        """Add an inductor: henries i' = v."""
        return self.add(Inductor(name, plus, minus, henries, initial_current))

    def coupling(self, name: str, first: str, second: str, coefficient: Number) -> Self:
        """Couple two inductors, given by name, by the mutual inductance coefficient sqrt(L1 L2)."""
        return self.add(Coupling(name, first, second, coefficient))

    def transformer(
        self,
        name: str,
        primary_plus: str,
        primary_minus: str,
        secondary_plus: str,
        secondary_minus: str,
        ratio: Number,
    ) -> Self:
        """Add an ideal transformer: v(primary) = ratio v(secondary)."""
        ends = primary_plus, primary_minus, secondary_plus, secondary_minus
        return self.add(Transformer(name, *ends, ratio))

    def diode(
        self, name: str, anode: str, cathode: str, forward_voltage: Number = 0, resistance: Number = 0
    ) -> Self:
        """Add a diode: forward_voltage + resistance i while it conducts, no current while it blocks."""
        return self.add(Diode(name, anode, cathode, forward_voltage, resistance))

    def nonlinear_resistor(self, name: str, plus: str, minus: str, characteristic: Characteristic) -> Self:
        """Add an element whose voltage and current lie on a piecewise linear curve of points (volts, amperes)."""
        return self.add(NonlinearResistor(name, plus, minus, characteristic))

    def switch(
        self,
        name: str,
        plus: str,
        minus: str,
        control: Control | tuple[str, str, Number, Number],
        resistance: Number = 0,
        off_resistance: Number | None = None,
    ) -> Self:
        """Add a switch, which carries current either way while it is closed.

        Parameters
        ----------
        control : Pulse, PiecewiseConstant of 0 and 1, or (node, node, threshold, hysteresis)
            The last closes it where the voltage between the nodes rises above threshold + hysteresis, and opens it
            where that falls below threshold - hysteresis; it is open at the start in between.
        resistance, off_resistance : number
            Ohms while it is closed and open; 0 and None for an ideal switch.
        """
        return self.add(Switch(name, plus, minus, control, resistance, off_resistance))  # type: ignore[arg-type]

    def transistor(
        self,
        name: str,
        drain: str,
        source: str,
        control: Control | tuple[str, str, Number, Number],
        resistance: Number = 0,
        body_diode_voltage: Number = 0,
    ) -> Self:
        """Add a field-effect transistor as a switch, and its body diode NAME.body from source to drain."""
        self.switch(name, drain, source, control, resistance)
        return self.diode(f"{name}.body", source, drain, body_diode_voltage)

    def voltage_source(self, name: str, plus: str, minus: str, value: Value) -> Self:
        """Add a voltage source: a number, `Sine`, `PiecewiseConstant` or `piecewise_linear(times, values)`."""
        return self.add(VoltageSource(name, plus, minus, value))

    def current_source(self, name: str, plus: str, minus: str, value: Value) -> Self:
        """Add a current source, whose current enters it at plus and leaves it at minus."""
        return self.add(CurrentSource(name, plus, minus, value))

    def vcvs(
        self, name: str, plus: str, minus: str, control_plus: str, control_minus: str, gain: Number
    ) -> Self:
        """Add a voltage source of gain (v(control_plus) - v(control_minus))."""
        return self.add(
            VoltageControlled(name, plus, minus, control_plus, control_minus, gain, of_voltage=True)
        )

    def vccs(
        self, name: str, plus: str, minus: str, control_plus: str, control_minus: str, gain: Number
    ) -> Self:
        """Add a current source of gain (v(control_plus) - v(control_minus)), gain in siemens."""
        return self.add(
            VoltageControlled(name, plus, minus, control_plus, control_minus, gain, of_voltage=False)
        )

    def ccvs(self, name: str, plus: str, minus: str, control: str, gain: Number) -> Self:
        """Add a voltage source of gain i(control), gain in ohms, control the name of an element."""
        return self.add(CurrentControlled(name, plus, minus, control, gain, of_voltage=True))

    def cccs(self, name: str, plus: str, minus: str, control: str, gain: Number) -> Self:
        """Add a current source of gain i(control), control the name of an element."""
        return self.add(CurrentControlled(name, plus, minus, control, gain, of_voltage=False))
