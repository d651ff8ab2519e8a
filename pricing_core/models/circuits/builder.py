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
        """Add a resistor `name` between the nodes `plus` and `minus`: v = ohms i."""
        return self.add(Resistor(name, plus, minus, ohms))

    def capacitor(
        self, name: str, plus: str, minus: str, farads: Number, initial_voltage: Number = 0
    ) -> Self:
        """Add a capacitor `name` from `plus` to `minus`: farads v' = i.

        At the start its voltage is initial_voltage, in volts.
        """
        return self.add(Capacitor(name, plus, minus, farads, initial_voltage))

    def inductor(
        self, name: str, plus: str, minus: str, henries: Number, initial_current: Number = 0
    ) -> Self:
        """Add an inductor `name` from `plus` to `minus`: henries i' = v.

        At the start its current is initial_current, in amperes.
        """
        return self.add(Inductor(name, plus, minus, henries, initial_current))

    def coupling(self, name: str, first: str, second: str, coefficient: Number) -> Self:
        """Couple the inductors named `first` and `second`: `name` is the mutual inductance coefficient sqrt(L1 L2)."""
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
        """Add an ideal transformer: v(primary) = ratio v(secondary), and no power is lost.

        Parameters
        ----------
        name : str
        primary_plus, primary_minus, secondary_plus, secondary_minus : str
            Nodes of the two windings.
        ratio : number
            Turns of the primary winding for one of the secondary.
        """
        ends = primary_plus, primary_minus, secondary_plus, secondary_minus
        return self.add(Transformer(name, *ends, ratio))

    def diode(
        self, name: str, anode: str, cathode: str, forward_voltage: Number = 0, resistance: Number = 0
    ) -> Self:
        """Add a diode `name`, which conducts from `anode` to `cathode`.

        Its voltage is forward_voltage + resistance i (volts, ohms) while it conducts; no current flows while it blocks.
        """
        return self.add(Diode(name, anode, cathode, forward_voltage, resistance))

    def nonlinear_resistor(self, name: str, plus: str, minus: str, characteristic: Characteristic) -> Self:
        """Add an element `name` from `plus` to `minus` whose voltage and current lie on a piecewise linear curve.

        Parameters
        ----------
        name, plus, minus : str
        characteristic : Characteristic
            The curve, as points (volts, amperes).
        """
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
        name, plus, minus : str
            Its name and its nodes.
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
        """Add a field-effect transistor as a switch, and its body diode NAME.body from source to drain.

        Parameters
        ----------
        name, drain, source : str
            Its name and its nodes.
        control : Pulse, PiecewiseConstant of 0 and 1, or (node, node, threshold, hysteresis)
            The same as that of `switch`.
        resistance : number
            Ohms while it is closed.
        body_diode_voltage : number
            Forward voltage of the body diode, volts.
        """
        self.switch(name, drain, source, control, resistance)
        return self.diode(f"{name}.body", source, drain, body_diode_voltage)

    def voltage_source(self, name: str, plus: str, minus: str, value: Value) -> Self:
        """Add a voltage source: v(plus) - v(minus) = value.

        Parameters
        ----------
        name, plus, minus : str
            Its name and its nodes.
        value : number, Sine, PiecewiseConstant or Exosystem
            Volts; `piecewise_linear(times, values)` gives one as well.
        """
        return self.add(VoltageSource(name, plus, minus, value))

    def current_source(self, name: str, plus: str, minus: str, value: Value) -> Self:
        """Add a current source, whose current enters it at plus and leaves it at minus.

        Parameters
        ----------
        name, plus, minus : str
            Its name and its nodes.
        value : number, Sine, PiecewiseConstant or Exosystem
            Amperes; `piecewise_linear(times, values)` gives one as well.
        """
        return self.add(CurrentSource(name, plus, minus, value))

    def vcvs(
        self, name: str, plus: str, minus: str, control_plus: str, control_minus: str, gain: Number
    ) -> Self:
        """Add a source `name`: v(plus) - v(minus) = gain (v(control_plus) - v(control_minus))."""
        return self.add(
            VoltageControlled(name, plus, minus, control_plus, control_minus, gain, of_voltage=True)
        )

    def vccs(
        self, name: str, plus: str, minus: str, control_plus: str, control_minus: str, gain: Number
    ) -> Self:
        """Add a source `name` of current from plus to minus, gain (v(control_plus) - v(control_minus)).

        The gain is in siemens.
        """
        return self.add(
            VoltageControlled(name, plus, minus, control_plus, control_minus, gain, of_voltage=False)
        )

    def ccvs(self, name: str, plus: str, minus: str, control: str, gain: Number) -> Self:
        """Add a source `name`: v(plus) - v(minus) = gain i(control), gain in ohms, control the name of an element."""
        return self.add(CurrentControlled(name, plus, minus, control, gain, of_voltage=True))

    def cccs(self, name: str, plus: str, minus: str, control: str, gain: Number) -> Self:
        """Add a source `name` of current gain i(control) from plus to minus, control the name of an element."""
        return self.add(CurrentControlled(name, plus, minus, control, gain, of_voltage=False))
