"""The modes in which a state goes on at one instant: selected, jumped into, as often as it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.errors import IterationLimitError, NonUniqueError, NumericalError
from pricing_core.lcs.mode_dynamics import LADDER, Entry, ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector, implicit_step
from pricing_core.lcs.run_record import RunRecord
from pricing_core.lcs.simulation_method import Rebound

TOUCHES = 1e-9  # of an output's size: how close to zero counts as contact
MOST_REINITIALISATIONS = 50  # at one instant
SHORT_STEPS = (1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9)  # in the form's units


class Landing(NamedTuple):
    """A mode, and where a state comes to in it."""

    dynamics: ModeDynamics
    c: State
    z: State
    impulse: Vector
    multiplicity: int  # how often it was reinitialised


@dataclass(frozen=True, slots=True, eq=False)
class Landings:
    """The jump rule of (11.78), or another law of impact.

    Parameters
    ----------
    record : RunRecord
        Which knows the units.
    selector : ModeSelector
    law : Rebound or None
        What follows a jump in the place of the projection.
    """

    record: RunRecord
    selector: ModeSelector
    law: Rebound | None

    def land(self, state: State, t: float, near: IndexSet, left: IndexSet | None) -> Landing:
        """Return where z goes on, by the law of impact where it jumps.

        Parameters
        ----------
        near : tuple of int
            The mode to look at first.
        left : tuple of int or None
            The mode that was left, which does not go on.

        Raises
        ------
        NotFoundError, NonUniqueError
            See `ModeSelector.select`.
        IterationLimitError
            The state is reinitialised without end.
        """
        landing = self._projected(state, t, near, left)
        if landing.multiplicity == 0 or self.law is None:
            return landing
        contacts = self._contacts(state)
        x, impulse = self.law(self.record.state(state.z), self.record.state(landing.z.z), contacts)
        n, units = self.record.form.states, self.record.form.units
        z = np.concatenate([x / units.state[:n], state.z[n:]])
        change = np.abs(z - state.z)
        sizes = np.maximum(state.sizes, np.where(change > 0.0, float(change.max(initial=0.0)), np.abs(z)))
        again = self._projected(State(z, sizes), t, landing.dynamics.mode, None)
        return again._replace(impulse=impulse + again.impulse, multiplicity=landing.multiplicity)

    def at_rest(self, state: State, mode: IndexSet) -> Landing | None:
        """Return what goes on in a mode whatever velocity of the size of rounding is lost, None where nothing does.

        What lies on what comes to rest does so with it: outputs that would fall are taken into the mode, as long as the
        state jumps next to no farther than for the mode alone.
        """
        allowed = math.inf
        for _ in range(self.record.form.system.shape[1] + 1):
            dynamics = self.selector.dynamics(mode)
            if dynamics is None:
                return None
            c = dynamics.enter(state)
            z = dynamics.leave(c)
            change = float(np.abs(z.z - state.z).max(initial=0.0))
            if change > allowed:
                return None
            falling = np.flatnonzero(dynamics.initial_signs(c) < 0.0).tolist()
            if not falling:
                return Landing(dynamics, c, z, self.record.no_impulse(), 0)
            if not set(mode).isdisjoint(falling):
                return None
            allowed = min(allowed, 2.0 * change)
            mode = tuple(sorted({*mode, *falling}))
        return None

    def _projected(self, state: State, t: float, near: IndexSet, left: IndexSet | None) -> Landing:
        """Select the mode that goes on from z and jump into it, as often as it takes."""
        state, entry = self._select(state, t, near, left)
        impulse, multiplicity = self.record.no_impulse(), 0
        for _ in range(MOST_REINITIALISATIONS):
            dynamics, c, _, continues = entry
            if dynamics.jumps_from(state.z, c.z):
                multiplicity += 1
                impulse += self._impulse(dynamics, state.z)
                state = dynamics.leave(c)
            if continues:
                return Landing(dynamics, c, state, impulse, multiplicity)
            state, entry = self._select(state, t, dynamics.mode, dynamics.mode)
        raise IterationLimitError(
            f"{MOST_REINITIALISATIONS} reinitialisations at t = {t:.12g} lead to no mode that goes on"
        )

    def _select(
        self, state: State, t: float, near: IndexSet, without: IndexSet | None
    ) -> tuple[State, Entry]:
        """Select the mode that goes on; where rounding leaves none, that of the state after a very short step."""
        try:
            return state, self.selector.select(state, t, near, without)
        except NonUniqueError:
            raise
        except NumericalError as error:
            for h in SHORT_STEPS:
                stepped = implicit_step(self.record.form, state, h)
                if stepped is None:
                    continue
                after, mode = stepped
                found = self.selector.dynamics(mode)
                entries = (found.entered(after, shares) for shares in LADDER) if found is not None else ()
                entry = next((entry for entry in entries if entry is not None), None)
                if entry is not None:
                    return after, entry
            raise error

    def _contacts(self, state: State) -> IndexSet:
        """Return the pairs with y_i = C_i z = 0, to rounding."""
        C = self.record.form.system.C
        levels = np.abs(C) @ np.maximum(state.sizes, np.abs(state.z))
        return tuple(np.flatnonzero(C @ state.z <= TOUCHES * levels).tolist())

    def _impulse(self, dynamics: ModeDynamics, z: Vector) -> Vector:
        """Return the coefficients of delta in u, shape (k,)."""
        units = self.record.form.units
        impulse, mode = self.record.no_impulse(), list(dynamics.mode)
        if dynamics.impulses.shape[0]:
            impulse[mode] = (dynamics.impulses[-1] @ z)[mode]
        return np.asarray(impulse * units.pair / units.rate)
