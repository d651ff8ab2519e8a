"""The periodic steady state of a circuit: a fixed point of the map over one period, found by Newton's method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector, as_number
from pricing_core.errors import InvalidInputError, MissingInputError, NotFoundError, NumericalError
from pricing_core.lcs import EventDriven, Exosystem, PiecewiseConstant, Trajectory
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.sensitivity import end_by_start
from pricing_core.lcs.switched import Positions
from pricing_core.models.circuits.assembly import initial_states
from pricing_core.models.circuits.elements import Capacitor, Inductor
from pricing_core.models.circuits.run import CircuitRun, read_run
from pricing_core.models.circuits.signals import Sine
from pricing_core.models.circuits.sources import CurrentSource, VoltageSource
from pricing_core.models.circuits.switched_circuit import SwitchedCircuit, SwitchedRecord
from pricing_core.models.circuits.switches import Pulse

SETTLING = (
    5  # periods from the start before Newton's method; twice as many each time that its steps do not help
)
MOST_STEPS = 60
PATIENCE = 6  # steps that do not help: between modes the change may grow for a while
DIFFERENCE = 1e-6  # share of the states by which they are moved where the derivative is not known
LOOSE = 1e3  # times the tolerance, where no step changes less: rounding
KEEPS = 1e-9  # how far from 1 a multiplier is 1
WHOLE = 1e-9  # how closely a period must hold whole periods of every source


@dataclass(frozen=True, slots=True, eq=False)
class SteadyState:
    """A periodic solution.

    Parameters
    ----------
    run : CircuitRun
        Over one period.
    period : float
        Seconds.
    x0 : Vector, shape (m,)
        The voltages of all capacitors and the currents of all inductors at its start, as `run.circuit.state_names`.
    multipliers : array of complex, shape (m,)
        Eigenvalues of the derivative of the map over one period (Floquet multipliers), the largest first.
    residual : float
        The largest change of an entry of x0 over the period, as a share of the largest that the entry's kind takes.
    iterations : int
        Steps of Newton's method.
    """

    run: CircuitRun
    period: float
    x0: Vector
    multipliers: NDArray[np.complex128]
    residual: float
    iterations: int

    @property
    def is_stable(self) -> bool:
        """Whether small disturbances die out: all multipliers lie inside the unit circle."""
        return bool((np.abs(self.multipliers) < 1.0).all())

    def efficiency(self, loads: Sequence[str], sources: Sequence[str]) -> float:
        """Return the power into the loads as a share of that which the sources give."""
        given = -sum(self.run.power(name) for name in sources)
        return sum(self.run.power(name) for name in loads) / given


@dataclass(slots=True, eq=False)
class PeriodMap:
    """The map from s at a period's start to s at its end, with the positions of state-controlled switches."""

    circuit: SwitchedCircuit
    span: tuple[float, float]
    method: EventDriven
    positions: Positions

    def run(self, s: Vector) -> tuple[Trajectory, SwitchedRecord]:
        """Return a period from s."""
        ends = np.array(self.span)
        return self.circuit.simulate(self.span, s, self.method, ends, None, self.positions)

    def after(self, s: Vector) -> tuple[Vector, Positions]:
        """Return s and the positions a period later."""
        trajectory, record = self.run(s)
        return _end(trajectory.flows[-1]), record.positions[-1]

    def derivative(self, trajectory: Trajectory, record: SwitchedRecord, s: Vector) -> Matrix:
        """Return the derivative of the map, exact where every event of the period allows it."""
        flows, m = trajectory.flows, s.size
        known = dict(zip(map(id, flows), record.positions, strict=True))
        find = self.circuit.find

        def carry(flow: Flow, following: Flow) -> Matrix:
            z = flow.dynamics.basis
            if following.form is not flow.form:
                before = find(known[id(flow)], self.method.on_nonunique)
                after = find(known[id(following)], self.method.on_nonunique)
                z = (after.into @ before.out @ z) / following.form.units.state[:, None]
            return np.asarray(following.dynamics.coordinates @ z)

        start = find(record.positions[0], self.method.on_nonunique)
        p = start.into.shape[1] - m
        into = start.into @ np.eye(m + p, m) / flows[0].form.units.state[:, None]
        change = end_by_start(flows, carry, flows[0].dynamics.coordinates @ into)
        if change is None or not np.isfinite(change).all():
            return self._differences(s)
        last = find(record.positions[-1], self.method.on_nonunique)
        return np.asarray((last.out @ flows[-1].dynamics.basis @ change)[:m])

    def _differences(self, s: Vector) -> Matrix:
        here = self.after(s)[0]
        size = float(np.abs(s).max(initial=0.0)) or 1.0
        columns = []
        for j in range(s.size):
            moved = s.copy()
            moved[j] += DIFFERENCE * max(abs(s[j]), 1e-3 * size)
            columns.append((self.after(moved)[0] - here) / (moved[j] - s[j]))
        return np.column_stack(columns)


def find_steady_state(
    circuit: SwitchedCircuit,
    ends: dict[str, tuple[str, str]],
    period: float | None,
    x0: Vector | None,
    method: EventDriven,
    tolerance: float,
) -> SteadyState:
    """Return the periodic solution; see `DiodeCircuit.steady_state`."""
    length = _period(circuit, period)
    start = _settled_from(circuit, length)
    s = initial_states(circuit.elements) if x0 is None else x0
    span = start, start + length
    _check_repeats(circuit, span)
    turn = PeriodMap(circuit, span, method, circuit.start_positions())
    kinds = np.array(
        [isinstance(e, Capacitor) for e in circuit.elements if isinstance(e, Capacitor | Inductor)],
        dtype=bool,
    )
    s, best, least = _settled(turn, s, SETTLING), s, np.inf
    patience, periods = PATIENCE, SETTLING
    for iteration in range(MOST_STEPS):
        trajectory, record = turn.run(s)
        change = _end(trajectory.flows[-1]) - s
        size = _size(change, s, kinds) if record.positions[-1] == turn.positions else np.inf
        if size <= tolerance or (patience == 0 and least <= LOOSE * tolerance):  # the second is rounding
            return _found(turn, s if size <= least else best, ends, min(size, least), iteration)
        patience = PATIENCE if size < least else patience - 1
        best, least = (s, size) if size < least else (best, least)
        if patience < 0:
            periods, patience = 2 * periods, PATIENCE
            s = _settled(turn, best, periods)
            continue
        derivative = turn.derivative(trajectory, record, s)
        kept = _kept(derivative, change, record)
        if kept and iteration >= PATIENCE:
            raise NotFoundError(
                f"no periodic solution of period {length:g} s: {kept} keeps what it gains in a period. Let no mean "
                "voltage lie across an inductor, and no mean current flow into a capacitor, without a resistance"
            )
        step = np.linalg.lstsq(derivative - np.eye(s.size), -change)[0]
        try:  # the step may lead to a state that nothing holds in: a period later it does
            s, turn.positions = turn.after(s + step)
        except NumericalError:
            s = _settled(turn, s, periods)
    raise NotFoundError(
        f"no periodic solution of period {length:g} s was found in {MOST_STEPS} steps of Newton's method: the best "
        f"state changes by {least:.1e} of its size in a period; nothing proved. Give x0 nearer to it, or a multiple of "
        "the period"
    )


def _kept(derivative: Matrix, change: Vector, record: SwitchedRecord) -> str:
    """Return the states that a period adds to without looking at them, none where there are none."""
    values, left = np.linalg.eig(derivative.T)
    for value, row in zip(values, left.T, strict=True):
        gained = abs(row @ change)
        if abs(value - 1.0) <= KEEPS and gained > 0.1 * float(np.abs(row) @ np.abs(change)) > 0.0:
            names = record.state_names
            return ", ".join(names[j] for j in np.flatnonzero(np.abs(row) > 0.1 * np.abs(row).max()))
    return ""


def _found(
    turn: PeriodMap, s: Vector, ends: dict[str, tuple[str, str]], residual: float, steps: int
) -> SteadyState:
    trajectory, record = turn.run(s)
    whole = trajectory.refined(1)
    derivative = turn.derivative(trajectory, record, s)
    multipliers = np.linalg.eigvals(derivative).astype(np.complex128)
    order = np.argsort(-np.abs(multipliers))
    run = read_run(record, whole, turn.span[0], ends, from_elements=False)
    return SteadyState(run, turn.span[1] - turn.span[0], s, multipliers[order], residual, steps)


def _settled(turn: PeriodMap, s: Vector, periods: int) -> Vector:
    """Return the state some periods later, and keep the positions that hold there."""
    for _ in range(periods):
        s, turn.positions = turn.after(s)
    return s


def _end(flow: Flow) -> Vector:
    return flow.form.reported(flow.dynamics.basis @ flow.coordinates_at(flow.end))


def _size(change: Vector, s: Vector, kinds: BoolVector) -> float:
    """Return the largest change, as a share of the largest voltage or current of all."""
    worst = 0.0
    for kind in (kinds, ~kinds):
        if kind.any():
            size = float(np.abs(s[kind]).max()) + float(np.abs(change[kind]).max())
            worst = max(worst, float(np.abs(change[kind]).max()) / max(size, 1e-300))
    return worst


def _period(circuit: SwitchedCircuit, period: float | None) -> float:
    if period is not None:
        length = as_number("period", period)
        if length <= 0.0:
            raise InvalidInputError("period", period, "a positive number of seconds")
        return length
    found = [switch.control.period for switch in circuit.switches if isinstance(switch.control, Pulse)]
    for element in circuit.elements:
        if isinstance(element, VoltageSource | CurrentSource):
            if isinstance(element.value, Sine):
                found.append(1.0 / element.value.frequency)
            elif isinstance(element.value, Exosystem) and element.value.period is not None:
                found.append(element.value.period)
    if not found:
        raise MissingInputError("period", "no source or control is periodic")
    return max(found)


def _settled_from(circuit: SwitchedCircuit, period: float) -> float:
    """Return the first multiple of the period from which on all sources and controls are periodic."""
    latest = [0.0]
    for switch in circuit.switches:
        if isinstance(switch.control, Pulse):
            latest.append(switch.control.delay)
        elif isinstance(switch.control, PiecewiseConstant):
            latest += switch.control.jumps[-1:].tolist()
    for element in circuit.elements:
        value = element.value if isinstance(element, VoltageSource | CurrentSource) else None
        if isinstance(value, Exosystem) and value.period is not None:
            latest.append(float(value.times[1]))
        elif isinstance(value, Exosystem | PiecewiseConstant):
            latest += value.jumps[-1:].tolist()
    return period * math.ceil(max(latest) / period - WHOLE)


def _check_repeats(circuit: SwitchedCircuit, span: tuple[float, float]) -> None:
    """Refuse a period after which sources and controls do not begin anew."""
    start, length = span[0], span[1] - span[0]
    ends = circuit.schedule((start - length / 2.0, start + 2.5 * length))
    once, twice = (
        ends.times[(ends.times > begin - WHOLE * length) & (ends.times < begin + (1.0 - WHOLE) * length)]
        - begin
        for begin in (start, start + length)
    )
    signal = circuit.signal
    w = signal.states_along(np.array([start, start + length]), np.zeros(2, dtype=bool))
    same = once.size == twice.size and np.allclose(once, twice, rtol=0.0, atol=WHOLE * length)
    same = same and np.allclose(
        w[0], w[1], rtol=0.0, atol=WHOLE * max(float(np.abs(w).max(initial=0.0)), 1e-300)
    )
    if not same:
        raise InvalidInputError("period", length, "a whole number of periods of every source and control")
