"""The energy that jumps dissipate, where a storage function is known."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pricing_core.lcs.passivity import passivity
from pricing_core.lcs.rational_system import EXACT_SIZE
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Event


def with_energy_lost(system: LCS, events: Iterable[Event]) -> tuple[Event, ...]:
    """Return the events, jumps with x^T Q x / 2 before less after, if Q shows that the system is passive (11.6).

    Q is that of `passivity`; where the system has several storage functions this is one of them. None is looked for
    beyond the size for which passivity is verified.
    """
    noted = tuple(events)
    if sum(system.shape) > EXACT_SIZE or all(event.kind != "jump" for event in noted):
        return noted
    Q = passivity(system).storage
    if Q is None:
        return noted
    return tuple(
        replace(
            event,
            energy_lost=0.5 * float(event.x_before @ Q @ event.x_before - event.x_after @ Q @ event.x_after),
        )
        if event.kind == "jump"
        else event
        for event in noted
    )
