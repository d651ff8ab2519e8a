"""Moreau's step of a mechanical system: velocities and impulses, whatever happens inside a step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp import LCP, Method, solve
from pricing_core.lcs.time_stepping import Multipliers
from pricing_core.models.energy_bound import EnergyBalance
from pricing_core.models.impulse_dynamics import ImpulseDynamics, Motion
from pricing_core.models.stewart_trinkle import ROUNDING, StewartTrinkle

EPSILON = float(np.finfo(np.float64).eps)
INEXACT = 1e-6  # share of the velocities that rounding in the impulses may cost


@dataclass(frozen=True, slots=True)
class Moreau:
    """A step in terms of velocities and impulses (Moreau 1988; Jean 1999), of order 1, 2 where nothing touches.

    With v_theta = (1 - theta) v + theta v+ and q_theta, f_theta likewise,

        M (v+ - v) = h (f_theta - D v_theta - K q_theta) + F^T p + friction,    q+ = q + h v_theta,
        0 <= F v+ + e min(F v, 0) _|_ p >= 0    for the constraints that the step would violate without p,

    and friction opposes the sliding at v+, so that an impact, and a whole sequence of them, may lie anywhere in the
    step. Its LCP is that of Anitescu and Potra 1997. The positions are then projected, in the metric of M, on what the
    constraints allow.

    Newton's law with friction, or the projection, may gain energy. Where they would, the motion taken is the one
    between this and that of Stewart and Trinkle, which gains none, that conserves the energy: it violates no
    constraint, and its impulses lie in the cones of friction, for all of these are convex. Where both slide the same
    way, or both stick, friction is Coulomb's; elsewhere it may be less than mu p in such a step.

    Parameters
    ----------
    dynamics : ImpulseDynamics
    bound : StewartTrinkle
    lcp_method, multipliers
        As in `TimeStepping`.
    """

    dynamics: ImpulseDynamics
    bound: StewartTrinkle
    lcp_method: Method
    multipliers: Multipliers
    _projector: tuple[Matrix, Matrix] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        system = self.dynamics.system
        by_force = cho_solve(cho_factor(system.mass), system.F.T)
        object.__setattr__(self, "_projector", (by_force, system.F @ by_force))

    def move(self, start: Motion, force: Vector, h: float) -> tuple[Motion, float]:
        """Return the motion at the end of a step with the force f_theta, and the share of it that is this method's.

        Raises
        ------
        NumericalError
            No solution was found, by either method.
        """
        free = self.dynamics.free_velocity(start, force, h)
        try:
            own = self._move(start, free, h)
        except NumericalError:  # what is jammed by friction may have no impulse with a rebound
            return self.bound.move(start, force, h), 0.0
        if not own.impulse.any():
            return own, 1.0
        balance = EnergyBalance(self.dynamics.system, start, force, h, free)
        gained = balance.gain(own)
        if gained <= 0.0:
            return own, 1.0
        return balance.farthest(self.bound.move(start, force, h), own, gained)

    def _move(self, start: Motion, free: Vector, h: float) -> Motion:
        theta, by_impulse = self.dynamics.theta, self.dynamics.response(h).by_impulse
        impulse = self._impulse(start, free, h)
        end = free + by_impulse @ impulse
        lost_digits = EPSILON * (np.abs(by_impulse) @ np.abs(impulse)).max()
        if lost_digits > INEXACT * np.abs(np.concatenate([free, end])).max():
            raise NumericalError("the impulses cancel each other but for rounding")
        return Motion(self._projected(start.q + h * ((1.0 - theta) * start.v + theta * end)), end, impulse)

    def _impulse(self, start: Motion, free: Vector, h: float) -> Vector:
        """Return (p, beta); constraints that the others push into are taken in until none is violated."""
        system, contacts, theta = self.dynamics.system, self.dynamics.contacts, self.dynamics.theta
        response = self.dynamics.response(h)
        gap, approach = system.F @ start.q + system.offset, system.F @ start.v
        wanted = system.restitution * np.minimum(approach, 0.0)
        choice = (self.lcp_method, self.multipliers)
        impulse, active = np.zeros(len(contacts.rows)), gap <= 0.0
        touching = active
        while True:
            if touching.any():
                active = active | touching
                impulse = contacts.impulses(response.coupling, free, wanted, active, choice)
            end = free + response.by_impulse @ impulse
            change = h * ((1.0 - theta) * approach + theta * (system.F @ end))
            touching = (gap + change <= ROUNDING * np.max(np.abs(change), initial=0.0)) & ~active
            if not touching.any():
                return impulse

    def _projected(self, q: Vector) -> Vector:
        """Return the nearest positions, in the metric of M, that violate no constraint."""
        system = self.dynamics.system
        gap = system.F @ q + system.offset
        if not (gap < 0.0).any():
            return q
        by_force, delassus = self._projector
        return np.asarray(q + by_force @ solve(LCP(delassus, gap)).z)
