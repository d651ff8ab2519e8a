"""The lines of a netlist: comments, continuations, files that it includes, and the words of a card."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.netlist.expressions import evaluate
from pricing_core.models.circuits.quantity import quantity

MOST_LINES = 100_000
DEEPEST_INCLUDE = 10

_COMMENT = re.compile(r";.*|(?<!\S)\$.*")
# Expressions in braces or quotes are one word each; brackets and commas are blanks.
_ENCLOSED = re.compile(r"\{[^{}]*\}|'[^']*'|\"[^\"]*\"")
_WORD = re.compile(r"\{[^{}]*\}|'[^']*'|\"[^\"]*\"|[^\s(),={}'\"]+|=")


@dataclass(frozen=True, slots=True)
class Line:
    """A line without comments, its continuations joined.

    Parameters
    ----------
    number : int
        From 1, in its own file.
    text : str
    file : str
        The name of that, empty for the netlist itself.
    """

    number: int
    text: str
    file: str = ""

    @property
    def field(self) -> str:
        """The name of the line in error messages."""
        return f"line {self.number} of {self.file or 'the netlist'}"

    def fault(self, allowed: str) -> InvalidInputError:
        """Return the error that the line is not as allowed."""
        return InvalidInputError(self.field, self.text, allowed)

    def check_enclosed(self) -> None:
        """Refuse braces and quotes that are not closed."""
        if any(mark in _ENCLOSED.sub("", self.text) for mark in "{}'\""):
            raise self.fault("with every brace and quote closed")

    @property
    def words(self) -> tuple[str, ...]:
        """Its words, "=" among them."""
        return tuple(_WORD.findall(self.text))

    def options(self, start: int = 0) -> tuple[tuple[str, ...], dict[str, str]]:
        """Return the words from one on, and the NAME=value pairs taken off them, the names in lower case."""
        self.check_enclosed()
        words = list(self.words[start:])
        options: dict[str, str] = {}
        while "=" in words:
            place = words.index("=")
            if place == 0 or place + 1 == len(words) or words[place + 1] == "=":
                raise self.fault("of the form ... NAME=value")
            name, _, value = words[place - 1 : place + 2]
            if name.lower() in options:
                raise self.fault(f"with one value of {name}")
            options[name.lower()] = value
            del words[place - 1 : place + 2]
        return tuple(words), options


@dataclass(frozen=True, slots=True)
class Card:
    """An element of a netlist in words, with the parameters that it may name.

    Parameters
    ----------
    line : Line
    words : tuple of str
    options : dict
        NAME=value pairs, the names in lower case.
    lookup : callable
        The value of a parameter, None where there is none.
    """

    line: Line
    words: tuple[str, ...]
    options: dict[str, str]
    lookup: Callable[[str], Fraction | None]

    @property
    def field(self) -> str:
        """The name of the card in error messages."""
        return self.line.field

    def check(self, form: str, words: int, option: str = "") -> Fraction:
        """Refuse a card of another form, and return the option's value, 0 if it was left out."""
        if len(self.words) != words or not set(self.options) <= {option}:
            raise self.line.fault(f"of the form {form}")
        return self.value(self.options.get(option, "0"))

    def check_least(self, form: str, words: int) -> None:
        """Refuse a card of fewer words, or with an option."""
        if len(self.words) < words or self.options:
            raise self.line.fault(f"of the form {form}")

    def number(self, place: int) -> Fraction:
        """Return a word that must be a number, or an expression in braces or quotes."""
        return self.value(self.words[place])

    def value(self, word: str) -> Fraction:
        """Return the number that a word stands for."""
        return value_of(f"{self.field}: {self.words[0]}", word, self.lookup)


def value_of(field: str, word: str, lookup: Callable[[str], Fraction | None]) -> Fraction:
    """Return the number that a word stands for: itself, an expression in braces or quotes, or a parameter's name."""
    if word[0] in "{'\"":
        return evaluate(field, word[1:-1], lookup)
    named = lookup(word.lower())
    return quantity(field, word) if named is None else named


def card_of(line: Line, lookup: Callable[[str], Fraction | None]) -> Card:
    """Return the card that a line is."""
    words, options = line.options()
    if not words:
        raise line.fault("an element")
    return Card(line, words, options, lookup)


def read_lines(text: str, folder: Path | None) -> list[Line]:
    r"""Return the lines up to .end, without comments, continuations joined, with those of the files included.

    Parameters
    ----------
    folder : Path or None
        The folder of the netlist, whose files alone it may include; None where the netlist is no file.

    Raises
    ------
    InvalidInputError
        A + with nothing to go on from; a file that may not be included.

    Examples
    --------
    >>> read_lines("* title\nC1 a 0\n+ 1u IC = 2 ; charged\n.end\nR1", None)
    [Line(number=2, text='C1 a 0 1u IC = 2', file='')]
    """
    root = None if folder is None else folder.resolve()
    lines = []
    for line in _included(_joined(text, ""), root, root, 0):
        lines.append(line)
        if len(lines) > MOST_LINES:
            raise line.fault(f"one of at most {MOST_LINES} lines")
    return lines


def _joined(text: str, file: str) -> list[Line]:
    joined: list[Line] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = "" if raw.lstrip().startswith("*") else _COMMENT.sub("", raw).strip()
        if line.startswith("+"):
            if not joined:
                raise Line(number, line, file).fault("the continuation of another line")
            last = joined[-1]
            joined[-1] = Line(last.number, f"{last.text} {line[1:].strip()}", file)
        elif line.lower() == ".end":
            break
        elif line:
            joined.append(Line(number, line, file))
    return joined


def _included(lines: list[Line], folder: Path | None, root: Path | None, depth: int) -> Iterator[Line]:
    for line in lines:
        if line.words and line.words[0].lower() in (".include", ".inc"):
            path = _file(line, folder, root, depth)
            name = str(path.relative_to(root)) if root is not None else path.name
            try:
                text = path.read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise line.fault(f"a file that can be read: {error}") from None
            yield from _included(_joined(text, name), path.parent, root, depth + 1)
        else:
            yield line


def _file(line: Line, folder: Path | None, root: Path | None, depth: int) -> Path:
    if folder is None or root is None:
        raise line.fault("left out: only a netlist that is a file itself includes others (from_netlist_file)")
    if depth >= DEEPEST_INCLUDE:
        raise line.fault(f"one of at most {DEEPEST_INCLUDE} files inside each other")
    if len(line.words) != 2:
        raise line.fault('of the form .include "FILE"')
    given = Path(line.words[1].strip("\"'{}"))
    path = (folder / given).resolve()
    if given.is_absolute() or not path.is_relative_to(root):
        raise line.fault("a relative path inside the folder of the netlist")
    return path
