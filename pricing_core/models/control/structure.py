"""The structure of a solution: which constraint is in contact when; and its detection from a collocated solution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix
from pricing_core.models.control.collocation import Collocation

GAP = 2  # nodes that a contact of order >= 2 may leave out: there the discrete masses alternate
TOUCH_NODES = 3  # up to so many nodes in contact are a touch point, where the order allows one
AT_BOUND = 1e-10  # of the largest slack
NEAR = 0.1  # of (h/T)^2 of the largest slack: in contact, for order >= 2


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


def detect_structure(solution: Collocation, slacks: Matrix, orders: tuple[int | None, ...]) -> Structure:
    """Return the contacts that the nodes of a collocated solution suggest.

    Parameters
    ----------
    solution : Collocation
    slacks : Matrix, shape (N + 1, k)
    orders : tuple
        Of the constraints.
    """
    contacts: list[Contact] = []
    for i, order in enumerate(orders):
        smooth = order is not None and order > 1
        nodes = _nodes_in_contact(slacks[:, i], solution.masses[:, i], smooth)
        for run in _runs(nodes, GAP if smooth else 0):
            contacts.append(
                _contact(i, run, solution.t, slacks[0, i] <= AT_BOUND * np.max(slacks[:, i]), smooth)
            )
    return tuple(contact for contact in contacts if contact.end > 0.0)


def _nodes_in_contact(
    slack: NDArray[np.float64], mass: NDArray[np.float64], smooth: bool
) -> NDArray[np.intp]:
    """Return the nodes where the mass counts more than the slack, each against its largest."""
    slack_size = max(float(np.max(np.abs(slack))), 1e-300)
    mass_size = max(float(np.max(np.abs(mass))), 1e-300)
    level = NEAR / (slack.size - 1) ** 2 if smooth else 0.0
    weighed = (mass / mass_size > np.abs(slack) / slack_size) & (slack < 1e-3 * slack_size)
    return np.flatnonzero(weighed | (slack < level * slack_size))


def _runs(nodes: NDArray[np.intp], gap: int) -> list[NDArray[np.intp]]:
    return [run for run in np.split(nodes, np.flatnonzero(np.diff(nodes) > gap + 1) + 1) if run.size]


def _contact(
    i: int, run: NDArray[np.intp], t: NDArray[np.float64], at_bound: np.bool_, smooth: bool
) -> Contact:
    """Return a contact of these nodes; it starts at 0 only where the slack of x0 is zero."""
    first, last, end = int(run[0]), int(run[-1]), t.size - 1
    half = 0.5 * float(t[1])
    from_start = first <= 1 and bool(at_bound)
    if run.size <= (TOUCH_NODES if smooth else 1) and not from_start:
        if last == end:
            return Contact(i, float(t[end]), float(t[end]))
        if smooth:
            middle = 0.5 * float(t[first] + t[last])
            return Contact(i, middle, middle)
    start = 0.0 if from_start else max(float(t[first]) - half, 0.5 * half)
    return Contact(i, start, float(t[end]) if last == end else float(t[last]) + half)
