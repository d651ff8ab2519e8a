"""A two-terminal element whose voltage and current lie on a piecewise linear characteristic."""

from __future__ import annotations

from dataclasses import dataclass

from pricing_core.errors import InvalidInputError, Told
from pricing_core.linalg.rational import rational
from pricing_core.models.characteristic import Characteristic
from pricing_core.models.circuits.checked import checked_ends
from pricing_core.models.circuits.elements import Branch
from pricing_core.models.circuits.equations import Row, constant, current, total, voltage


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearResistor:
    """(v, i) on a piecewise linear curve: v from plus to minus, i through the element.

    With m points there are m pairs w_j, z_j: the curve is entered from its left ray at w_1 = 0, z_j is the way along
    the piece that begins at point j, and w_{j+1} is what is left of that piece (11.34).

    Examples
    --------
    A Zener diode of 5 V, without resistance in either direction:

    >>> curve = Characteristic([(-5, 0), (0, 0)], left_slope=float("inf"), right_slope=float("inf"))
    >>> NonlinearResistor("Z1", "a", "0", curve).pairs
    ('Z1.1', 'Z1.2')
    """

    name: str
    plus: str
    minus: str
    characteristic: Characteristic

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        if not isinstance(self.characteristic, Characteristic):
            field, value = f"characteristic of {self.name}", Told(type(self.characteristic).__name__)
            raise InvalidInputError(field, value, "a Characteristic of points (volts, amperes)")

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from plus to minus."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def pairs(self) -> tuple[str, ...]:
        """One complementary pair for each point of the curve."""
        return tuple(f"{self.name}.{j + 1}" for j in range(len(self.characteristic.points)))

    @property
    def equations(self) -> tuple[Row, ...]:
        """The point on the curve, and what is left of each of its pieces."""
        curve, pairs = self.characteristic, self.pairs
        rows = []
        for axis, value in enumerate((voltage(self.plus, self.minus), current(self.name))):
            along = [
                current(pair, -rational(tangent))
                for pair, tangent in zip(pairs, curve.tangents[1:, axis].tolist(), strict=True)
            ]
            left: Row = {("reverse", pairs[0]): rational(float(curve.tangents[0, axis]))}
            rows.append(total(value, constant(-float(curve.points[0, axis])), left, *along))
        for before, after, length in zip(pairs, pairs[1:], curve.lengths.tolist(), strict=False):
            rows.append(total(current(before), {("reverse", after): rational(1)}, constant(-length)))
        return tuple(rows)
