"""Systems that follow each other: what switches carry over is s, and each configuration has its own x = W s.

A configuration lasts up to a given instant, or up to where one of its guards becomes negative, which is located in the
flow as every other event is. At the change the state s goes to W s of the new configuration, and from there as (11.78)
says: W annihilates what the new constraints take away in an instant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pricing_core.arrays import BoolVector, IndexSet, Matrix, Vector
from pricing_core.errors import IterationLimitError
from pricing_core.lcs.accumulation import Accumulation
from pricing_core.lcs.autonomous import AutonomousForm, autonomous_form
from pricing_core.lcs.event_driven import EventRun, assembled
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.guards import Guards, signs_of
from pricing_core.lcs.mode_dynamics import ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector, OnNonUnique
from pricing_core.lcs.one_step_uniqueness import has_unique_steps
from pricing_core.lcs.run_record import RunRecord
from pricing_core.lcs.simulation_method import EventDriven
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Event, Trajectory

Positions: TypeAlias = tuple[bool, ...]

STILL = 1e-12  # share of the largest entry of s, and 1e-9 of its own, below which an entry has not jumped
OWN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Configuration:
    """The system that holds for one position of all switches.

    Parameters
    ----------
    system : LCS
        With states x and exosystems w as its inputs.
    entry : Matrix, shape (n, m)
        W: x = W s.
    carried : Matrix, shape (m, n + p)
        s as a function of (x, w).
    exchanged : tuple of int
        The pairs whose u and y are exchanged in what is reported.
    guards : Guards
        Which are not negative while it lasts.
    switches : tuple of int
        Which switch each guard stands for: it changes its position where the guard falls.
    """

    system: LCS
    entry: Matrix
    carried: Matrix
    exchanged: IndexSet
    guards: Guards
    switches: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """The instants at which the configuration changes by the clock.

    Parameters
    ----------
    times : Vector, shape (r,)
        Increasing, inside the span: where switches change by the clock, and where sources start anew.
    closed : array of bool, shape (r + 1, switches)
        The positions before the first of these times, and after each of them; False for those that the state controls.
    by_state : array of bool, shape (switches,)
    inputs : Matrix, shape (r + 1, p)
        w at the start, and just after each of the times: the states of the sources.
    """

    times: Vector
    closed: NDArray[np.bool_]
    by_state: BoolVector
    inputs: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class PreparedConfiguration:
    """A configuration in the units of its flows, with what runs have found of its modes.

    Parameters
    ----------
    configuration : Configuration
    form : AutonomousForm
    selector : ModeSelector
    into : Matrix, shape (n + p, m + p)
        (x, w) as a function of (s, w).
    out : Matrix, shape (m + p, n + p)
        (s, w) as a function of z in the form's units.
    """

    configuration: Configuration
    form: AutonomousForm
    selector: ModeSelector
    into: Matrix
    out: Matrix


def prepared(configuration: Configuration, on_nonunique: OnNonUnique) -> PreparedConfiguration:
    """Return the configuration, ready for runs."""
    form = replace(
        autonomous_form(configuration.system),
        readout=configuration.carried,
        exchanged=configuration.exchanged,
    )
    n, p = configuration.entry.shape[0], configuration.carried.shape[1] - configuration.entry.shape[0]
    return PreparedConfiguration(
        configuration,
        form,
        ModeSelector(form, has_unique_steps(form), on_nonunique),
        block_diag(configuration.entry, np.eye(p)),
        np.vstack([configuration.carried, np.eye(n + p)[n:]]) * form.units.state,
    )


@dataclass(slots=True, eq=False)
class _Leg:
    """A configuration in one run."""

    known: PreparedConfiguration
    run: EventRun

    @property
    def configuration(self) -> Configuration:
        """The configuration as it was given."""
        return self.known.configuration

    def left(self, dynamics: ModeDynamics, c: State) -> Vector:
        """Return (s, w)."""
        return np.asarray(self.known.out @ (dynamics.basis @ c.z))

    def fallen(self, dynamics: ModeDynamics, c: State) -> tuple[int, ...]:
        """Return the guards that do not hold just after the coordinates are c."""
        if not self.configuration.switches:
            return ()
        rows = self.run.flow.watched(dynamics)[dynamics.outputs.shape[0] :]
        return tuple(np.flatnonzero(signs_of(rows, dynamics, c) < 0.0).tolist())


@dataclass(slots=True, eq=False)
class SwitchedRun:
    """A simulation of systems that follow each other.

    Parameters
    ----------
    find : callable
        The configuration for the positions of all switches.
    schedule : Schedule
    span : (float, float)
    method : EventDriven
        Its max_events counts what the clock does not say.
    interrupt : callable, optional
    name : callable
        What a switch is called in messages.
    """

    find: Callable[[Positions], PreparedConfiguration]
    schedule: Schedule
    span: tuple[float, float]
    method: EventDriven
    interrupt: Callable[[], bool] | None
    name: Callable[[int], str]
    positions: Positions  # at the start, of those that the state controls
    legs: dict[Positions, _Leg] = field(default_factory=dict, init=False)
    flows: list[Flow] = field(default_factory=list, init=False)
    held: list[Positions] = field(default_factory=list, init=False)  # the positions in each flow
    events: list[Event] = field(default_factory=list, init=False)
    met: int = field(default=0, init=False)  # events that the clock did not set

    def simulate(self, s: Vector, t_eval: Vector | None) -> tuple[Trajectory, tuple[Positions, ...]]:
        """Return the run from s, and the positions of the switches in each of its flows."""
        (t0, t1), schedule = self.span, self.schedule
        near: IndexSet = ()
        status: Literal["finished", "interrupted"] = "finished"
        for i, (t, end) in enumerate(zip([t0, *schedule.times], [*schedule.times, t1], strict=True)):
            clock = schedule.closed[i].tolist()
            self.positions = tuple(
                own if by_state else set_
                for own, set_, by_state in zip(self.positions, clock, schedule.by_state, strict=True)
            )
            sw = np.concatenate([s, schedule.inputs[i]])
            reached = self._segment(sw, float(t), float(end), near, at_start=i == 0)
            if reached is None:
                status = "interrupted"
                break
            s, near = reached[0][: s.size], reached[1]
        record = next(iter(self.legs.values())).run.record
        record.flows, record.events = self.flows, self.events
        return assembled(record, status, t_eval, None), tuple(self.held)

    def _segment(
        self, sw: Vector, t: float, end: float, near: IndexSet, *, at_start: bool
    ) -> tuple[Vector, IndexSet] | None:
        """Go on from (s, w) up to `end`, through whatever the state switches; `near` is the mode, as it is reported."""
        kind: Literal["input"] | None = (
            None if at_start else "input"
        )  # positions taken at the start are no event
        passed: set[Positions] = set()  # at this instant
        while True:
            leg, found, following = self._leg(t, end), list[Event](), list[Event]()
            record = leg.run.record
            record.events = found
            dynamics, c = leg.run.enter_whole(leg.known.into @ sw, t, record.form.reported_mode(near), kind)
            self._note(found, sw, leg.left(dynamics, c))
            passed.add(self.positions)
            fallen = leg.fallen(dynamics, c)
            if not fallen:
                record.events = following
                reached = leg.run.follow(dynamics, c, t, end)
                self.events += following
                self.held += [self.positions] * (len(self.flows) - len(self.held))
                self.met += len(following)
                self._check_count(t)
                if reached is None:
                    return None
                kind = "input"
                passed = passed if reached.time == t else set()
                t, dynamics, c, fallen = reached
            sw, near = leg.left(dynamics, c), record.form.reported_mode(dynamics.mode)
            if not fallen:
                return sw, near
            self.met += 1
            self._flip(leg, fallen, passed, t)

    def _flip(self, leg: _Leg, fallen: tuple[int, ...], passed: set[Positions], t: float) -> None:
        flipped = {leg.configuration.switches[i] for i in fallen}
        self.positions = tuple(on ^ (i in flipped) for i, on in enumerate(self.positions))
        if self.positions in passed:
            names = ", ".join(self.name(i) for i in sorted(flipped))
            raise IterationLimitError(
                f"the state turns {names} on and off without end at t = {t:.12g}: give the control a hysteresis, or "
                "a wider one"
            )

    def _leg(self, t: float, end: float) -> _Leg:
        if self.positions not in self.legs:
            known = self.find(self.positions)
            record = RunRecord(known.form, self.method.max_events, self.flows)
            guards = known.configuration.guards if known.configuration.switches else None
            run = EventRun(record, known.selector, self.span, self.method, self.interrupt, guards)
            self.legs[self.positions] = _Leg(known, run)
        leg = self.legs[self.positions]
        leg.run.accumulation = Accumulation(leg.run.record, leg.run.selector, (t, end))
        leg.run.record.first_event = np.inf
        return leg

    def _note(self, found: list[Event], before: Vector, after: Vector) -> None:
        """Note the event of a change, a jump where s does."""
        before, after = (sw[: sw.size - self.schedule.inputs.shape[1]] for sw in (before, after))
        change, sizes = np.abs(after - before), np.maximum(np.abs(before), np.abs(after))
        jumps = bool((change > np.maximum(OWN * sizes, STILL * sizes.max(initial=0.0))).any())
        for event in found:
            kind: Literal["jump", "input"] = "jump" if jumps else "input"
            count = max(event.multiplicity, 1) if jumps else 0
            self.events.append(replace(event, kind=kind, x_before=before, x_after=after, multiplicity=count))

    def _check_count(self, t: float) -> None:
        if self.met > self.method.max_events:
            raise IterationLimitError(
                f"{self.method.max_events} events by t = {t:.12g} besides those of the clock: raise max_events"
            )
