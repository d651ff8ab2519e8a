"""One input of the option engine: its name, kind, unit, limits, default, meaning and an example."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from pricing_core.american.contracts.checks import alternatives, range_in_words, real_number
from pricing_core.errors import InvalidInputError

Kind: TypeAlias = Literal["number", "choice", "curve", "list", "date", "time", "flag"]
REQUIRED: Any = object()  # The mark of a field without a default.
UNLIMITED = (-math.inf, math.inf)
CURVE_IN_WORDS = '{"times": [...], "values": [...]}'


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """One input, as users state it.

    Parameters
    ----------
    name : str
        The same in Python, tables, JSON and, with hyphens, on the command line.
    kind : {"number", "choice", "curve", "list", "date", "time", "flag"}
        A curve may be a number too, a time may be a date where there is a valuation date.
    unit : str
        Empty for a choice.
    meaning : str
        One line without the unit.
    limits : (float, float)
        Smallest and largest value, both allowed, of a number; of each number in a list; of each value of a curve.
    choices : tuple of str
        Texts that a choice may be.
    entries : tuple of Field
        What each entry of a list holds, or a curve that is no number.
    most_entries : int
        Largest length of a list.
    default : object
        REQUIRED where there is none; None where nothing takes the place of a value that is not given.
    example : object
    """

    name: str
    kind: Kind
    unit: str
    meaning: str
    limits: tuple[float, float] = UNLIMITED
    choices: tuple[str, ...] = ()
    entries: tuple[Field, ...] = ()
    most_entries: int = 0
    default: Any = REQUIRED
    example: Any = None

    @property
    def least(self) -> float:
        """Smallest number allowed."""
        return self.limits[0]

    @property
    def most(self) -> float:
        """Largest number allowed."""
        return self.limits[1]

    @property
    def required(self) -> bool:
        """Whether there is no default."""
        return self.default is REQUIRED

    @property
    def description(self) -> str:
        """One sentence, the unit included."""
        return f"{self.meaning} ({self.unit})." if self.unit else f"{self.meaning}."

    @property
    def in_brief(self) -> str:
        """The unit, or the choices."""
        return alternatives(self.choices) if self.choices else self.unit

    @property
    def allowed(self) -> str:
        """What the value must be, completing "must be ..."."""
        if self.kind == "choice":
            return alternatives([f'"{choice}"' for choice in self.choices])
        if self.kind == "curve":
            return f"a number or {CURVE_IN_WORDS}"
        if self.kind != "list":
            return range_in_words(*self.limits)
        keys = ", ".join(f'"{entry.name}": ...' for entry in self.entries if entry.required)
        return f"a list of {{{keys}}}" if keys else "a list of times"

    def check(self, value: object, place: str = "") -> float:
        """Return `value` as a float if it is a number within the limits.

        Parameters
        ----------
        place : str
            What the message calls the value, by default the name of the field.

        Raises
        ------
        InvalidInputError
            It is not; the message names the range.
        """
        return real_number(place or self.name, value, *self.limits)

    def check_choice(self, value: object) -> None:
        """Accept one of the choices.

        Raises
        ------
        InvalidInputError
            It is none of them; the message names them all.
        """
        if not (isinstance(value, str) and value in self.choices):
            raise InvalidInputError(self.name, value, self.allowed)
