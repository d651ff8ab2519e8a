"""The signs of a shot, and the structure to try next where they are wrong."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.models.control.layout import Layout, with_times
from pricing_core.models.control.problem import LQData
from pricing_core.models.control.sampling import Samples
from pricing_core.models.control.shooting import Shot
from pricing_core.models.control.structure import Contact, Structure

# Share of the size of a slack or multiplier below which a negative value is rounding.
SIGN = 1e-9
# Share of the largest state or costate, which are solved for together, that is rounding.
ROUNDING = 1e-14
# Share of its length by which an arc ends earlier at first where it should not end at the horizon.
RELEASE = 0.05
# Share of the horizon below which an arc is none.
COLLAPSED = 1e-7


def improved(
    data: LQData,
    orders: tuple[int | None, ...],
    plan: Layout,
    shot: Shot,
    samples: tuple[Samples, ...],
    structure: Structure,
) -> Structure:
    """Return the structure to try next; the same, with its times, where every sign is right.

    In this order: arcs that collapsed become touch points (order >= 2 or at the horizon) or vanish; arcs of order >= 2
    that cannot reach the horizon end before it; contacts whose multiplier is negative or nothing shrink or vanish;
    where a slack is negative a contact is added.
    """
    current = with_times(structure, plan, shot.times)
    kept = reordered(current, orders, data.horizon)
    if kept != current:
        return kept
    if not shot.converged:
        return tuple(_released(contact, orders, data.horizon) for contact in kept)
    pushing = _pushing(data, plan, shot, samples, current, orders)
    return pushing if pushing != current else _with_violated(data, orders, samples, current)


def reordered(structure: Structure, orders: tuple[int | None, ...], T: float) -> Structure:
    """Return the structure without arcs that have no length: touch points instead, or nothing.

    What ends so close to the horizon ends there.
    """
    found: list[Contact] = []
    for given in structure:
        contact = replace(given, end=T) if T - given.end < COLLAPSED * T else given
        if contact.is_touch or contact.end - contact.start > COLLAPSED * T:
            found.append(contact)
        elif contact.end >= T:
            found.append(replace(contact, start=T))
        elif contact.start > 0.0 and (orders[contact.constraint] or 0) > 1:
            middle = 0.5 * (contact.start + contact.end)
            found.append(replace(contact, start=middle, end=middle))
    return tuple(found)


def separated(structure: Structure) -> Structure:
    """Return the structure with arcs that overlap in part cut to where they meet in the middle."""
    found = list(structure)
    for a, b in permutations(range(len(found)), 2):
        if found[a].start < found[b].start <= found[a].end < found[b].end:
            meeting = 0.5 * (found[b].start + found[a].end)
            found[a], found[b] = replace(found[a], end=meeting), replace(found[b], start=meeting)
    return tuple(found)


def _released(contact: Contact, orders: tuple[int | None, ...], T: float) -> Contact:
    """Let an arc of order >= 2 that ends at the horizon, which few problems have, end before it."""
    if contact.is_touch or contact.end < T or (orders[contact.constraint] or 0) < 2:
        return contact
    return replace(contact, end=T - RELEASE * (T - contact.start))


def _pushing(
    data: LQData,
    plan: Layout,
    shot: Shot,
    samples: tuple[Samples, ...],
    structure: Structure,
    orders: tuple[int | None, ...],
) -> Structure:
    """Keep of every contact the parts where the multiplier is positive."""
    found: list[Contact] = []
    total = max(1.0, *(float(np.max(np.abs(part.costate))) for part in samples))
    for contact in structure:
        atoms = atoms_of(contact, plan, shot)
        if contact.is_touch:
            found += [contact] if atoms[contact.start] > SIGN * total else []
            continue
        t, eta = density(contact, samples)
        level = SIGN * max(total, float(np.max(np.abs(eta))))
        atom_at = {time for time, weight in atoms.items() if weight > SIGN * total}
        if (
            np.all(eta >= -level)
            and np.any(eta > level)
            and min(atoms.values(), default=0.0) >= -SIGN * total
        ):
            found.append(contact)
        elif contact.end >= data.horizon and np.all(eta >= -level) and atoms[contact.end] < -SIGN * total:
            found.append(replace(contact, end=contact.end - RELEASE * (contact.end - contact.start)))
        elif np.all(np.abs(eta) <= level):
            found += [replace(contact, start=time, end=time) for time in sorted(atom_at)]
        else:
            parts = _positive_parts(contact, t, eta, (orders[contact.constraint] or 0) > 1)
            found += parts
            again = replace(contact, start=data.horizon, end=data.horizon)
            if data.horizon in atom_at and again not in structure and all(p.end < again.end for p in parts):
                found.append(again)
    return tuple(found)


def _positive_parts(contact: Contact, t: Vector, eta: Vector, smooth: bool) -> list[Contact]:
    signs = np.flatnonzero(eta > 0.0)
    runs = [run for run in np.split(signs, np.flatnonzero(np.diff(signs) > 1) + 1) if run.size > 1]
    parts = [
        replace(
            contact,
            start=contact.start if run[0] == 0 else float(t[run[0]]),
            end=contact.end if run[-1] == t.size - 1 else float(t[run[-1]]),
        )
        for run in runs
    ]
    if parts == [contact] or not parts:  # the density is positive, an atom is not
        middle = 0.5 * (contact.start + contact.end)
        return [replace(contact, start=middle, end=middle)] if smooth else []
    return parts


def _with_violated(
    data: LQData, orders: tuple[int | None, ...], samples: tuple[Samples, ...], structure: Structure
) -> Structure:
    """Add contacts where slacks are negative; a touch point inside such an interval grows to an arc."""
    t = np.concatenate([part.t for part in samples])
    x = np.vstack([part.x for part in samples])
    largest = max(float(np.max(np.abs(values))) for part in samples for values in (part.x, part.costate))
    found = list(structure)
    for i, order in enumerate(orders):
        slack = x @ data.C[i] - data.bound[i]
        size = max(float(data.slack_sizes[i]), float(np.max(np.abs(slack))))
        below = np.flatnonzero(
            slack < -max(SIGN * size, ROUNDING * float(np.sum(np.abs(data.C[i]))) * largest)
        )
        runs = [run for run in np.split(below, np.flatnonzero(np.diff(below) > 1) + 1) if run.size]
        for run in runs:
            start, end = float(t[max(run[0] - 1, 0)]), float(t[min(run[-1] + 1, t.size - 1)])
            near = [c for c in found if c.constraint == i and c.start <= end and c.end >= start]
            for contact in near:
                found.remove(contact)
            lowest = float(t[run[np.argmin(slack[run])]])
            if not near and ((order or 0) > 1 or lowest >= data.horizon):
                found.append(Contact(i, lowest, lowest))
            else:
                reach = [(c.start, c.end) for c in near] + [(start, end)]
                found.append(Contact(i, min(a for a, _ in reach), max(b for _, b in reach)))
    return tuple(sorted(found, key=lambda c: (c.constraint, c.start)))


def atoms_of(contact: Contact, plan: Layout, shot: Shot) -> dict[float, float]:
    """Return the atoms of a contact's constraint at the junctions of the contact, by time."""
    found: dict[float, float] = {}
    for junction, time, weights in zip(plan.junctions, shot.times[1:], shot.atoms, strict=True):
        if contact.constraint in junction.with_atom and contact.start <= time <= contact.end:
            found[float(time)] = float(weights[junction.with_atom.index(contact.constraint)])
    return found


def density(contact: Contact, samples: tuple[Samples, ...]) -> tuple[Vector, Vector]:
    """Return the multiplier's density on an arc."""
    inside = [part for part in samples if part.t[0] >= contact.start and part.t[-1] <= contact.end]
    return (
        np.concatenate([part.t for part in inside]),
        np.concatenate([part.multiplier[:, contact.constraint] for part in inside]),
    )
