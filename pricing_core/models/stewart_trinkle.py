"""The step of Stewart and Trinkle: positions at its end are implicit, and never violate a constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcp import Method
from pricing_core.lcs.time_stepping import Multipliers
from pricing_core.models.impulse_dynamics import ImpulseDynamics, Motion

ROUNDING = 1e-12  # share of the largest change of a gap below which one is closed


@dataclass(frozen=True, slots=True, eq=False)
class StewartTrinkle:
    """An implicit Euler step with impulses (Stewart, Trinkle 1996), of order 1, inelastic.

        M (v+ - v) = h (f - D v+ - K q+) + F^T p + friction,    q+ = q + h v+,
        0 <= F q+ + offset _|_ p >= 0,    friction opposes the sliding at v+.

    With K, D symmetric positive semidefinite the energy grows by no more than the work of f: with d = v+ - v,

        change = f^T (q+ - q) - h v+^T D v+ - d^T M d/2 - h^2 v+^T K v+/2 + p^T F v+ + friction^T v+,

    where p^T F v+ = -p^T (F q + offset)/h <= 0, and friction^T v+ = -(sum over contacts of slip times friction) <= 0.

    Parameters
    ----------
    dynamics : ImpulseDynamics
        With theta = 1.
    lcp_method, multipliers
        As in `TimeStepping`.
    """

    dynamics: ImpulseDynamics
    lcp_method: Method
    multipliers: Multipliers

    def move(self, start: Motion, force: Vector, h: float) -> Motion:
        """Return the motion at the end of a step with the force f.

        Raises
        ------
        NumericalError
            The LCP, which has a solution, was not solved.
        """
        system, contacts = self.dynamics.system, self.dynamics.contacts
        end = free = self.dynamics.free_velocity(start, force, h)
        response = self.dynamics.response(h)
        gap = np.maximum(system.F @ start.q + system.offset, 0.0)
        impulse, active = np.zeros(len(contacts.rows)), np.zeros(gap.size, dtype=np.bool_)
        while True:  # until no constraint that was left out is violated
            change = h * (system.F @ end)
            touching = (gap + change <= ROUNDING * np.max(np.abs(change), initial=0.0)) & ~active
            if not touching.any():
                return Motion(start.q + h * end, end, impulse)
            active |= touching
            choice = (self.lcp_method, self.multipliers)
            impulse = contacts.impulses(response.coupling, free, gap / h, active, choice)
            end = free + response.by_impulse @ impulse
