"""Simulation from event to event (11.78): exact flow in a mode, the event located, the next mode selected, the jump."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.errors import InfeasibleError, IterationLimitError, ZenoError
from pricing_core.lcs.autonomous import AutonomousForm, autonomous_form
from pricing_core.lcs.contact_order import depends_on_order
from pricing_core.lcs.event_location import Crossing, first_crossing, touching_places
from pricing_core.lcs.flow import Flow, evaluate
from pricing_core.lcs.mode_dynamics import ModeDynamics
from pricing_core.lcs.mode_selection import ModeSelector
from pricing_core.lcs.multipliers import least_norm_multipliers
from pricing_core.lcs.one_step_uniqueness import has_unique_steps
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.simulation_method import EventDriven
from pricing_core.lcs.slow_part import NOTHING
from pricing_core.lcs.stored_energy import with_energy_lost
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Event, EventKind, Trajectory
from pricing_core.lcs.zeno import ZenoLimit, zeno_limit

CROSSES = 1e-11  # of an output's size: how far below zero counts
TOUCHES = 1e-9  # of an output's size: how close to zero counts as contact
MOST_REINITIALISATIONS = 50  # at one instant
AT_THE_END = 1e-13  # of the interval
MOST_STEPS = 100_000  # Taylor polynomials


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
    selector = ModeSelector(form, has_unique_steps(form), method.on_nonunique)
    run = _Run(form, selector, t_span, method, interrupt)
    status = run.simulate(x0)
    flows = tuple(run.flows)
    times = np.concatenate([[*flow.times, flow.end] for flow in flows]) if t_eval is None else t_eval
    times = times[times <= flows[-1].end]
    if t_eval is None:  # the time of an event twice, before and after it
        parts = [flow.at(np.array([*flow.times, flow.end])) for flow in flows]
        x, u, y = (np.concatenate(part) for part in zip(*parts, strict=True))
    else:
        x, u, y = evaluate(flows, times)
    u, y = least_norm_multipliers(system, u, y)
    return Trajectory(
        t=times,
        x=x,
        u=u,
        y=y,
        events=with_energy_lost(system, run.events),
        status=status,
        scheme="event-driven",
        accepted=sum(len(flow.times) for flow in flows),
        rejected=0,
        forced=0,
        flows=flows,
    )


class _Landing(NamedTuple):
    """A mode, and where a state comes to in it."""

    dynamics: ModeDynamics
    c: Vector
    z: Vector
    impulse: Vector
    multiplicity: int


@dataclass(slots=True, eq=False)
class _Run:
    """One simulation under way."""

    form: AutonomousForm
    selector: ModeSelector
    span: tuple[float, float]
    method: EventDriven
    interrupt: Callable[[], bool] | None
    flows: list[Flow] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    steps: int = 0

    def simulate(self, x0: Vector) -> Literal["finished", "interrupted"]:
        t0, t1 = self.span
        knots = self.form.knots(t0, t1)
        x = x0
        mode: IndexSet = ()
        for begin, end in zip([t0, *knots], [*knots, t1], strict=True):
            z = self.form.state_after(x, begin) / self.form.units.state
            entered = self._enter(z, begin, mode, None if begin == t0 else "input", begin == t0, ())
            reached = self._follow(*entered, begin, end)
            if reached is None:
                return "interrupted"
            dynamics, c = reached
            x, mode = self._state(dynamics.basis @ c), dynamics.mode
        return "finished"

    def _follow(
        self, dynamics: ModeDynamics, c: Vector, t: float, end: float
    ) -> tuple[ModeDynamics, Vector] | None:
        """Go from event to event up to `end`; return the mode and its coordinates there, None if interrupted."""
        while True:
            flow, crossing = self._flow(dynamics, c, t, end)
            if flow is None:
                return None
            c = flow.coordinates.pop()
            t = flow.end
            if crossing is None and t < end:
                slow = self.selector.slow_part(dynamics)
                assert slow is not None  # the fast part has died out
                dynamics, c = slow.dynamics, slow.take @ c
                continue
            if crossing is None:
                return dynamics, c
            z = dynamics.basis @ c
            near = tuple(sorted(set(dynamics.mode) ^ set(crossing.outputs)))
            dynamics, c = self._enter(z, t, near, "switch", False, crossing.outputs, dynamics.mode)
            limit = zeno_limit(self.events, end)
            if limit is not None:
                dynamics, c, t = self._beyond(limit, dynamics, c)

    def _flow(
        self, dynamics: ModeDynamics, c: Vector, t: float, end: float
    ) -> tuple[Flow | None, Crossing | None]:
        """Flow until an output crosses zero, the fast part has died out, or the interval ends.

        The last coordinates are those at the flow's end. What crosses zero at a knot of the input is left to the
        input after the knot.
        """
        slow = self.selector.slow_part(dynamics)
        flow = Flow(self.form, dynamics, t, t)
        self.flows.append(flow)
        rate = self.form.units.rate
        length = dynamics.step / rate
        sizes = np.linalg.norm(dynamics.outputs, axis=1)
        t0, t1 = self.span
        close = max(AT_THE_END * (t1 - t0), 4.0 * float(np.spacing(max(abs(t0), abs(t1)))))
        while True:
            self._count_step(t)
            flow.times.append(t)
            flow.coordinates.append(c)
            if self.interrupt is not None and self.interrupt():
                flow.end = t
                return None, None
            reach = min(1.0, (end - t) / length) if end > t else 0.0
            terms = dynamics.expansion(c)
            check_size(terms, t)
            polynomials = terms @ dynamics.outputs.T
            tolerances = CROSSES * np.maximum(sizes * float(np.linalg.norm(c)), 1e-290)
            crossing = first_crossing(polynomials, reach, tolerances)
            place = reach if crossing is None else crossing.place
            self._note_touching(polynomials, place, tolerances, flow, (t, length), terms)
            c = place ** np.arange(terms.shape[0]) @ terms
            t = end if crossing is None and reach < 1.0 else t + (place * length if place > 0.0 else 0.0)
            if t >= end - close and (crossing is None or end < t1):
                t = end
                crossing = self._crossing_at_end(dynamics, c) if end == t1 else None
            if crossing is not None or t >= end or (slow is not None and slow.is_all_of(c)):
                flow.end = t
                flow.coordinates.append(c)
                return flow, crossing

    def _crossing_at_end(self, dynamics: ModeDynamics, c: Vector) -> Crossing | None:
        """Return the outputs that are about to become negative at the end of the interval."""
        falling = np.flatnonzero(dynamics.initial_signs(c) < 0.0)
        return Crossing(0.0, tuple(falling.tolist())) if falling.size else None

    def _enter(
        self,
        z: Vector,
        t: float,
        near: IndexSet,
        kind: EventKind | None,
        at_start: bool,
        crossed: tuple[int, ...],
        left: IndexSet | None = None,
    ) -> tuple[ModeDynamics, Vector]:
        """Select the mode that goes on from z, jump into it, and note the event; return dynamics and coordinates."""
        check_size(z, t)
        if float(np.max(np.abs(z), initial=0.0)) < NOTHING:
            z = np.zeros_like(z)
        before = z
        landing = self._land(z, t, near, left)
        if landing.multiplicity > 0:
            kind = "jump"
            if self.method.rebound is not None:
                contacts = self._contacts(before)
                x, impulse = self.method.rebound(self._state(before), self._state(landing.z), contacts)
                z = self.form.state_after(x, t) / self.form.units.state
                again = self._land(z, t, landing.dynamics.mode, None)
                landing = again._replace(impulse=impulse + again.impulse, multiplicity=landing.multiplicity)
        dynamics, c, z, impulse, multiplicity = landing
        if kind is None or (kind == "switch" and left == dynamics.mode):
            return dynamics, c
        self._note(
            Event(
                t,
                kind,
                self._state(before),
                self._state(z),
                impulse,
                None if at_start else (left if left is not None else near),
                dynamics.mode,
                multiplicity,
                order_sensitive=multiplicity > 0
                and depends_on_order(self.selector, before, left or (), crossed, at_start),
            )
        )
        return dynamics, c

    def _land(self, z: Vector, t: float, near: IndexSet, left: IndexSet | None) -> _Landing:
        """Select the mode that goes on from z and jump into it, as often as it takes."""
        dynamics = self.selector.select(z, t, near, left)
        impulse, multiplicity = np.zeros(self.form.system.shape[1]), 0
        for _ in range(MOST_REINITIALISATIONS):
            c = dynamics.coordinates_of(z)
            if not dynamics.is_consistent(z):
                multiplicity += 1
                impulse += self._impulse(dynamics, z)
                z = dynamics.basis @ c
            if dynamics.continues(c):
                return _Landing(dynamics, c, z, impulse, multiplicity)
            dynamics = self.selector.select(z, t, dynamics.mode, dynamics.mode)
        raise IterationLimitError(
            f"{MOST_REINITIALISATIONS} reinitialisations at t = {t:.12g} lead to no mode that goes on"
        )

    def _contacts(self, z: Vector) -> IndexSet:
        """Return the pairs with y_i = C_i z = 0, to rounding."""
        C = self.form.system.C
        return tuple(
            np.flatnonzero(C @ z <= TOUCHES * np.linalg.norm(C, axis=1) * np.linalg.norm(z)).tolist()
        )

    def _impulse(self, dynamics: ModeDynamics, z: Vector) -> Vector:
        """Return the coefficients of delta in u, shape (k,)."""
        impulse = np.zeros(self.form.system.shape[1])
        mode = list(dynamics.mode)
        if dynamics.impulses.shape[0]:
            impulse[mode] = (dynamics.impulses[-1] @ z)[mode]
        return np.asarray(impulse * self.form.units.pair / self.form.units.rate)

    def _beyond(
        self, limit: ZenoLimit, dynamics: ModeDynamics, c: Vector
    ) -> tuple[ModeDynamics, Vector, float]:
        """Go on from the limit of infinitely many events."""
        inputs = self.form.state_after(limit.x, limit.time)
        z = inputs / self.form.units.state
        last = self._state(dynamics.basis @ c)
        try:
            following = self.selector.select(z, limit.time, dynamics.mode)
        except InfeasibleError as error:
            raise ZenoError(
                f"events accumulate at t = {limit.time:.12g}, each round {limit.ratio:.6g} times as long as the one "
                f"before, and nothing goes on from there: {error}"
            ) from error
        c = following.coordinates_of(z)
        none = np.zeros(self.form.system.shape[1])
        after = self._state(following.basis @ c)
        self._note(
            Event(
                limit.time,
                "zeno",
                last,
                after,
                none,
                dynamics.mode,
                following.mode,
                ratio=limit.ratio,
            )
        )
        return following, c, limit.time

    def _note_touching(
        self,
        polynomials: Matrix,
        reach: float,
        tolerances: Vector,
        flow: Flow,
        begin: tuple[float, float],
        terms: Matrix,
    ) -> None:
        """Note the outputs that touch zero on the way without crossing it."""
        t, length = begin
        for place in touching_places(polynomials, reach, tolerances):
            x = self._state(flow.dynamics.basis @ (place ** np.arange(terms.shape[0]) @ terms))
            none = np.zeros(self.form.system.shape[1])
            self._note(Event(t + place * length, "grazing", x, x, none, flow.mode, flow.mode))

    def _count_step(self, t: float) -> None:
        if self.steps == MOST_STEPS:
            raise IterationLimitError(
                f"{MOST_STEPS} steps by t = {t:.12g}, as long as the fastest motion allows, and events may follow: "
                "simulate a shorter interval, or one part of it after the other"
            )
        self.steps += 1

    def _note(self, event: Event) -> None:
        if len(self.events) == self.method.max_events:
            raise IterationLimitError(
                f"{self.method.max_events} events by t = {event.time:.12g}: raise max_events, or look for a Zeno point "
                "there"
            )
        self.events.append(event)

    def _state(self, z: Vector) -> Vector:
        return np.asarray((z * self.form.units.state)[: self.form.states])
