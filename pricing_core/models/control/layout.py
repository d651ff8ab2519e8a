"""The unknowns of the shooting: pieces between junctions, junction times and atoms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.lcs.system import LCS
from pricing_core.models.control.arc import Arc, arc
from pricing_core.models.control.problem import LQData
from pricing_core.models.control.structure import Contact, Structure

REACH = 4.0  # exponent that one piece may grow by
MOST_PIECES = 48
MOST_GROWTH = 600.0  # exponent of one piece beyond which floating point has no numbers


@dataclass(frozen=True, slots=True)
class Junction:
    """One junction: what its time is, which constraints touch there, and which may have an atom.

    `contact` and `side` say whose time it is; None at the horizon, whose time is given.
    """

    contact: int | None
    side: str  # "start" | "end" | "touch" | "horizon"
    touching: IndexSet
    with_atom: IndexSet


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Segments between junctions, each an arc cut into equal pieces; the last junction is the horizon."""

    arcs: tuple[Arc, ...]
    pieces: tuple[int, ...]
    junctions: tuple[Junction, ...]
    times: Vector  # (segments + 1,): 0, the junctions as guessed, the horizon


def layout(system: LCS, data: LQData, orders: tuple[int | None, ...], structure: Structure) -> Layout | None:
    """Order the junctions of a structure in time; None where an arc has no unique multiplier or grows too far."""
    T = data.horizon
    points = sorted(_points(structure, T), key=lambda point: (point[0], point[2] != "end"))
    arcs: list[Arc] = []
    modes: list[IndexSet] = []
    active = {contact.constraint for contact in structure if not contact.is_touch and contact.start <= 0.0}
    times = [0.0]
    junctions: list[Junction] = []
    known: dict[IndexSet, Arc | None] = {}
    for time, index, side in points:
        mode = tuple(sorted(active))
        flow = known.setdefault(mode, arc(system, mode))
        if flow is None:
            return None
        arcs.append(flow)
        modes.append(mode)
        i = structure[index].constraint
        active = active | {i} if side == "start" else active - {i} if side == "end" else active
        touching = (i,) if side == "touch" else ()
        smooth = {j for j in {*mode, *active, *touching} if (orders[j] or 0) > 1}
        junctions.append(Junction(index, side, touching, tuple(sorted(smooth))))
        times.append(time)
    mode = tuple(sorted(active))
    flow = known.setdefault(mode, arc(system, mode))
    if flow is None:
        return None
    arcs.append(flow)
    last = tuple(sorted(c.constraint for c in structure if c.is_touch and c.end >= T))
    junctions.append(Junction(None, "horizon", last, tuple(sorted({*mode, *last}))))
    times.append(T)
    pieces = tuple(_pieces(flow, b - a) for flow, a, b in zip(arcs, times, times[1:], strict=False))
    spans = zip(arcs, pieces, np.diff(times), strict=True)
    if any(flow.growth * length > MOST_GROWTH * m for flow, m, length in spans):
        return None
    return Layout(tuple(arcs), pieces, tuple(junctions), np.array(times))


def with_times(structure: Structure, plan: Layout, times: Vector) -> Structure:
    """Return the structure with the junction times that the shooting found."""
    contacts = list(structure)
    for junction, time in zip(plan.junctions, times[1:], strict=True):
        if junction.contact is not None:
            contacts[junction.contact] = _moved(contacts[junction.contact], junction.side, float(time))
    return tuple(contacts)


def _moved(contact: Contact, side: str, time: float) -> Contact:
    if side == "touch":
        return replace(contact, start=time, end=time)
    return replace(contact, start=time) if side == "start" else replace(contact, end=time)


def _points(structure: Structure, T: float) -> list[tuple[float, int, str]]:
    points = []
    for index, contact in enumerate(structure):
        if contact.is_touch:
            points += [(contact.start, index, "touch")] if contact.end < T else []
        else:
            points += [(contact.start, index, "start")] if contact.start > 0.0 else []
            points += [(contact.end, index, "end")] if contact.end < T else []
    return points


def _pieces(flow: Arc, length: float) -> int:
    return int(np.clip(np.ceil(flow.speed * length / REACH), 1, MOST_PIECES))
