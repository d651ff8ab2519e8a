"""One input of the option engine: its name, kind, unit, limits, default, meaning and an example."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from pricing_core.american.contracts.checks import range_in_words, real_number
from pricing_core.errors import InvalidInputError, enumerated

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
        Words that a choice may be; they are understood in any case, and with blanks around them.
    short_forms : tuple of (str, str)
        Further words, in lower case, and what each stands for.
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
    short_forms: tuple[tuple[str, str], ...] = ()
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
        return enumerated(self.choices, "or") if self.choices else self.unit

    @property
    def allowed(self) -> str:
        """What the value must be, completing "must be ..."."""
        if self.kind == "choice":
            return enumerated([f'"{choice}"' for choice in self.choices], "or")
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

    def word(self, value: object) -> str | None:
        """Return the choice that a text means; None where it means none.

        Examples
        --------
        >>> side = Field("side", "choice", "", "", choices=("put", "call"), short_forms=(("p", "put"),))
        >>> side.word(" Put"), side.word("P"), side.word("c")
        ('put', 'put', None)
        """
        if not isinstance(value, str):
            return None
        text = value.strip().lower()
        return text if text in self.choices else dict(self.short_forms).get(text)

    def check_choice(self, value: object) -> Any:
        """Return the choice that a text means.

        Raises
        ------
        InvalidInputError
            It means none of them; the message names them all.
        """
        if isinstance(value, str) and value in self.choices:
            return value
        word = self.word(value)
        if word is None:
            raise InvalidInputError(self.name, value, self.allowed)
        return word
