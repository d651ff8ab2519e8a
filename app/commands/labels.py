"""The names of the quantities of a simulation, and their units."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pricing_core.errors import InvalidInputError, Told


class Labels(NamedTuple):
    """What a model file calls its quantities, and the units that they are in."""

    names: Mapping[str, Sequence[str]]
    units: Mapping[str, str | Sequence[str]]

    def names_of(self, symbol: str, count: int, default: Sequence[str] | None = None) -> tuple[str, ...]:
        """Return the names of the components of one quantity; x1, x2, ... where there are none.

        Raises
        ------
        InvalidInputError
            They are not one for each component.
        """
        given = self.names.get(symbol)
        if given is None:
            return tuple(numbered(symbol, count) if default is None else default)
        return _each(f"names.{symbol}", given, count)

    def units_of(self, symbol: str, count: int, default: str | Sequence[str] = "") -> tuple[str, ...]:
        """Return the units of the components of one quantity, empty where they are not known."""
        given = self.units.get(symbol, default)
        return (given,) * count if isinstance(given, str) else _each(f"units.{symbol}", given, count)

    @property
    def time(self) -> str:
        """The unit of time, empty where it is not known."""
        unit = self.units.get("t", "")
        return unit if isinstance(unit, str) else unit[0]


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return x1, x2, ....

    Examples
    --------
    >>> numbered("x", 3)
    ('x1', 'x2', 'x3')
    """
    return tuple(f"{letter}{i + 1}" for i in range(count))


def check_different(names: Sequence[str]) -> None:
    """Raise InvalidInputError where two columns of a table would have one name."""
    seen = {"t"}
    for name in names:
        if name in seen:
            raise InvalidInputError("names", name, "different from all other names of the model")
        seen.add(name)


def _each(field: str, given: Sequence[str], count: int) -> tuple[str, ...]:
    if len(given) != count:
        raise InvalidInputError(field, Told(f"{len(given)} of them"), f"{count}, one for each component")
    return tuple(given)
