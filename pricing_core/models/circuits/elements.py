"""The elements that store or dissipate energy, diodes and ideal transformers, with their equations.

The current of a branch flows from its first node through the element to its second one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pricing_core.errors import InvalidInputError
from pricing_core.linalg.rational import rational
from pricing_core.models.circuits.checked import (
    SMALLEST,
    checked_ends,
    checked_nonnegative,
    checked_number,
    checked_positive,
    checked_words,
    settle,
)
from pricing_core.models.circuits.equations import Number, Row, constant, current, total, voltage


class Branch(NamedTuple):
    """A path of current between two nodes."""

    name: str
    plus: str
    minus: str


class Element(Protocol):
    """An element of a circuit: resistor, capacitor, source, diode and so on."""

    @property
    def name(self) -> str:
        """Its name, which no other element of the circuit has."""

    @property
    def branches(self) -> tuple[Branch, ...]:
        """The branches that carry its currents."""

    @property
    def equations(self) -> tuple[Row, ...]:
        """Rows whose sums over the unknowns are zero."""


def pairs_of(element: Element) -> tuple[str, ...]:
    """Return the names of the element's complementary pairs: none for most."""
    pairs: tuple[str, ...] = getattr(element, "pairs", ())
    return pairs


@dataclass(frozen=True, slots=True)
class Resistor:
    """v = ohms i.

    Examples
    --------
    >>> Resistor("R1", "a", "0", 5).equations
    ({('v', 'a'): 1, ('i', 'R1'): -5},)
    """

    name: str
    plus: str
    minus: str
    ohms: Number

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        settle(self, "ohms", checked_positive(f"ohms of {self.name}", self.ohms))

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from plus to minus."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """Ohm's law, as one row."""
        return (total(voltage(self.plus, self.minus), current(self.name, -rational(self.ohms))),)


@dataclass(frozen=True, slots=True)
class Capacitor:
    """farads v' = i, its voltage v a state that starts at initial_voltage."""

    name: str
    plus: str
    minus: str
    farads: Number
    initial_voltage: Number = 0

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        settle(self, "farads", checked_positive(f"farads of {self.name}", self.farads))
        settle(
            self, "initial_voltage", checked_number(f"initial_voltage of {self.name}", self.initial_voltage)
        )

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from plus to minus."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the voltage is the state."""
        return (total(voltage(self.plus, self.minus), {("state", self.name): rational(-1)}),)

    @property
    def force(self) -> Row:
        """The current, which is the derivative of the stored charge."""
        return current(self.name)


@dataclass(frozen=True, slots=True)
class Inductor:
    """henries i' = v, its current i a state that starts at initial_current."""

    name: str
    plus: str
    minus: str
    henries: Number
    initial_current: Number = 0

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        settle(self, "henries", checked_positive(f"henries of {self.name}", self.henries))
        settle(
            self, "initial_current", checked_number(f"initial_current of {self.name}", self.initial_current)
        )

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from plus to minus."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: the current is the state."""
        return (total(current(self.name), {("state", self.name): rational(-1)}),)

    @property
    def force(self) -> Row:
        """The voltage, which is the derivative of the stored flux."""
        return voltage(self.plus, self.minus)


@dataclass(frozen=True, slots=True)
class Coupling:
    """Two coupled inductors: mutual inductance coefficient sqrt(L1 L2), |coefficient| < 1."""

    name: str
    first: str
    second: str
    coefficient: Number

    def __post_init__(self) -> None:
        checked_words("name", self.name)
        field = f"coefficient of {self.name}"
        checked_words(f"inductors of {self.name}", self.first, self.second)
        settle(self, "coefficient", checked_number(field, self.coefficient))
        if not (-1 < self.coefficient < 1) or self.coefficient == 0:
            remedy = "between -1 and 1, and not 0; perfect coupling is an ideal transformer"
            raise InvalidInputError(field, self.coefficient, remedy)
        if self.first == self.second:
            raise InvalidInputError(f"inductors of {self.name}", self.first, "two different inductors")

    @property
    def branches(self) -> tuple[Branch, ...]:
        """No branch: the coupling carries no current of its own."""
        return ()

    @property
    def equations(self) -> tuple[Row, ...]:
        """No rows: the coupling is part of the inductance matrix."""
        return ()


@dataclass(frozen=True, slots=True)
class Diode:
    """A diode: 0 <= i _|_ v(cathode) - v(anode) + forward_voltage + resistance i >= 0, i from anode to cathode."""

    name: str
    anode: str
    cathode: str
    forward_voltage: Number = 0
    resistance: Number = 0

    def __post_init__(self) -> None:
        checked_ends(self.name, self.anode, self.cathode)
        for name in ("forward_voltage", "resistance"):
            settle(self, name, checked_nonnegative(f"{name} of {self.name}", getattr(self, name)))

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from the anode to the cathode."""
        return (Branch(self.name, self.anode, self.cathode),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row, which names the reverse voltage; the complementarity condition does the rest."""
        drop = constant(self.forward_voltage) if self.forward_voltage else {}
        slope = current(self.name, rational(self.resistance)) if self.resistance else {}
        reverse: Row = {("reverse", self.name): rational(-1)}
        return (total(voltage(self.cathode, self.anode), drop, slope, reverse),)

    @property
    def pairs(self) -> tuple[str, ...]:
        """One complementary pair: the current and the reverse voltage."""
        return (self.name,)


@dataclass(frozen=True, slots=True)
class Transformer:
    """An ideal transformer: v(primary) = ratio v(secondary), i(secondary) = -ratio i(primary)."""

    name: str
    primary_plus: str
    primary_minus: str
    secondary_plus: str
    secondary_minus: str
    ratio: Number

    def __post_init__(self) -> None:
        checked_words("name", self.name)
        checked_ends(f"the primary of {self.name}", self.primary_plus, self.primary_minus)
        checked_ends(f"the secondary of {self.name}", self.secondary_plus, self.secondary_minus)
        settle(self, "ratio", checked_number(f"ratio of {self.name}", self.ratio))
        if -SMALLEST < self.ratio < SMALLEST:
            allowed = f"a number other than zero, of a size of at least {SMALLEST:g}"
            raise InvalidInputError(f"ratio of {self.name}", self.ratio, allowed)

    @property
    def branches(self) -> tuple[Branch, ...]:
        """The primary, NAME.primary, and the secondary, NAME.secondary."""
        return (
            Branch(f"{self.name}.primary", self.primary_plus, self.primary_minus),
            Branch(f"{self.name}.secondary", self.secondary_plus, self.secondary_minus),
        )

    @property
    def equations(self) -> tuple[Row, ...]:
        """Two rows, one for the voltages and one for the currents."""
        primary, secondary = self.branches
        ratio = rational(self.ratio)
        return (
            total(voltage(primary.plus, primary.minus), voltage(secondary.plus, secondary.minus, -ratio)),
            total(current(secondary.name), current(primary.name, ratio)),
        )
