"""A step with impulses after which there is no more energy than the forces have brought."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.models.impulse_dynamics import Motion

if TYPE_CHECKING:
    from pricing_core.models.mechanics import MechanicalSystem

ROUNDING = 1e-14  # share of the terms of an energy that is rounding


@dataclass(frozen=True, slots=True, eq=False)
class EnergyBalance:
    """The energy v^T M v/2 + q^T K q/2 that a step adds beyond the work of its force, from the motion at its start.

    Parameters
    ----------
    system : MechanicalSystem
    start : Motion
    force : Vector, shape (n,)
        Throughout the step.
    h : float
    free : Vector, shape (n,)
        The velocity at the end without impulses: what they take away measures rounding where all is at rest.
    """

    system: MechanicalSystem
    start: Motion
    force: Vector
    h: float
    free: Vector

    def gain(self, end: Motion) -> float:
        """Return the energy gained; negative damping may bring some, which is not counted."""
        q, v, _ = self.start
        system = self.system
        kinetic = 0.5 * float((end.v - v) @ system.mass @ (end.v + v))
        elastic = 0.5 * float((end.q - q) @ system.stiffness @ (end.q + q))
        work = float(self.force @ (end.q - q))
        mean, added = 0.5 * (v + end.v), self.free - v
        brought = max(0.0, -self.h * float(mean @ system.damping @ mean))
        gained = kinetic + elastic - work - brought
        terms = 0.5 * float(v @ system.mass @ v + added @ system.mass @ added)
        size = abs(elastic) + abs(work) + abs(kinetic) + terms
        return 0.0 if abs(gained) <= ROUNDING * size else gained

    def farthest(self, safe: Motion, wanted: Motion, gained: float) -> tuple[Motion, float]:
        """Return the motion between two, farthest from the first, that gains no energy, and its share of the way.

        Parameters
        ----------
        safe : Motion
            Which gains none.
        wanted : Motion
        gained : float
            What it gains, > 0.
        """
        at_safe = min(self.gain(safe), 0.0)
        dq, dv = wanted.q - safe.q, wanted.v - safe.v
        system = self.system
        square = 0.5 * float(dv @ system.mass @ dv + dq @ system.stiffness @ dq)
        slope = gained - at_safe - square  # at_safe + slope s + square s^2 is the gain at s
        root = np.sqrt(max(slope**2 - 4.0 * square * at_safe, 0.0))
        # The one of two equal expressions that loses no digits.
        share = -2.0 * at_safe / (slope + root) if slope > 0.0 else (root - slope) / (2.0 * square)
        share = min(max(float(share), 0.0), 1.0)
        parts = zip(safe, wanted, strict=True)
        return Motion(*((1.0 - share) * first + share * second for first, second in parts)), share
