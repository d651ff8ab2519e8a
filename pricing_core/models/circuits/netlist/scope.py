"""Parameters of a netlist and of its subcircuits, evaluated when they are asked for."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.netlist.expressions import evaluate
from pricing_core.models.circuits.netlist.lines import Line

_NAME = re.compile(r"([A-Za-z_]\w*)\s*=(?!=)", re.ASCII)


@dataclass(slots=True)
class Scope:
    """Parameters by name, in lower case, which may name each other in any order, and those around them.

    Parameters
    ----------
    texts : mapping
        Their expressions, with the lines that they are in.
    around : Scope, optional
        Where names that are not here are looked for.
    given : mapping
        Values that are known already, which go first.
    """

    texts: Mapping[str, tuple[Line, str]]
    around: Scope | None = None
    given: Mapping[str, Fraction] = field(default_factory=dict)
    _known: dict[str, Fraction] = field(default_factory=dict, init=False)
    _open: set[str] = field(default_factory=set, init=False)

    def lookup(self, name: str) -> Fraction | None:
        """Return the value of a parameter, None where there is none."""
        if name in self.given:
            return self.given[name]
        if name not in self.texts:
            return None if self.around is None else self.around.lookup(name)
        if name not in self._known:
            line, text = self.texts[name]
            if name in self._open:
                raise line.fault(f"free of circles: {name} is defined by itself")
            self._open.add(name)
            self._known[name] = evaluate(f"{line.field}: {name}", text, self.lookup)
            self._open.discard(name)
        return self._known[name]


def parameters_of(line: Line, text: str) -> dict[str, tuple[Line, str]]:
    """Return the parameters that a text defines, NAME=expression one after the other.

    Examples
    --------
    >>> line = Line(1, ".param a=2 b = {a * 3} c='a+b'")
    >>> {name: text for name, (_, text) in parameters_of(line, line.text[6:]).items()}
    {'a': '2', 'b': 'a * 3', 'c': 'a+b'}
    """
    line.check_enclosed()
    found: dict[str, tuple[Line, str]] = {}
    starts = list(_NAME.finditer(text))
    if not starts or text[: starts[0].start()].strip(" \t,"):
        raise line.fault("of the form .param NAME=expression ...")
    for match, following in zip(starts, [*starts[1:], None], strict=True):
        expression = text[match.end() : None if following is None else following.start()].strip(" \t,")
        if expression[:1] in ("{", "'", '"'):
            expression = expression[1:].rstrip("}'\"")
        name = match[1].lower()
        if name in found:
            raise line.fault(f"with one value of {match[1]}")
        found[name] = line, expression
    return found


def merged(parts: list[dict[str, tuple[Line, str]]]) -> dict[str, tuple[Line, str]]:
    """Return all parameters together; one that is defined twice is an error."""
    found: dict[str, tuple[Line, str]] = {}
    for part in parts:
        for name, (line, text) in part.items():
            if name in found:
                raise InvalidInputError(line.field, name, f"defined once: {found[name][0].field} defines it")
            found[name] = line, text
    return found
