"""What the graph of a netlist must satisfy before its equations are written down."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pricing_core.errors import InvalidInputError, Told
from pricing_core.models.circuits.elements import Branch, Coupling, Element, Inductor
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.forest import Forest
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)
from pricing_core.models.circuits.switches import SwitchAt, Threshold


def check_topology(elements: Sequence[Element]) -> None:
    """Refuse a netlist without ground, with a floating node, or with sources that contradict each other.

    Raises
    ------
    InvalidInputError
        It names the element or the node, and the remedy.
    """
    branches = [branch for element in elements for branch in element.branches]
    nodes = dict.fromkeys(node for branch in branches for node in (branch.plus, branch.minus))
    if not elements:
        raise InvalidInputError("circuit", Told("without elements"), "made of at least one element")
    if GROUND not in nodes:
        raise InvalidInputError("circuit", list(nodes), 'connected to the ground, which is the node "0"')
    _check_references(elements, branches, set(nodes))
    loose = _outside(nodes, branches)
    if loose is not None:
        raise InvalidInputError("node", loose, 'joined to the node "0" by some path of elements: it floats')
    _check_voltage_loops(elements)
    others = [b for element in elements if not isinstance(element, CurrentSource) for b in element.branches]
    cut = _outside(nodes, others)
    if cut is not None:
        remedy = 'joined to the node "0" by more than current sources: add a resistor beside one of them'
        raise InvalidInputError("node", cut, remedy)


def _check_references(elements: Sequence[Element], branches: Sequence[Branch], nodes: set[str]) -> None:
    names = {branch.name for branch in branches}
    for element in elements:
        control = element.switch.control if isinstance(element, SwitchAt) else None
        if isinstance(control, Threshold) and not control.minus and control.plus not in names:
            allowed = "an element of the circuit that carries a current"
            raise InvalidInputError(f"control of {element.name}", control.plus, allowed)
        for node in (control.plus, control.minus) if isinstance(control, Threshold) and control.minus else ():
            if node not in nodes:
                raise InvalidInputError(f"control of {element.name}", node, "a node of the circuit")
    inductors = {element.name for element in elements if isinstance(element, Inductor)}
    for element in elements:
        if isinstance(element, VoltageControlled):
            for node in (element.control_plus, element.control_minus):
                if node not in nodes:
                    raise InvalidInputError(f"control of {element.name}", node, "a node of the circuit")
        if isinstance(element, CurrentControlled) and element.control not in names:
            allowed = "an element of the circuit that carries a current"
            raise InvalidInputError(f"control of {element.name}", element.control, allowed)
        if isinstance(element, Coupling):
            for name in (element.first, element.second):
                if name not in inductors:
                    raise InvalidInputError(
                        f"inductors of {element.name}", name, "an inductor of the circuit"
                    )


def _check_voltage_loops(elements: Sequence[Element]) -> None:
    forest = Forest()
    for element in elements:
        if isinstance(element, VoltageSource) and not forest.join(element.plus, element.minus):
            remedy = "in no loop of voltage sources alone: put a resistor in series"
            raise InvalidInputError("voltage source", element.name, remedy)


def _outside(nodes: Iterable[str], branches: Iterable[Branch]) -> str | None:
    """Return a node that no path of these branches joins to the ground, None if there is none."""
    forest = Forest()
    for branch in branches:
        forest.join(branch.plus, branch.minus)
    return next((node for node in nodes if forest.root(node) != forest.root(GROUND)), None)
