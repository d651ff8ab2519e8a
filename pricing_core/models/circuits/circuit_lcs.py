"""A circuit as a linear complementarity system (11.5), with what is needed to read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import LCS, Event, Trajectory
from pricing_core.linalg.rational import RationalMatrix, rational_array, sparse_product
from pricing_core.linalg.rational_definite import negative_vector
from pricing_core.models.circuits.readings import Readings, SourceSignals


@dataclass(frozen=True, slots=True, eq=False)
class CircuitLCS:
    """x' = A x + B u + f, y = C x + D u + g, 0 <= y _|_ u >= 0 with currents and reverse voltages of diodes in u and y.

    Parameters
    ----------
    system : LCS
        Its f and g come from the sources.
    state_names : tuple of str
        "v(C1)" or "i(L1)"; where sources fix part of it, with that part taken off, as in "v(C1) - 0.5 V1".
    x0 : Vector, shape (n,)
        From the initial voltages and currents; where a capacitor loop or an inductor cut-set contradicts them, after
        charge has been shared.
    multiplier_names, slack_names : tuple of str
        "i(D1)" and "-v(D1)", or the other way round.
    stored_energy : Matrix, shape (n, n)
        Q: the energy is x^T Q x / 2 while the sources are zero.
    exact_energy : array of rational numbers, shape (n, n)
        Q before rounding.
    readings : Readings
        All node voltages and branch currents.
    element_states : Readings
        The voltages of all capacitors and the currents of all inductors.
    entry : Matrix, shape (n, m)
        W: x = W s.
    storage : Matrix
        M: the stored energy is s^T M s / 2 with these s.
    initial_element_states : Vector
        s as given for the elements.
    sources : SourceSignals
    """

    system: LCS
    state_names: tuple[str, ...]
    x0: Vector
    multiplier_names: tuple[str, ...]
    slack_names: tuple[str, ...]
    stored_energy: Matrix
    exact_energy: RationalMatrix
    readings: Readings
    element_states: Readings
    entry: Matrix
    storage: Matrix
    initial_element_states: Vector
    sources: SourceSignals

    @property
    def is_passive(self) -> bool:
        """Whether Q satisfies (11.6), decided in exact arithmetic; always so without controlled sources."""
        Q = self.exact_energy
        A, B, C, D = (rational_array(matrix) for matrix in self.system.given)
        coupling, change = sparse_product(Q, B) - C.T, sparse_product(Q, A)
        return negative_vector(-np.block([[change.T + change, coupling], [coupling.T, -(D + D.T)]])) is None

    def states_of_elements(self, x: Vector, sources: Vector) -> Vector:
        """Return s, the capacitor voltages and inductor currents, for x and the values of the sources."""
        return self.element_states(x, np.zeros(self.system.shape[1]), sources)

    def energy_of_jump(self, before: Vector, after: Vector) -> float:
        """Return what is lost when s jumps, (after - before)^T M (after - before) / 2.

        The impulsive currents and voltages of a jump do work on nothing but the stores and the sources, and the
        sources' share is s_after^T M (s_after - s_before).

        Examples
        --------
        A capacitor of 2 F charged from 0 to 3 V by a source stores 9 J; the source gives 18 J:

        >>> from pricing_core.models import DiodeCircuit
        >>> circuit = DiodeCircuit().voltage_source("V1", "a", "0", 3).capacitor("C1", "a", "0", 2)
        >>> circuit.to_lcs().energy_of_jump(np.array([0.0]), np.array([3.0]))
        9.0
        """
        change = after - before
        return 0.5 * float(change @ self.storage @ change)

    def read(self, trajectory: Trajectory) -> Matrix:
        """Return all readings along a trajectory of the system, shape (m, readings)."""
        return self.readings(trajectory.x, trajectory.u, self.sources.along(trajectory.t))

    def energy_of_event(self, event: Event, start: float) -> float:
        """Return the energy in joules that is lost at an event of a run that begins at `start`."""
        after = self.sources.after(event.time)
        before = self.sources.before(event.time) if event.time > start else after
        return self.energy_of_jump(
            self.states_of_elements(event.x_before, before), self.states_of_elements(event.x_after, after)
        )

    def energy_lost_at_start(self, start: float) -> float:
        """Return the energy in joules that the initial voltages and currents lose at once.

        The run begins at `start`, whose sources count.
        """
        settled = self.states_of_elements(self.x0, self.sources.after(start))
        return self.energy_of_jump(self.initial_element_states, settled)
