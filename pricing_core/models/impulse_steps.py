"""Time stepping of mechanical systems in terms of impulses: by Moreau's steps, or by those of Stewart and Trinkle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcs.simulation_method import TimeStepping
from pricing_core.lcs.stepping_scheme import SMALLEST_STEP, THETA, stepped_trajectory
from pricing_core.lcs.time_stepping import LCSState
from pricing_core.models.contact_trajectory import ContactTrajectory, of_steps
from pricing_core.models.contacts import Contacts
from pricing_core.models.impulse_dynamics import ImpulseDynamics, Motion
from pricing_core.models.moreau import Moreau
from pricing_core.models.stewart_trinkle import StewartTrinkle
from pricing_core.stepping import StepDoubling, integrate
from pricing_core.stepping.method import Step

if TYPE_CHECKING:
    from pricing_core.models.mechanics import MechanicalSystem


@dataclass(frozen=True, slots=True, eq=False)
class ContactState(LCSState):
    """x = (q, v); multiplier: contact and friction forces; slack: gaps and slip velocities; shape (k + k d,) both."""

    share: float = 1.0  # of the step before that is Moreau's own


@dataclass(frozen=True, slots=True)
class ImpulseStep:
    """One step of either method, with the forces of contact over it.

    Parameters
    ----------
    contacts : Contacts
    scheme : Moreau or StewartTrinkle
    theta : float
        Weight of the force at the end of the step.
    """

    contacts: Contacts
    scheme: Moreau | StewartTrinkle
    theta: float

    @property
    def order(self) -> int:
        """1: an impact lies anywhere in its step."""
        return 1

    def start(self, x: Vector) -> ContactState:
        """Return the state x = (q, v) without forces of contact, which the first step tells."""
        half = x.size // 2
        return self._state(Motion(x[:half], x[half:], np.zeros(len(self.contacts.rows))), 1.0, 1.0)

    def step(self, t: float, state: ContactState, h: float) -> Step[ContactState]:
        """Go from t to t + h; the error of the positions is what counts, for velocities jump."""
        half = state.value.size // 2
        source = self.scheme.dynamics.system.force
        force = (1.0 - self.theta) * source.after(t) + self.theta * source.before(t + h)
        start = Motion(state.value[:half], state.value[half:], np.zeros(0))
        if isinstance(self.scheme, Moreau):
            end, share = self.scheme.move(start, force, h)
        else:
            end, share = self.scheme.move(start, force, h), 1.0
        return Step(self._state(end, h, share), end.q)

    def _state(self, motion: Motion, h: float, share: float) -> ContactState:
        system, contacts = self.scheme.dynamics.system, self.contacts
        gap = np.maximum(system.F @ motion.q + system.offset, 0.0)
        return ContactState(
            np.concatenate([motion.q, motion.v]),
            contacts.forces(motion.impulse, h),
            np.concatenate([gap, contacts.tangents @ motion.v]),
            share,
        )


def impulse_step(system: MechanicalSystem, method: TimeStepping) -> ImpulseStep:
    """Return the step that a method asks for."""
    contacts, choice = system.contacts(), (method.lcp_method, method.multipliers)
    implicit = StewartTrinkle(ImpulseDynamics(system, contacts, 1.0), *choice)
    if method.scheme == "stewart-trinkle":
        return ImpulseStep(contacts, implicit, 1.0)
    theta = THETA if method.theta is None else method.theta
    return ImpulseStep(contacts, Moreau(ImpulseDynamics(system, contacts, theta), implicit, *choice), theta)


def simulate_by_impulses(
    system: MechanicalSystem,
    x0: Vector,
    t_span: tuple[float, float],
    t_eval: Vector | None,
    method: TimeStepping,
    interrupt: Callable[[], bool] | None,
) -> ContactTrajectory:
    """Simulate from x0 = (q, v), shape (2n,), in terms of impulses; see `MechanicalSystem.simulate`."""
    one_step = impulse_step(system, method)
    run = integrate(
        one_step if method.step is not None else StepDoubling(one_step),
        one_step.start(x0),
        t_span,
        controller=method.controller(system.mass.shape[0]),
        stop_times=[*system.force.jumps, *(() if t_eval is None else t_eval)],
        smallest_h=SMALLEST_STEP * (t_span[1] - t_span[0]),
        force_smallest=True,
        interrupt=interrupt,
    )
    trajectory = stepped_trajectory(
        run.t.tolist(),
        run.states,
        t_eval,
        events=(),
        status=run.status,
        scheme="moreau" if isinstance(one_step.scheme, Moreau) else "stewart-trinkle",
        counts=(run.accepted, run.rejected, run.forced),
    )
    bounded = sum(state.share < 1.0 for state in run.states)
    return of_steps(trajectory, system, bounded)
