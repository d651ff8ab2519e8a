"""The structure of a netlist: what it defines, its subcircuits, and the cards of all their instances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.netlist.lines import Card, Line, card_of, value_of
from pricing_core.models.circuits.netlist.models import DiodeModel, SwitchModel, read_model
from pricing_core.models.circuits.netlist.scope import Scope, merged, parameters_of

DEEPEST = 20  # instances inside each other
MOST_CARDS = 20_000


@dataclass(slots=True)
class Block:
    """What lies between .subckt and .ends, or outside all of them.

    Parameters
    ----------
    name : str
    ports : tuple of str
        In lower case.
    cards : list of Line
        Elements and instances.
    parameters, models : list
        What it defines, for itself and for what is inside.
    """

    name: str = ""
    ports: tuple[str, ...] = ()
    cards: list[Line] = field(default_factory=list)
    parameters: list[dict[str, tuple[Line, str]]] = field(default_factory=list)
    models: list[Line] = field(default_factory=list)


@dataclass(slots=True)
class Structure:
    """A netlist before its instances are put in.

    Parameters
    ----------
    top : Block
    subcircuits : dict
        By name, in lower case.
    controls : list of Line
        Lines that begin with a dot, but for those of the structure.
    """

    top: Block = field(default_factory=Block)
    subcircuits: dict[str, Block] = field(default_factory=dict)
    controls: list[Line] = field(default_factory=list)


def structure_of(lines: list[Line]) -> Structure:
    """Return the structure of the lines.

    Raises
    ------
    InvalidInputError
        A subcircuit without end, inside another, or defined twice.
    """
    found = Structure()
    block, opened = found.top, None
    for line in lines:
        word = line.words[0].lower() if line.words else ""
        if word == ".subckt":
            if opened is not None:
                raise line.fault(f"outside the subcircuit that {opened.field} begins")
            block, opened = _subcircuit(line), line
            if block.name in found.subcircuits:
                raise line.fault("a subcircuit of a name of its own")
            found.subcircuits[block.name] = block
        elif word == ".ends":
            if opened is None:
                raise line.fault("the end of a subcircuit: none is open")
            block, opened = found.top, None
        elif word == ".param":
            block.parameters.append(parameters_of(line, line.text[len(word) :]))
        elif word == ".model":
            block.models.append(line)
        elif word.startswith("."):
            if opened is not None:
                raise line.fault("outside of subcircuits")
            found.controls.append(line)
        else:
            block.cards.append(line)
    if opened is not None:
        raise opened.fault("a subcircuit that .ends ends")
    return found


def _subcircuit(line: Line) -> Block:
    words, options = line.options(1)
    words = tuple(word for word in words if word.lower() != "params:")
    if len(words) < 2:
        raise line.fault("of the form .subckt NAME node ... [NAME=value ...]")
    ports = tuple(word.lower() for word in words[1:])
    if len(set(ports)) != len(ports) or {"0", "gnd"}.intersection(ports):
        raise line.fault("a subcircuit whose nodes differ from each other and from the ground")
    defaults = {name: (line, text.strip("{}'\"")) for name, text in options.items()}
    return Block(words[0].lower(), ports, parameters=[defaults] if defaults else [])


@dataclass(slots=True)
class Place:
    """Where a card stands: in which instance, and what its names mean there.

    Parameters
    ----------
    prefix : str
        Prefix of the names of elements and nodes inside, such as "X1.".
    ports : dict
        Names of the nodes that come from outside.
    scope : Scope
    models : dict
        Those that may be named here.
    names : Names
        The spellings that came first.
    """

    prefix: str
    ports: dict[str, str]
    scope: Scope
    models: dict[str, DiodeModel | SwitchModel]
    names: Names

    def node(self, text: str) -> str:
        """Return the node that a word means here."""
        name = text.lower()
        if name in ("0", "gnd"):
            return GROUND
        return self.ports[name] if name in self.ports else self.names.node(self.prefix + text)

    def element(self, text: str) -> str:
        """Return the element that a word means here."""
        return self.names.elements.get((self.prefix + text).lower(), self.prefix + text)


@dataclass(slots=True)
class Names:
    """The spelling that came first of names that differ in case only."""

    nodes: dict[str, str] = field(default_factory=dict)
    elements: dict[str, str] = field(default_factory=dict)

    def node(self, text: str) -> str:
        """Return the node's first spelling."""
        return self.nodes.setdefault(text.lower(), text)

    def take(self, card: Card, text: str) -> None:
        """Note the name of an element, or refuse one that is taken."""
        if text.lower() in self.elements:
            raise InvalidInputError(card.field, text, "a name that no other element has")
        self.elements[text.lower()] = text


@dataclass(slots=True)
class Expansion:
    """The cards of all instances, one after the other."""

    structure: Structure
    current: Fraction  # at which the drops of diodes are taken
    notes: list[str]
    names: Names = field(default_factory=Names)
    count: int = 0

    def cards(self) -> Iterator[tuple[Card, Place]]:
        """Yield all cards with their places."""
        top = self.structure.top
        place = Place("", {}, Scope(merged(top.parameters)), {}, self.names)
        yield from self._of(top, place, ())

    def _of(self, block: Block, place: Place, inside: tuple[str, ...]) -> Iterator[tuple[Card, Place]]:
        for line in block.models:
            name, model = read_model(line, place.scope.lookup, self.current, self.notes)
            place.models[name] = model
        for line in block.cards:
            card = card_of(line, place.scope.lookup)
            self.count += 1
            if self.count > MOST_CARDS:
                raise line.fault(f"one of at most {MOST_CARDS} elements, instances put in")
            called = card.words[-1].lower()
            if card.words[0][0].upper() == "X" and called in self.structure.subcircuits:
                yield from self._instance(card, place, inside)
            else:
                yield card, place

    def _instance(self, card: Card, place: Place, inside: tuple[str, ...]) -> Iterator[tuple[Card, Place]]:
        block = self.structure.subcircuits[card.words[-1].lower()]
        nodes = tuple(word for word in card.words[1:-1] if word.lower() != "params:")
        if len(nodes) != len(block.ports):
            raise card.line.fault(f"an instance of {block.name} with {len(block.ports)} nodes")
        if block.name in inside or len(inside) >= DEEPEST:
            raise card.line.fault(
                f"an instance of no subcircuit that it is inside, and at most {DEEPEST} deep"
            )
        texts = merged(block.parameters)
        for name in card.options:
            if name not in texts:
                raise card.line.fault(f"an instance of {block.name}, which has no parameter {name}")
        given = {
            name: value_of(f"{card.field}: {name}", text, card.lookup) for name, text in card.options.items()
        }
        outer = place
        while outer.scope.around is not None:  # what a subcircuit does not define is that of the netlist
            outer = Place("", {}, outer.scope.around, outer.models, self.names)
        inner = Place(
            f"{place.prefix}{card.words[0]}.",
            {port: place.node(node) for port, node in zip(block.ports, nodes, strict=True)},
            Scope(texts, outer.scope, given),
            dict(place.models),
            self.names,
        )
        yield from self._of(block, inner, (*inside, block.name))
