"""Independent and controlled sources, with their equations."""

from __future__ import annotations

from dataclasses import dataclass

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Exosystem, PiecewiseConstant
from pricing_core.linalg.rational import rational
from pricing_core.models.circuits.checked import checked_ends, checked_number, checked_words, settle
from pricing_core.models.circuits.elements import Branch
from pricing_core.models.circuits.equations import Number, Row, current, total, voltage
from pricing_core.models.circuits.signals import Sine, Value


@dataclass(frozen=True, slots=True, eq=False)
class _IndependentSource:
    name: str
    plus: str
    minus: str
    value: Value

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        settle(self, "value", checked_value(self.name, self.value))

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One."""
        return (Branch(self.name, self.plus, self.minus),)


@dataclass(frozen=True, slots=True, eq=False)
class VoltageSource(_IndependentSource):
    """v(plus) - v(minus) = value; its current flows from plus through the source to minus."""

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the voltage is given."""
        return (total(voltage(self.plus, self.minus), {("source", self.name): rational(-1)}),)


@dataclass(frozen=True, slots=True, eq=False)
class CurrentSource(_IndependentSource):
    """i = value, from plus through the source to minus."""

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the current is given."""
        return (total(current(self.name), {("source", self.name): rational(-1)}),)


@dataclass(frozen=True, slots=True)
class VoltageControlled:
    """A source of gain (v(control_plus) - v(control_minus)): volts (VCVS) or amperes (VCCS)."""

    name: str
    plus: str
    minus: str
    control_plus: str
    control_minus: str
    gain: Number
    of_voltage: bool  # whether the source is one of voltage

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        checked_words(f"control of {self.name}", self.control_plus, self.control_minus)
        settle(self, "gain", checked_number(f"gain of {self.name}", self.gain))

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, the output; the control draws no current."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the output is the gain times the control."""
        output = voltage(self.plus, self.minus) if self.of_voltage else current(self.name)
        return (total(output, voltage(self.control_plus, self.control_minus, -rational(self.gain))),)


@dataclass(frozen=True, slots=True)
class CurrentControlled:
    """A source of gain i(control): volts (CCVS) or amperes (CCCS)."""

    name: str
    plus: str
    minus: str
    control: str  # the branch whose current controls
    gain: Number
    of_voltage: bool  # whether the source is one of voltage

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        checked_words(f"control of {self.name}", self.control)
        settle(self, "gain", checked_number(f"gain of {self.name}", self.gain))

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, the output."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the output is the gain times the control."""
        output = voltage(self.plus, self.minus) if self.of_voltage else current(self.name)
        return (total(output, current(self.control, -rational(self.gain))),)


def checked_value(name: str, value: Value) -> Value:
    """Return a scalar signal, a number as one of Python's, or refuse."""
    if isinstance(value, PiecewiseConstant | Exosystem):
        if value.size != 1:
            raise InvalidInputError(f"value of {name}", f"{value.size} components", "one component")
        return value
    return value if isinstance(value, Sine) else checked_number(f"value of {name}", value)
