"""Switches that a source drives directly act by the clock: when they do is known before the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pricing_core.lcs import Exosystem
from pricing_core.models.circuits.elements import Element
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.sources import VoltageControlled, VoltageSource
from pricing_core.models.circuits.switches import Pulse, Switch, Threshold


def with_clocks(elements: Sequence[Element]) -> list[Element]:
    """Return the elements, each switch that a periodic polyline drives with the clock that this is.

    Examples
    --------
    >>> from pricing_core.lcs import pulses
    >>> gate = VoltageSource("VG", "g", "0", pulses(0.0, 5.0, period=10.0, width=4.0, rise=1.0, fall=1.0))
    >>> with_clocks([gate, Switch("S1", "a", "0", ("g", "0", 2.5, 0.5))])[1].control
    Pulse(period=10.0, width=5.0, delay=0.6)
    """
    sources = {(e.plus, e.minus): e.value for e in elements if isinstance(e, VoltageSource)}
    found: list[Element] = []
    for element in elements:
        control = element.control if isinstance(element, Switch) else None
        if isinstance(element, Switch) and isinstance(control, Threshold):
            signal = sources.get((control.plus, control.minus))
            clock = _clock(control, signal) if isinstance(signal, Exosystem) else None
            found.append(element if clock is None else replace(element, control=clock))
        else:
            found.append(element)
    return found


def without_effect(elements: Sequence[Element]) -> set[str]:
    """Return the voltage sources that carry no current, and whose voltages nothing asks for."""
    ends = Counter(node for e in elements for b in e.branches for node in (b.plus, b.minus))
    asked: set[str] = set()
    for element in elements:
        if isinstance(element, VoltageControlled):
            asked |= {element.control_plus, element.control_minus}
        if isinstance(element, Switch) and isinstance(element.control, Threshold):
            asked |= {element.control.plus, element.control.minus}
    return {
        e.name
        for e in elements
        if isinstance(e, VoltageSource)
        and any(node != GROUND and ends[node] == 1 and node not in asked for node in (e.plus, e.minus))
    }


def _clock(control: Threshold, signal: Exosystem) -> Pulse | None:
    """Return the clock where the signal closes and opens the switch once in every period, from an open start."""
    times, period = signal.times, signal.period
    if period is None or (signal.states @ np.linalg.matrix_power(signal.generator, 2).T).any():
        return None
    high = float(control.threshold) + float(control.hysteresis)
    low = float(control.threshold) - float(control.hysteresis)
    slopes = (signal.states @ signal.generator.T @ signal.output.T).ravel()
    values = (signal.states @ signal.output.T).ravel()
    if values[0] >= low or slopes[0] != 0.0:
        return None
    changes: list[float] = []
    for start, end, value, slope in zip(
        times[1:], [*times[2:], times[1] + period], values[1:], slopes[1:], strict=True
    ):
        is_open = len(changes) % 2 == 0
        level, sign = (high, 1.0) if is_open else (low, -1.0)
        if sign * (value - level) > 0.0:
            changes.append(float(start))
        elif sign * (value + slope * (end - start) - level) > 0.0:
            changes.append(float(start + (level - value) / slope))
    if len(changes) != 2:
        return None
    return Pulse(period, changes[1] - changes[0], changes[0])
