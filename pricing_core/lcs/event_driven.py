"""Simulation from event to event (11.78): exact flow in a mode, the event located, the next mode selected, the jump."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.lcs.accumulation import Accumulation
from pricing_core.lcs.autonomous import autonomous_form
from pricing_core.lcs.contact_order import depends_on_order
from pricing_core.lcs.flow import evaluate, evaluate_each, flow_at, flow_of_each
from pricing_core.lcs.flow_to_event import FlowEnd, FlowToEvent
from pricing_core.lcs.guards import Guards
from pricing_core.lcs.landing import Landings
from pricing_core.lcs.mode_dynamics import ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector
from pricing_core.lcs.one_step_uniqueness import has_unique_steps
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.run_record import RunRecord
from pricing_core.lcs.simulation_method import EventDriven
from pricing_core.lcs.slow_part import NOTHING
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Event, EventKind, Trajectory


def drive_by_events(
    system: LCS,
    x0: Vector,
    t_span: tuple[float, float],
    t_eval: Vector | None,
    method: EventDriven,
    interrupt: Callable[[], bool] | None,
) -> Trajectory:
    """Simulate from x0 over t_span from event to event; see `simulate`."""
    form = autonomous_form(system)
    record = RunRecord(form, method.max_events)
    selector = ModeSelector(form, has_unique_steps(form), method.on_nonunique)
    status = EventRun(record, selector, t_span, method, interrupt).simulate(x0)
    return assembled(record, status, t_eval, system if method.rebound is None else None)


def assembled(
    record: RunRecord,
    status: Literal["finished", "interrupted"],
    t_eval: Vector | None,
    system: LCS | None,
) -> Trajectory:
    """Return the trajectory of the flows and events noted, at t_eval or at the ends of all steps."""
    flows = tuple(record.flows)
    if t_eval is None:  # the time of an event twice, before and after it
        each = [np.array([*flow.times, flow.end]) for flow in flows]
        times, x, u, y = evaluate_each(flows, each)
        flow_of = flow_of_each(each)
    else:
        times = t_eval[t_eval <= flows[-1].end]
        x, u, y = evaluate(flows, times)
        flow_of = flow_at(flows, times)
    return Trajectory(
        t=times,
        x=x,
        u=u,
        y=y,
        events=tuple(record.events),
        status=status,
        scheme="event-driven",
        accepted=sum(len(flow.times) for flow in flows),
        rejected=0,
        forced=0,
        system=system,
        flows=flows,
        flow_of=flow_of,
    )


class Reached(NamedTuple):
    """The state at the end of a mode's flow, and the guards that end the configuration there."""

    time: float
    dynamics: ModeDynamics
    c: State
    guards: tuple[int, ...] = ()


@dataclass(slots=True, eq=False)
class EventRun:
    """One event-driven simulation in progress.

    Parameters
    ----------
    record : RunRecord
    selector : ModeSelector
    span : (float, float)
    method : EventDriven
    interrupt : callable, optional
    guards : Guards, optional
        What ends `follow` besides time.
    """

    record: RunRecord
    selector: ModeSelector
    span: tuple[float, float]
    method: EventDriven
    interrupt: Callable[[], bool] | None
    guards: Guards | None = None
    flow: FlowToEvent = field(init=False)
    landings: Landings = field(init=False)
    accumulation: Accumulation = field(init=False)

    def __post_init__(self) -> None:
        self.flow = FlowToEvent(self.record, self.selector, self.span, self.interrupt, self.guards)
        self.landings = Landings(self.record, self.selector, self.method.rebound)
        self.accumulation = Accumulation(self.record, self.selector, self.span)

    def simulate(self, x0: Vector) -> Literal["finished", "interrupted"]:
        """Simulate from x0 over the whole span, with the inputs of the system."""
        (t0, t1), form = self.span, self.record.form
        knots = form.knots(t0, t1)
        x = x0
        mode: IndexSet = ()
        for begin, end in zip([t0, *knots], [*knots, t1], strict=True):
            reached = self.follow(*self.enter(x, begin, mode, "input" if begin > t0 else None), begin, end)
            if reached is None:
                return "interrupted"
            x, mode = self.record.state(reached.dynamics.basis @ reached.c.z), reached.dynamics.mode
        return "finished"

    def enter(
        self, x: Vector, t: float, near: IndexSet, kind: EventKind | None
    ) -> tuple[ModeDynamics, State]:
        """Go on from x at t with the inputs as they are just after it."""
        return self.enter_whole(self.record.form.state_after(x, t), t, near, kind)

    def enter_whole(
        self, xw: Vector, t: float, near: IndexSet, kind: EventKind | None
    ) -> tuple[ModeDynamics, State]:
        """Go on from (x, w) at t, w the states of the inputs."""
        z = xw / self.record.form.units.state
        state = State(z, np.full(z.size, float(np.abs(z).max(initial=0.0))))
        return self._enter(state, t, near, kind, None)

    def follow(self, dynamics: ModeDynamics, c: State, t: float, end: float) -> Reached | None:
        """Go from event to event up to `end` or a guard; return what is reached, None if interrupted."""
        accumulation = self.accumulation
        while True:
            reached = self.flow.follow(dynamics, c, t, end)
            if reached is None:
                return None
            accumulation.stalled = accumulation.stalled + 1 if reached.time == t else 0
            t, c = reached.time, reached.c
            if not reached.crossed and t >= end:
                return Reached(t, dynamics, c)
            pairs = dynamics.outputs.shape[0]
            guards = tuple(i - pairs for i in reached.crossed if i >= pairs)
            if guards:
                return Reached(t, dynamics, c, guards)
            if not reached.crossed:
                slow = self.selector.slow_part(dynamics)
                assert slow is not None  # the fast part has died out
                dynamics, c = slow.dynamics, State(slow.take @ c.z, np.abs(slow.take) @ c.sizes)
                continue
            state = dynamics.leave(c)
            near = tuple(sorted({*dynamics.mode}.symmetric_difference(reached.crossed)))
            beyond = accumulation.past(state, t, near, end)
            if beyond is None:
                dynamics, c = self._enter(state, t, near, "switch", (dynamics.mode, reached))
                beyond = accumulation.beyond_limit(dynamics, c, t, end)
            if beyond is not None:
                dynamics, c, t = beyond

    def _enter(
        self,
        state: State,
        t: float,
        near: IndexSet,
        kind: EventKind | None,
        met: tuple[IndexSet, FlowEnd] | None,
    ) -> tuple[ModeDynamics, State]:
        """Select the mode that goes on from z, jump into it, and note the event; return dynamics and coordinates.

        `met` is the mode that was left and how; `kind` is None at the start.
        """
        check_size(state.z, t)
        if float(np.abs(state.z).max(initial=0.0)) < NOTHING:
            state = State(np.zeros_like(state.z), np.zeros_like(state.z))
        left, crossed, is_low = (None, [], False) if met is None else (met[0], met[1].crossed, met[1].is_low)
        at_start = kind is None
        landing = self.landings.at_rest(state, near) if is_low else None
        if landing is None:
            landing = self.landings.land(state, t, near, left)
        dynamics, c, after, impulse, multiplicity = landing
        if multiplicity > 0:
            kind = "jump"
        if kind is None or (kind == "switch" and left == dynamics.mode):
            return dynamics, c
        before = left if left is not None else near
        self.record.note(
            Event(
                t,
                kind,
                self.record.state(state.z),
                self.record.state(after.z),
                impulse,
                None if at_start else before,
                dynamics.mode,
                multiplicity,
                order_sensitive=multiplicity > 0
                and depends_on_order(self.selector, state, left or (), tuple(crossed), at_start),
            )
        )
        return dynamics, c
