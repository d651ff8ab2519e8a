"""A reader for netlists: what of SPICE's language a circuit of linear elements, diodes and switches needs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

from pricing_core.errors import InvalidInputError, Told
from pricing_core.models.circuits.elements import Capacitor, Element, Inductor
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.netlist.element_readers import READERS, element_of
from pricing_core.models.circuits.netlist.lines import Line, read_lines, value_of
from pricing_core.models.circuits.netlist.models import CURRENT, DIODE_CURRENT
from pricing_core.models.circuits.netlist.scope import Scope, merged
from pricing_core.models.circuits.netlist.subcircuits import Expansion, Structure, structure_of
from pricing_core.models.circuits.quantity import quantity

IGNORED = (
    ".title",
    ".options",
    ".option",
    ".print",
    ".plot",
    ".probe",
    ".save",
    ".temp",
    ".global",
    ".backanno",
)


@dataclass(slots=True)
class Netlist:
    """What a netlist states.

    Parameters
    ----------
    elements : tuple of Element
    t_span : (float, float) or None
        From .tran, in seconds.
    notes : list of str
        What was read otherwise than SPICE does, or left out.
    """

    elements: tuple[Element, ...] = ()
    t_span: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)


def read_netlist(text: str, folder: Path | None = None) -> Netlist:
    """Return what a netlist states; see `DiodeCircuit.from_netlist` for what it may contain.

    In a file line 1 is the title, as in SPICE. In a text the first line may also be an element: it is the title where
    it cannot be read as one.

    Parameters
    ----------
    text : str
    folder : Path, optional
        Where the file is, for those that it includes; None where the netlist is no file.

    Examples
    --------
    >>> read_netlist("C1 out gnd 10u IC=5 ; charged").elements
    (Capacitor(name='C1', plus='out', minus='0', farads=Fraction(1, 100000), initial_voltage=Fraction(5, 1)),)
    """
    if not isinstance(text, str):
        raise InvalidInputError("netlist", text, "a text")
    found = _read_text(text) if folder is None else _read_file(text, folder)
    if not found.elements:
        allowed = "a title and below it at least one element, such as R1 in 0 1k"
        raise InvalidInputError("netlist", Told("without elements"), allowed)
    return found


def _read_file(text: str, folder: Path) -> Netlist:
    title, *rest = text.splitlines() or [""]
    found = _read(read_lines("\n".join(["", *rest]), folder))
    if title.strip() and not title.lstrip().startswith("*"):
        found.notes.insert(0, f"line 1 of the netlist is the title: {title.strip()}")
    return found


def _read_text(text: str) -> Netlist:
    lines = read_lines(text, None)
    top = next((number for number, line in enumerate(text.splitlines(), start=1) if line.strip()), 0)
    if not lines or lines[0].number != top:  # a comment is the title
        return _read(lines)
    first = lines[0]
    try:
        found, taken = _read(lines), "is read as part of the circuit, where SPICE has the title"
    except InvalidInputError as fault:
        if not (fault.field.split(":")[0] == first.field and _may_be_title(first)):
            raise
        found, taken = _read(lines[1:]), "is taken for the title"
    found.notes.insert(0, f"{first.field} {taken}: {first.text}")
    return found


def _read(lines: list[Line]) -> Netlist:
    found = Netlist()
    structure = structure_of(lines)
    scope = Scope(merged(structure.top.parameters))
    expansion = Expansion(structure, _diode_current(structure, scope), found.notes)
    cards = list(expansion.cards())
    for card, place in cards:
        expansion.names.take(card, place.prefix + card.words[0])
    elements = [element_of(card, place) for card, place in cards]
    initial = _controls(structure, scope, found)
    found.elements = tuple(_with_initial(elements, initial, expansion, found.notes))
    return found


def _may_be_title(line: Line) -> bool:
    """Tell whether a first line that cannot be read is no card: its name has no digit, and no value ends it."""
    word, last = line.words[0], line.words[-1]
    if word[0].upper() not in READERS:
        return word[0].isalpha()
    if any(character.isdigit() for character in word) or "=" in line.words or last[0] in "{'\"":
        return False
    try:
        quantity(line.field, last)
    except InvalidInputError:
        return True
    return False


def _diode_current(structure: Structure, scope: Scope) -> Fraction:
    current = CURRENT
    for line in structure.controls:
        if line.words[0].lower() in (".options", ".option") and DIODE_CURRENT in line.text.lower():
            options = line.options(1)[1]
            if DIODE_CURRENT in options:
                current = value_of(f"{line.field}: {DIODE_CURRENT}", options[DIODE_CURRENT], scope.lookup)
                if current <= 0:
                    raise line.fault(f"a positive {DIODE_CURRENT} in amperes")
    return current


def _controls(structure: Structure, scope: Scope, found: Netlist) -> dict[str, Fraction]:
    """Read .tran, note what is left out, and return the initial values by "v(node)" and "i(element)"."""
    initial: dict[str, Fraction] = {}
    for line in structure.controls:
        word = line.words[0].lower()
        if word == ".tran":
            found.t_span = _transient(line, scope, found.notes)
        elif word == ".ic":
            initial |= _initial(line, scope)
        elif word in IGNORED:
            if word != ".title":
                found.notes.append(f"{line.field} is left out: {line.text}")
        else:
            allowed = ".param, .model, .subckt, .ends, .include, .ic, .tran, .options, .print, .title or .end"
            raise line.fault(f"one of {allowed}")
    return initial


def _transient(line: Line, scope: Scope, notes: list[str]) -> tuple[float, float]:
    form = "of the form .tran step stop [start [longest step]] [UIC], with 0 <= start < stop"
    words = list(line.words[1:])
    uic = bool(words) and words[-1].lower() == "uic"
    numbers = [
        float(value_of(f"{line.field}: .tran", word, scope.lookup)) for word in (words[:-1] if uic else words)
    ]
    if not 2 <= len(numbers) <= 4:
        raise line.fault(form)
    start = numbers[2] if len(numbers) > 2 else 0.0
    if not 0.0 <= start < numbers[1]:
        raise line.fault(form)
    if not uic:
        notes.append(
            f"{line.field}: the run starts from the initial values, as with UIC, not from an operating point"
        )
    notes.append(f"{line.field}: steps are chosen by the method")
    return 0.0, numbers[1]


def _initial(line: Line, scope: Scope) -> dict[str, Fraction]:
    words, found = line.words[1:], {}
    if not words or len(words) % 4:
        raise line.fault("of the form .ic v(node)=volts ... i(inductor)=amperes ...")
    for kind, name, equals, value in zip(words[::4], words[1::4], words[2::4], words[3::4], strict=True):
        if kind.lower() not in ("v", "i") or equals != "=":
            raise line.fault("of the form .ic v(node)=volts ... i(inductor)=amperes ...")
        key = f"{kind.lower()}({name.lower()})"
        found[key] = value_of(f"{line.field}: {key}", value, scope.lookup)
    return found


def _with_initial(
    elements: list[Element], initial: dict[str, Fraction], expansion: Expansion, notes: list[str]
) -> list[Element]:
    """Return the elements with the voltages and currents of .ic where they have none of their own."""
    if not initial:
        return elements
    volts = {GROUND: Fraction(0)}
    used: set[str] = set()
    for key, value in initial.items():
        if key[0] == "v":
            node = GROUND if key == "v(gnd)" else expansion.names.nodes.get(key[2:-1], key[2:-1])
            volts[node] = value
    found: list[Element] = []
    for element in elements:
        key = f"i({element.name.lower()})"
        if isinstance(element, Capacitor) and {element.plus, element.minus} <= volts.keys():
            used |= {f"v({node.lower()})" for node in (element.plus, element.minus)}
            own = element.initial_voltage or volts[element.plus] - volts[element.minus]
            found.append(replace(element, initial_voltage=own))
        elif isinstance(element, Inductor) and key in initial:
            used.add(key)
            found.append(replace(element, initial_current=initial[key]))
        else:
            found.append(element)
    for key in initial:
        if key not in used and key not in ("v(0)", "v(gnd)"):
            notes.append(f".ic {key} has no effect: it sets no capacitor's voltage and no inductor's current")
    return found
