"""The structure of a solution: which constraint is in contact when; and its detection from a collocated solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.control.collocation import Collocation

GAP = 2  # nodes that a contact of order >= 2 may leave out: there the discrete masses alternate
TOUCH_NODES = 3  # up to so many nodes in contact are a touch point, where the order allows one
# Share of the largest costate below which a mass is what an interior-point method leaves of a zero.
NOTHING = 1e-6
SMALLEST = 1e-300
# Largest slack in contact, for order >= 2, in (h/T)^2 times the slack's size.
NEAR = 0.1


@dataclass(frozen=True, slots=True)
class Contact:
    """Constraint `constraint` is active on [start, end]; start == end is a touch point.

    A start at 0 and an end at the horizon are given, all other times are unknowns of the shooting.
    """

    constraint: int
    start: float
    end: float

    @property
    def is_touch(self) -> bool:
        """The contact is a single instant."""
        return self.start == self.end


Structure = tuple[Contact, ...]


def detect_structure(
    solution: Collocation,
    slacks: Matrix,
    sizes: Vector,
    orders: tuple[int | None, ...],
    held: tuple[bool, ...],
) -> Structure:
    """Return the contacts that the nodes of a collocated solution suggest.

    Parameters
    ----------
    solution : Collocation
    slacks : Matrix, shape (N + 1, k)
    sizes : Vector, shape (k,)
        What the slacks are differences of: where a constraint is active all the time, its slack is rounding of that.
    orders : tuple
        Orders of the constraints.
    held : tuple of bool
        Whether an arc of the constraint may start at x0: see `held_at_start`.
    """
    contacts: list[Contact] = []
    nothing = max(NOTHING * float(np.max(np.abs(solution.costate))), SMALLEST)
    for i, order in enumerate(orders):
        smooth = order is not None and order > 1
        size = max(float(np.max(np.abs(slacks[:, i]))), float(sizes[i]))
        mass = solution.masses[:, i] / max(float(np.max(solution.masses[:, i])), nothing)
        nodes = _nodes_in_contact(slacks[:, i] / size, mass, smooth)
        runs = _runs(nodes if held[i] else nodes[nodes > 0], GAP if smooth else 0)
        contacts += [_contact(i, run, solution.t, held[i], smooth) for run in runs]
    return tuple(contact for contact in contacts if contact.end > 0.0)


def _nodes_in_contact(
    slack: NDArray[np.float64], mass: NDArray[np.float64], smooth: bool
) -> NDArray[np.intp]:
    """Return the nodes where the mass, relative to its largest value, exceeds the slack relative to its own."""
    level = NEAR / (slack.size - 1) ** 2 if smooth else 0.0
    has_mass = (mass > np.abs(slack)) & (slack < 1e-3)
    return np.flatnonzero(has_mass | (slack < level))


def _runs(nodes: NDArray[np.intp], gap: int) -> list[NDArray[np.intp]]:
    return [run for run in np.split(nodes, np.flatnonzero(np.diff(nodes) > gap + 1) + 1) if run.size]


def _contact(i: int, run: NDArray[np.intp], t: NDArray[np.float64], held: bool, smooth: bool) -> Contact:
    """Return a contact of these nodes; it starts at 0 only where x0 allows it."""
    first, last, end = int(run[0]), int(run[-1]), t.size - 1
    half = 0.5 * float(t[1])
    from_start = first <= 1 and held
    if run.size <= (TOUCH_NODES if smooth else 1) and not from_start:
        if last == end:
            return Contact(i, float(t[end]), float(t[end]))
        if smooth:
            middle = 0.5 * float(t[first] + t[last])
            return Contact(i, middle, middle)
    start = 0.0 if from_start else max(float(t[first]) - half, 0.5 * half)
    return Contact(i, start, float(t[end]) if last == end else float(t[last]) + half)
