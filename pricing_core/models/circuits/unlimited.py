"""Ideal sources that ideal diodes short or cut off: nothing limits their current or voltage."""

from __future__ import annotations

from collections.abc import Sequence

from pricing_core.models.circuits.elements import Branch, Diode, Element
from pricing_core.models.circuits.forest import Forest
from pricing_core.models.circuits.sources import (
    CurrentControlled,
    CurrentSource,
    VoltageControlled,
    VoltageSource,
)
from pricing_core.models.circuits.switches import SwitchAt


def unlimited(elements: Sequence[Element]) -> str | None:
    """Return what may be wrong with a circuit that has no continuation, None where that is not the reason.

    Examples
    --------
    >>> unlimited([VoltageSource("V1", "a", "0", 5), Diode("D1", "a", "0")])
    'V1, D1 are a loop of voltage sources and diodes that nothing limits the current of; put a resistor in series'
    """
    diodes = {element.name for element in elements if isinstance(element, Diode) and not element.resistance}
    branches = [branch for element in elements for branch in element.branches]
    voltages = {element.name for element in elements if _is_source(element, of_voltage=True)}
    shorts = {e.name for e in elements if isinstance(e, SwitchAt) and e.closed and not e.switch.resistance}
    inside = [branch for branch in branches if branch.name in diodes | voltages | shorts]
    loops = [branch.name for branch in inside if _connected(branch, [b for b in inside if b is not branch])]
    if diodes.intersection(loops) and voltages.intersection(loops):
        what = "a loop of voltage sources and diodes that nothing limits the current of; put a resistor in series"
        return f"{', '.join(loops)} are {what}"
    currents = {element.name for element in elements if _is_source(element, of_voltage=False)}
    diodes = {element.name for element in elements if isinstance(element, Diode)}
    opened = {
        e.name for e in elements if isinstance(e, SwitchAt) and not e.closed and not e.switch.off_resistance
    }
    outside = [branch for branch in branches if branch.name not in diodes | currents | opened]
    cuts = [b.name for b in branches if b.name in diodes | currents and not _connected(b, outside)]
    if diodes.intersection(cuts) and currents.intersection(cuts):
        what = "a cut-set of current sources and diodes that nothing limits the voltage of; put a resistor beside one"
        return f"{', '.join(cuts)} are {what}"
    return None


def _is_source(element: Element, *, of_voltage: bool) -> bool:
    if isinstance(element, VoltageControlled | CurrentControlled):
        return element.of_voltage == of_voltage
    return isinstance(element, VoltageSource if of_voltage else CurrentSource)


def _connected(branch: Branch, others: Sequence[Branch]) -> bool:
    """Tell whether other branches join the ends of a branch."""
    forest = Forest()
    for other in others:
        forest.join(other.plus, other.minus)
    return forest.root(branch.plus) == forest.root(branch.minus)
