"""The lines of a netlist: comments, continuations, control lines, and the words of a card."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.quantity import quantity

_COMMENT = re.compile(r";.*|(?<!\S)\$.*")
_WORD = re.compile(r"[^\s(),=]+|=")


@dataclass(frozen=True, slots=True)
class Card:
    """One element of a netlist, in words; brackets and commas are blanks, options are taken off its end.

    Parameters
    ----------
    line : int
        Its number, from 1.
    words : tuple of str
    options : dict
        NAME=value pairs, the names in lower case.
    """

    line: int
    words: tuple[str, ...]
    options: dict[str, str]

    @property
    def field(self) -> str:
        """What an error message calls it."""
        return f"line {self.line} of the netlist"

    def check(self, form: str, words: int, option: str = "") -> Fraction:
        """Refuse a card of another form, and return the option's value, 0 if it was left out."""
        if len(self.words) != words or not set(self.options) <= {option}:
            raise InvalidInputError(self.field, self._text, f"of the form {form}")
        return quantity(self.field, self.options.get(option, "0"))

    def check_least(self, form: str, words: int) -> None:
        """Refuse a card of fewer words, or with an option."""
        if len(self.words) < words or self.options:
            raise InvalidInputError(self.field, self._text, f"of the form {form}")

    def number(self, place: int) -> Fraction:
        """Return a word that must be a number."""
        return quantity(self.field, self.words[place])

    @property
    def _text(self) -> str:
        return " ".join([*self.words, *(f"{name}={value}" for name, value in self.options.items())])


def cards(text: str) -> list[Card]:
    r"""Return the cards up to .end, without comments, continuation lines joined.

    Raises
    ------
    InvalidInputError
        A control line other than .title, .model of an ideal diode, and .end; a + with nothing to go on from.

    Examples
    --------
    >>> cards("* title\nC1 a 0\n+ 1u IC = 2 ; charged\n.end\nR1")
    [Card(line=2, words=('C1', 'a', '0', '1u'), options={'ic': '2'})]
    """
    joined: list[tuple[int, str]] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = "" if raw.lstrip().startswith("*") else _COMMENT.sub("", raw).strip()
        if line.startswith("+"):
            if not joined:
                raise InvalidInputError(
                    f"line {number} of the netlist", line, "the continuation of another line"
                )
            joined[-1] = joined[-1][0], f"{joined[-1][1]} {line[1:]}"
        elif line.lower() == ".end":
            break
        elif line.startswith("."):
            _check_control(number, line)
        elif line:
            joined.append((number, line))
    return [_card(number, line) for number, line in joined]


def _check_control(number: int, line: str) -> None:
    words = [word.lower() for word in _WORD.findall(line)]
    if words[0] != ".title" and not (words[0] == ".model" and words[2:] == ["d"]):
        remedy = "left out: diodes are ideal (.model NAME D), and times are given to simulate"
        raise InvalidInputError(f"line {number} of the netlist", line, remedy)


def _card(number: int, line: str) -> Card:
    words = _WORD.findall(line)
    options: dict[str, str] = {}
    while "=" in words:
        place = words.index("=")
        if place == 0 or place + 1 == len(words):
            raise InvalidInputError(f"line {number} of the netlist", line, "of the form ... NAME=value")
        name, _, value = words[place - 1 : place + 2]
        if name.lower() in options:
            raise InvalidInputError(f"line {number} of the netlist", line, f"with one value of {name}")
        options[name.lower()] = value
        del words[place - 1 : place + 2]
    if not words:
        raise InvalidInputError(f"line {number} of the netlist", line, "an element")
    return Card(number, tuple(words), options)
