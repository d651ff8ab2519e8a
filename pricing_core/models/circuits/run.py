"""A simulated circuit: its trajectory, and the voltages and currents along it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Event, Trajectory
from pricing_core.lcs.run_table import table_of
from pricing_core.models.circuits.checked import checked_words
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.readings import Readings

if TYPE_CHECKING:
    import pyarrow

RIPPLE_POINTS = 4000  # of a run, besides its events


class ReadableCircuit(Protocol):
    """The names and readings of a circuit, by which a run reads a trajectory."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """The names of the states, in their order."""

    @property
    def multiplier_names(self) -> tuple[str, ...]:
        """Names of the multipliers."""

    @property
    def slack_names(self) -> tuple[str, ...]:
        """Names of the slacks."""

    @property
    def readings(self) -> Readings:
        """All node voltages and branch currents, whose names are those of `read`."""

    def read(self, trajectory: Trajectory) -> Matrix:
        """Return all readings along a trajectory, shape (m, readings)."""

    def energy_of_event(self, event: Event, start: float) -> float:
        """Return the energy in joules that is lost at an event."""

    def energy_lost_at_start(self, start: float) -> float:
        """Return what the elements' initial voltages and currents lose at once."""


@dataclass(frozen=True, slots=True, eq=False)
class CircuitRun:
    """What `DiodeCircuit.simulate` returns.

    Parameters
    ----------
    circuit : CircuitLCS, or SwitchedRecord of a circuit with switches
    start : float
        The time at which the simulation began.
    trajectory : Trajectory
        The run of x, u and y. The energy_lost of its events is what capacitors and inductors lose by jumping.
    energy_lost_at_start : float
        What the elements' initial voltages and currents lose at once where a loop of capacitors and voltage sources, or
        a cut-set of inductors and current sources, contradicts them; jumps through diodes are events.
    voltages : dict
        Voltages of the nodes at the times t, shape (m,) each.
    currents : dict
        Currents of the elements, from the first node to the second one; a transformer has NAME.primary and
        NAME.secondary.
    ends : dict
        The nodes between which these currents flow.
    """

    circuit: ReadableCircuit
    start: float
    trajectory: Trajectory
    energy_lost_at_start: float
    voltages: dict[str, Vector]
    currents: dict[str, Vector]
    ends: dict[str, tuple[str, str]] = field(repr=False)

    @property
    def t(self) -> Vector:
        """The times, in seconds, shape (m,)."""
        return self.trajectory.t

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of the trajectory."""
        return self.trajectory.events

    def refined(self, count: int) -> CircuitRun:
        """Return the run at `count` times or somewhat more, as `pricing_core.lcs.Trajectory.refined` does."""
        return self._along(self.trajectory.refined(count))

    def _along(self, trajectory: Trajectory) -> CircuitRun:
        fine = read_run(self.circuit, trajectory, self.start, self.ends, from_elements=False)
        return replace(fine, energy_lost_at_start=self.energy_lost_at_start)

    def to_table(self) -> pyarrow.Table:
        """Return the run as a `pyarrow.Table` of m rows: t, v(NODE) of all nodes but ground, i(NAME) of all elements.

        Raises
        ------
        MissingExtraError
            pyarrow, of the extra "batch", is not installed.
        """
        voltages = {f"v({node})": values for node, values in self.voltages.items() if node != GROUND}
        currents = {f"i({name})": values for name, values in self.currents.items()}
        return table_of({"t": self.t, **voltages, **currents})

    def quantity(self, name: str) -> Vector:
        """Return a voltage or a current at the times t.

        Parameters
        ----------
        name : str
            "v(node)", "v(node,node)" or "i(element)".

        Returns
        -------
        Vector, shape (m,)
            Volts or amperes.

        Raises
        ------
        InvalidInputError
            The name is none of these, or the circuit has no such node or element.
        """
        checked_words("quantity", name)
        kind, _, rest = name.partition("(")
        inside = [word.strip() for word in rest[:-1].split(",")]
        if kind not in ("v", "i") or not rest.endswith(")") or not len(inside) <= (2 if kind == "v" else 1):
            raise InvalidInputError("quantity", name, "v(node), v(node,node) or i(element)")
        return self.voltage(*inside) if kind == "v" else self.current(inside[0])

    def mean(self, name: str) -> float:
        """Return the mean over the run of the quantity `name`, in volts or amperes.

        It is exact to rounding where the run was driven by events.
        """
        fine, weights = self._quadrature()
        return float(weights @ fine.quantity(name))

    def rms(self, name: str) -> float:
        """Return the root of the mean square over the run of the quantity `name`, in volts or amperes."""
        fine, weights = self._quadrature()
        return math.sqrt(float(weights @ fine.quantity(name) ** 2))

    def ripple(self, name: str) -> float:
        """Return the difference of the largest and the smallest value of `name`, to about 1e-6 of itself."""
        return float(np.ptp(self.refined(RIPPLE_POINTS).quantity(name)))

    def power(self, element: str) -> float:
        """Return the mean of the power that goes into an element, in watts: negative where it gives power.

        Examples
        --------
        >>> from pricing_core.models import DiodeCircuit, Sine
        >>> circuit = DiodeCircuit().voltage_source("V1", "a", "0", Sine(10, 50)).resistor("R1", "a", "0", 5)
        >>> run = circuit.simulate((0.0, 0.02))
        >>> round(run.power("R1"), 12), round(run.power("V1"), 12), round(run.rms("v(a)") ** 2, 9)
        (10.0, -10.0, 50.0)
        """
        fine, weights = self._quadrature()
        return float(weights @ (fine.current(element) * fine.voltage(*self.ends[element])))

    def _quadrature(self) -> tuple[CircuitRun, Vector]:
        """Return the run at nodes of a quadrature, and their weights, whose sum is 1."""
        fine, weights = self.trajectory.quadrature()
        return self._along(fine), weights

    def voltage(self, plus: str, minus: str = GROUND) -> Vector:
        """Return v(plus) - v(minus) at the times t.

        Raises
        ------
        InvalidInputError
            The circuit has no such node.
        """
        for node in (plus, minus):
            checked_words("node", node)
            if node not in self.voltages:
                raise InvalidInputError("node", node, f"one of {', '.join(self.voltages)}")
        return self.voltages[plus] - self.voltages[minus]

    def current(self, branch: str) -> Vector:
        """Return the current in amperes of the element `branch` at the times t, shape (m,).

        Raises
        ------
        InvalidInputError
            The circuit has no such element.
        """
        checked_words("element", branch)
        if branch not in self.currents:
            raise InvalidInputError("element", branch, f"one of {', '.join(self.currents)}")
        return self.currents[branch]


def read_run(
    circuit: ReadableCircuit,
    trajectory: Trajectory,
    start: float,
    ends: dict[str, tuple[str, str]],
    *,
    from_elements: bool,
) -> CircuitRun:
    """Return the run with everything read off the trajectory.

    Parameters
    ----------
    ends : dict
        The nodes of all branches.
    from_elements : bool
        The run started from the elements' initial voltages and currents.
    """
    values = circuit.read(trajectory)
    voltages: dict[str, Vector] = {GROUND: np.zeros(trajectory.t.size)}
    currents: dict[str, Vector] = {}
    for name, column in zip(circuit.readings.names, values.T, strict=True):
        (voltages if name[0] == "v" else currents)[name[2:-1]] = column
    events = tuple(
        replace(event, energy_lost=circuit.energy_of_event(event, start))
        if event.kind in ("jump", "input")
        else event
        for event in trajectory.events
    )
    lost = circuit.energy_lost_at_start(start) if from_elements else 0.0
    return CircuitRun(circuit, start, replace(trajectory, events=events), lost, voltages, currents, ends)
