"""A trajectory of a mechanical system with what its contacts do along their tangents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pricing_core.lcs import Trajectory

if TYPE_CHECKING:
    from pricing_core.models.mechanics import MechanicalSystem


@dataclass(frozen=True, slots=True, eq=False)
class ContactTrajectory(Trajectory):
    """A run in terms of impulses: u are the contact forces, y the gaps, and friction comes beside them.

    Parameters
    ----------
    friction_force : ndarray, shape (m, k) in the plane, (m, k, d) in space, (m, 0) without friction
        Along the tangent of each contact, or along each of its d directions; the impulse of a step over its length.
    slip : ndarray, of the same shape
        Sliding velocity at each contact along its tangent, or its directions, at the end of each step.
    bounded_steps : int
        Steps in which the rebound was reduced so that the energy does not grow.
    """

    friction_force: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    slip: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    bounded_steps: int = 0

    def _parts(
        self, states: Sequence[str] | None, multipliers: Sequence[str] | None, slacks: Sequence[str] | None
    ) -> list[tuple[str, str, NDArray[np.float64], Sequence[str] | None]]:
        """Return what `named_columns` takes: friction1, ... and slip1, ... as well, contact by contact."""
        return [
            *Trajectory._parts(self, states, multipliers, slacks),
            ("friction_force", "friction", self.friction_force, None),
            ("slip", "slip", self.slip, None),
        ]


def of_steps(run: Trajectory, system: MechanicalSystem, bounded_steps: int) -> ContactTrajectory:
    """Return the trajectory whose multipliers are contact forces and friction, slacks gaps and slip velocities."""
    k, m = system.offset.size, run.t.size
    shape = (m, 0) if system.tangents is None else (m, k, *system.tangents.shape[1:-1])
    parts = {part.name: getattr(run, part.name) for part in fields(Trajectory)}
    parts |= {"u": run.u[:, :k], "y": run.y[:, :k]}
    return ContactTrajectory(
        **parts,
        friction_force=run.u[:, k:].reshape(shape),
        slip=run.y[:, k:].reshape(shape),
        bounded_steps=bounded_steps,
    )
