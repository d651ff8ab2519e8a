"""A simulated circuit: its trajectory, and the voltages and currents along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Event, Trajectory
from pricing_core.lcs.run_table import table_of
from pricing_core.models.circuits.checked import checked_words
from pricing_core.models.circuits.circuit_lcs import CircuitLCS
from pricing_core.models.circuits.equations import GROUND

if TYPE_CHECKING:
    import pyarrow


@dataclass(frozen=True, slots=True, eq=False)
class CircuitRun:
    """What `DiodeCircuit.simulate` returns.

    Parameters
    ----------
    circuit : CircuitLCS
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
    """

    circuit: CircuitLCS
    start: float
    trajectory: Trajectory
    energy_lost_at_start: float
    voltages: dict[str, Vector]
    currents: dict[str, Vector]

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
        fine = read_run(self.circuit, self.trajectory.refined(count), self.start, from_elements=False)
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
        """Return the current of an element at the times t.

        Raises
        ------
        InvalidInputError
            The circuit has no such element.
        """
        checked_words("element", branch)
        if branch not in self.currents:
            raise InvalidInputError("element", branch, f"one of {', '.join(self.currents)}")
        return self.currents[branch]


def read_run(circuit: CircuitLCS, trajectory: Trajectory, start: float, *, from_elements: bool) -> CircuitRun:
    """Return the run with everything read off the trajectory.

    Parameters
    ----------
    from_elements : bool
        The run started from the elements' initial voltages and currents.
    """
    sources = _sources_along(circuit, trajectory.t)
    values = circuit.readings(trajectory.x, trajectory.u, sources)
    voltages: dict[str, Vector] = {GROUND: np.zeros(trajectory.t.size)}
    currents: dict[str, Vector] = {}
    for name, column in zip(circuit.readings.names, values.T, strict=True):
        (voltages if name[0] == "v" else currents)[name[2:-1]] = column
    events = tuple(_with_energy(circuit, event, start) for event in trajectory.events)
    lost = 0.0
    if from_elements:
        settled = circuit.states_of_elements(circuit.x0, circuit.sources.after(start))
        lost = circuit.energy_of_jump(circuit.initial_element_states, settled)
    return CircuitRun(circuit, start, replace(trajectory, events=events), lost, voltages, currents)


def _sources_along(circuit: CircuitLCS, t: Vector) -> Matrix:
    """Return the sources at the times: before a step where a time comes twice, then after it."""
    sources = circuit.sources
    steps = set(sources.signal.jumps.tolist())
    rows = []
    for i, time in enumerate(t.tolist()):
        is_before = time in steps and 0 < i < t.size - 1 and t[i - 1] < time == t[i + 1]
        rows.append(sources.before(time) if is_before else sources.after(time))
    return np.array(rows).reshape(t.size, sources.output.shape[0])


def _with_energy(circuit: CircuitLCS, event: Event, start: float) -> Event:
    sources = circuit.sources
    after = sources.after(event.time)
    before = sources.before(event.time) if event.time > start else after
    jump = (
        circuit.states_of_elements(event.x_before, before),
        circuit.states_of_elements(event.x_after, after),
    )
    if event.kind in ("jump", "input"):
        return replace(event, energy_lost=circuit.energy_of_jump(*jump))
    return event
