"""A circuit with switches: one linear complementarity system for each of their positions, found when it is met.

A switch is no complementary pair: its position is given from outside, by a clock or a threshold. So the circuit is a
sequence of diode circuits, each with the states, the pairs and the uniqueness that theory gives it, whether a switch
has resistances (then all share one state space) or none (then some capacitors or inductors are joined in one position,
and x = W s has fewer entries). What passes from one to the next are the voltages of all capacitors and the currents of
all inductors, s. W annihilates the jumps that the new position makes in an instant, so that charges of nodes and fluxes
of loops are kept exactly; what diodes add to the jump follows from the rational complementarity problem. A threshold is
one more function of the state that must not become negative, and is located as outputs are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcs import Event, EventDriven, Exosystem, Trajectory
from pricing_core.lcs.guards import Guards
from pricing_core.lcs.joined_exosystem import distinct
from pricing_core.lcs.mode_selection import OnNonUnique
from pricing_core.lcs.switched import (
    Configuration,
    Positions,
    PreparedConfiguration,
    Schedule,
    SwitchedRun,
    prepared,
)
from pricing_core.models.circuits.assembly import assemble
from pricing_core.models.circuits.circuit_lcs import CircuitLCS
from pricing_core.models.circuits.elements import Capacitor, Element, Inductor, pairs_of
from pricing_core.models.circuits.equations import GROUND, ONE
from pricing_core.models.circuits.gates import with_clocks, without_effect
from pricing_core.models.circuits.readings import Readings
from pricing_core.models.circuits.signals import stacked
from pricing_core.models.circuits.sources import CurrentSource, VoltageSource
from pricing_core.models.circuits.switches import (
    Switch,
    Threshold,
    closed_after,
    instants,
    resolution,
)
from pricing_core.models.circuits.tableau import source_values


@dataclass(slots=True, eq=False)
class SwitchedCircuit:
    """The systems of a circuit with switches, in terms of what they share.

    Its states are the voltages of all capacitors and the currents of all inductors, s; its multipliers the currents of
    the diodes, its slacks their reverse voltages, whatever the systems have for multipliers.

    Parameters
    ----------
    elements : sequence of Element
    """

    elements: Sequence[Element]
    switches: tuple[Switch, ...] = field(init=False)
    systems: dict[Positions, CircuitLCS] = field(default_factory=dict, init=False)
    known: dict[tuple[Positions, OnNonUnique], PreparedConfiguration] = field(
        default_factory=dict, init=False
    )

    def __post_init__(self) -> None:
        self.elements = with_clocks(self.elements)
        self.switches = tuple(element for element in self.elements if isinstance(element, Switch))

    def system(self, positions: Positions) -> CircuitLCS:
        """Return the system with the switches in these positions, in their order.

        Raises
        ------
        InvalidInputError
            The circuit has no solution in them; the message names the switches that are closed.
        """
        if positions not in self.systems:
            elements = self.placed(positions)
            try:
                self.systems[positions] = assemble(elements, shared=True)
            except InvalidInputError as error:
                field_ = f"{error.field} with {self.described(positions)}"
                raise error.called(field_) from None
        return self.systems[positions]

    def placed(self, positions: Positions) -> list[Element]:
        """Return the elements with the switches in these positions."""
        closed = dict(zip((switch.name for switch in self.switches), positions, strict=True))
        return [e.at(closed[e.name]) if isinstance(e, Switch) else e for e in self.elements]

    def described(self, positions: Positions) -> str:
        """Return the positions in words."""
        closed = [switch.name for switch, on in zip(self.switches, positions, strict=True) if on]
        opened = [switch.name for switch, on in zip(self.switches, positions, strict=True) if not on]
        parts = [
            f"{', '.join(names)} {word}" for names, word in ((closed, "closed"), (opened, "open")) if names
        ]
        return " and ".join(parts)

    def configuration(self, positions: Positions) -> Configuration:
        """Return the system with what carries its state over to others."""
        circuit = self.system(positions)
        states = circuit.element_states
        carried = np.hstack([states.X, states.E @ circuit.sources.output])
        exchanged = tuple(i for i, name in enumerate(circuit.multiplier_names) if name.startswith("-v("))
        of_states, of_multipliers, numbers = [], [], []
        for i, (switch, on) in enumerate(zip(self.switches, positions, strict=True)):
            if isinstance(switch.control, Threshold):
                z, u = _guard(circuit, switch.control, on)
                of_states.append(z)
                of_multipliers.append(u)
                numbers.append(i)
        guards = Guards(
            np.array(of_states).reshape(len(numbers), carried.shape[1]),
            np.array(of_multipliers).reshape(len(numbers), circuit.system.shape[1]),
        )
        return Configuration(circuit.system, circuit.entry, carried, exchanged, guards, tuple(numbers))

    def find(self, positions: Positions, on_nonunique: OnNonUnique) -> PreparedConfiguration:
        """Return the configuration, prepared once."""
        key = positions, on_nonunique
        if key not in self.known:
            self.known[key] = prepared(self.configuration(positions), on_nonunique)
        return self.known[key]

    def schedule(self, span: tuple[float, float]) -> Schedule:
        """Return what the clock does in an interval."""
        clocks = {
            i: switch.control
            for i, switch in enumerate(self.switches)
            if not isinstance(switch.control, Threshold)
        }
        signal, idle = self.signal, without_effect(self.elements)
        values = [
            element.value
            for element in self.elements
            if isinstance(element, VoltageSource | CurrentSource) and element.name not in idle
        ]
        close = min((resolution(control) for control in clocks.values()), default=0.0)
        times = [stacked(values).knots(*span), *(instants(control, *span) for control in clocks.values())]
        merged = distinct(np.concatenate(times), close)
        looked = np.concatenate([[span[0]], merged])
        closed = np.tile(np.array(self.start_positions(), dtype=bool), (looked.size, 1))
        for i, control in clocks.items():
            closed[:, i] = closed_after(control, looked, close)
        by_state = np.array([isinstance(switch.control, Threshold) for switch in self.switches], dtype=bool)
        inputs = signal.states_along(looked, np.zeros(looked.size, dtype=bool))
        return Schedule(merged, closed, by_state, inputs)

    @property
    def signal(self) -> Exosystem:
        """The sources, as the systems of all positions have them."""
        values = source_values(self.placed(self.start_positions()), with_one=True)
        return stacked([value for _, value in values])

    def start_positions(self) -> Positions:
        """Return the positions of switches before anything is known of the state."""
        return tuple(isinstance(s.control, Threshold) and s.control.closed for s in self.switches)

    def simulate(
        self,
        span: tuple[float, float],
        s: Vector,
        method: EventDriven,
        t_eval: Vector | None,
        interrupt: Callable[[], bool] | None,
        positions: Positions | None = None,
    ) -> tuple[Trajectory, SwitchedRecord]:
        """Return the run from s, and what reads it; positions at the start are of switches that the state controls."""
        run = SwitchedRun(
            lambda positions: self.find(positions, method.on_nonunique),
            self.schedule(span),
            span,
            method,
            interrupt,
            lambda i: self.switches[i].name,
            self.start_positions() if positions is None else positions,
        )
        try:
            trajectory, held = run.simulate(s, t_eval)
        except NumericalError as error:
            raise type(error)(f"{error}; with {self.described(run.positions)}") from error
        return trajectory, SwitchedRecord(self, held)


@dataclass(frozen=True, slots=True, eq=False)
class SwitchedRecord:
    """A circuit with switches, and the positions that they had in each flow of a run."""

    circuit: SwitchedCircuit
    positions: tuple[Positions, ...]

    @property
    def _any(self) -> CircuitLCS:
        return self.circuit.system(self.positions[0])

    @property
    def state_names(self) -> tuple[str, ...]:
        """The voltages of all capacitors and the currents of all inductors."""
        stores = [e for e in self.circuit.elements if isinstance(e, Capacitor | Inductor)]
        return tuple(f"{'v' if isinstance(e, Capacitor) else 'i'}({e.name})" for e in stores)

    @property
    def multiplier_names(self) -> tuple[str, ...]:
        """The currents of the diodes."""
        return tuple(f"i({name})" for e in self.circuit.elements for name in pairs_of(e))

    @property
    def slack_names(self) -> tuple[str, ...]:
        """The reverse voltages of the diodes."""
        return tuple(f"-v({name})" for e in self.circuit.elements for name in pairs_of(e))

    @property
    def readings(self) -> Readings:
        """The readings of one of the systems: all have the same names."""
        return self._any.readings

    def closed(self, trajectory: Trajectory) -> dict[str, BoolVector]:
        """Return for each switch whether it is closed at the times of a trajectory."""
        table = np.array(self.positions, dtype=bool)[trajectory.flow_of]
        return {switch.name: table[:, i] for i, switch in enumerate(self.circuit.switches)}

    def read(self, trajectory: Trajectory) -> Matrix:
        """Return all readings along the trajectory, each by the system that holds there."""
        assert trajectory.flow_of is not None
        sources = self._any.sources.along(trajectory.t)
        numbers = {positions: i for i, positions in enumerate(dict.fromkeys(self.positions))}
        held = np.array([numbers[positions] for positions in self.positions])[trajectory.flow_of]
        values = np.empty((trajectory.t.size, len(self.readings.names)))
        for positions, number in numbers.items():
            rows, system = held == number, self.circuit.system(positions)
            exchanged = [name.startswith("-v(") for name in system.multiplier_names]
            u = np.where(exchanged, trajectory.y[rows], trajectory.u[rows])
            count = system.readings.E.shape[1]
            e = sources[rows][:, :count]
            values[rows] = system.readings(trajectory.x[rows] @ system.entry.T, u, e)
        return values

    def energy_of_event(self, event: Event, start: float) -> float:
        """Return what is lost at an event, whose states are those of the elements."""
        return self._any.energy_of_jump(event.x_before, event.x_after)

    def energy_lost_at_start(self, start: float) -> float:
        """Return what the elements' initial voltages and currents lose at once."""
        system = self._any
        x = system.entry @ system.initial_element_states
        settled = system.states_of_elements(x, system.sources.after(start))
        return system.energy_of_jump(system.initial_element_states, settled)


def _guard(circuit: CircuitLCS, control: Threshold, closed: bool) -> tuple[Vector, Vector]:
    """Return what is not negative while the switch stays as it is, as a function of (x, w) and u."""
    readings, sources = circuit.readings, circuit.sources
    place = {name: i for i, name in enumerate(readings.names)}
    X, U, E = (np.zeros(part.shape[1]) for part in (readings.X, readings.U, readings.E))
    ends = (
        (("i", control.plus, 1.0),)
        if not control.minus
        else (("v", control.plus, 1.0), ("v", control.minus, -1.0))
    )
    for kind, name, sign in ends:
        if (kind, name) != ("v", GROUND):
            row = place[f"{kind}({name})"]
            X, U, E = X + sign * readings.X[row], U + sign * readings.U[row], E + sign * readings.E[row]
    threshold, width = float(control.threshold), float(control.hysteresis)
    E[sources.names.index(ONE)] -= threshold - width if closed else threshold + width
    z = np.concatenate([X, E @ sources.output])
    return (z, U) if closed else (-z, -U)
