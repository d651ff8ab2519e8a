"""Simulation from event to event (11.78): exact flow in a mode, the event located, the next mode selected, the jump."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.errors import (
    IterationLimitError,
    NonUniqueError,
    NumericalError,
    ZenoError,
)
from pricing_core.lcs.autonomous import AutonomousForm, autonomous_form
from pricing_core.lcs.contact_order import depends_on_order
from pricing_core.lcs.event_location import Crossing, bernstein, first_crossing, touching_places
from pricing_core.lcs.flow import Flow, evaluate
from pricing_core.lcs.mode_dynamics import LADDER, POWERS, ModeDynamics, Shares, State
from pricing_core.lcs.mode_selection import ModeSelector, implicit_step
from pricing_core.lcs.multipliers import least_norm_multipliers
from pricing_core.lcs.one_step_uniqueness import has_unique_steps
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.simulation_method import EventDriven
from pricing_core.lcs.slow_part import NOTHING
from pricing_core.lcs.stored_energy import with_energy_lost
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Event, EventKind, Trajectory
from pricing_core.lcs.zeno import NEAR, ROUNDS, ZenoLimit, zeno_limit

CROSSES = 1e-11  # of an output's size: how far below zero counts
TOUCHES = 1e-9  # of an output's size: how close to zero counts as contact
MOST_REINITIALISATIONS = 50  # at one instant
MOST_AT_ONE_INSTANT = 10  # events, and 2 for each pair
MANY_EVENTS = 20  # and 4 for each pair
CROWDED = 1e-8  # of the interval: what so many events are a crowd in
LONGEST_LEAP = 1e-4  # of the interval
AT_THE_END = 1e-13  # of the interval
LOW = 64.0 * float(np.finfo(float).eps)  # of an output's size: how far above zero is rounding
FLIGHT = np.array([0.25, 0.5, 0.75])  # places at which the height of a flight is looked at
SHORT_STEPS = (1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9)  # in the form's units
SETTLING_STEPS = (1e-9, 1e-8, 1e-7, 1e-6)
FIRST_LOOK = (
    4  # steps of a flow after which it is asked whether anything can happen, and again after twice as many
)
AHEAD = 4.0  # least length, in steps, of what is passed at once
AGREES = 1e-11  # of the size: how closely the closed form must meet a Taylor polynomial


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
        system=system if method.rebound is None else None,
        flows=flows,
    )


class _Landing(NamedTuple):
    """A mode, and where a state comes to in it."""

    dynamics: ModeDynamics
    c: State
    z: State
    impulse: Vector
    multiplicity: int


class _Meeting(NamedTuple):
    """Why a mode is left: the outputs that cross zero, and whether none of them had left zero by more than rounding."""

    outputs: tuple[int, ...]
    left: IndexSet
    is_low: bool


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
    first_event: float = math.inf
    stalled: int = 0  # events at one instant
    passed: int = 0  # events before the last crowd of them ended
    passed_until: float = -math.inf
    leap: float = 0.0  # that was taken over it

    def simulate(self, x0: Vector) -> Literal["finished", "interrupted"]:
        t0, t1 = self.span
        knots = self.form.knots(t0, t1)
        x = x0
        mode: IndexSet = ()
        for begin, end in zip([t0, *knots], [*knots, t1], strict=True):
            z = self.form.state_after(x, begin) / self.form.units.state
            state = State(z, np.full(z.size, float(np.abs(z).max(initial=0.0))))
            entered = self._enter(state, begin, mode, None if begin == t0 else "input", begin == t0, None)
            reached = self._follow(*entered, begin, end)
            if reached is None:
                return "interrupted"
            dynamics, c = reached
            x, mode = self._state(dynamics.basis @ c.z), dynamics.mode
        return "finished"

    def _follow(
        self, dynamics: ModeDynamics, c: State, t: float, end: float
    ) -> tuple[ModeDynamics, State] | None:
        """Go from event to event up to `end`; return the mode and its coordinates there, None if interrupted."""
        while True:
            flow, c, crossing, is_low = self._flow(dynamics, c, t, end)
            if flow is None:
                return None
            self.stalled = self.stalled + 1 if flow.end == t else 0
            t = flow.end
            if crossing is None and t < end:
                slow = self.selector.slow_part(dynamics)
                assert slow is not None  # the fast part has died out
                dynamics, c = slow.dynamics, State(slow.take @ c.z, np.abs(slow.take) @ c.sizes)
                continue
            if crossing is None:
                return dynamics, c
            state = dynamics.leave(c)
            near = tuple(sorted(set(dynamics.mode) ^ set(crossing.outputs)))
            if self.stalled >= MOST_AT_ONE_INSTANT + 2 * self.form.system.shape[1]:
                dynamics, c = self._settle(state, t, near)
                continue
            if self._is_crowded(t):
                dynamics, c, t = self._step_over(state, t, near, end)
                continue
            meeting = _Meeting(crossing.outputs, dynamics.mode, is_low)
            dynamics, c = self._enter(state, t, near, "switch", False, meeting)
            if len(self.events) > ROUNDS and t - self.events[-2].time <= NEAR * (t - self.first_event):
                limit = zeno_limit(self.events, end)
                beyond = None if limit is None else self._beyond(limit, dynamics, c, t)
                if beyond is not None:
                    dynamics, c, t = beyond

    def _flow(
        self, dynamics: ModeDynamics, c: State, t: float, end: float
    ) -> tuple[Flow | None, State, Crossing | None, bool]:
        """Flow until an output crosses zero, the fast part has died out, or the interval ends.

        Returned are the coordinates at the flow's end, what crosses zero there, and whether that had not left zero by
        more than rounding. What crosses zero at a knot of the input is left to the input after the knot.
        """
        slow = self.selector.slow_part(dynamics)
        flow = Flow(self.form, dynamics, t, t)
        self.flows.append(flow)
        length = dynamics.step / self.form.units.rate
        t0, t1 = self.span
        close = max(AT_THE_END * (t1 - t0), 4.0 * math.ulp(max(abs(t0), abs(t1))))
        values, sizes = c
        while True:
            flow.times.append(t)
            flow.coordinates.append(values)
            if self.interrupt is not None and self.interrupt():
                flow.end = t
                return None, State(values, sizes), None, False
            if self._is_quiet(dynamics, State(values, sizes), end, flow):
                assert flow.closed is not None
                values = flow.closed.states(values, np.array([(end - t) * self.form.units.rate]))[0]
                check_size(values, end)
                flow.end = end
                return flow, State(values, np.maximum(sizes, np.abs(values))), None, False
            reach = min(1.0, (end - t) / length) if end > t else 0.0
            terms = dynamics.expansion(values)
            check_size(terms, t)
            polynomials = dynamics.output_expansion(values, terms)
            swept = np.asarray(reach**POWERS @ np.abs(terms))
            tolerances = CROSSES * np.maximum(dynamics.output_sizes @ np.maximum(sizes, swept), 1e-290)
            crossing, place = self._what_happens(polynomials, reach, tolerances, flow, (t, length), terms)
            powers = place**POWERS
            values, sizes = (
                np.asarray(powers @ terms),
                swept if crossing is None else np.asarray(powers @ np.abs(terms)),
            )
            is_low = crossing is not None and self._is_low(
                dynamics, State(values, sizes), polynomials if len(flow.times) == 1 else None, crossing
            )
            t = end if crossing is None and reach < 1.0 else t + (place * length if place > 0.0 else 0.0)
            if t >= end - close and (crossing is None or end < t1):
                t = end
                crossing = self._crossing_at_end(dynamics, State(values, sizes)) if end == t1 else None
            if crossing is not None or t >= end or (slow is not None and slow.is_all_of(values)):
                flow.end = t
                return flow, State(values, sizes), crossing, is_low

    def _is_quiet(self, dynamics: ModeDynamics, c: State, end: float, flow: Flow) -> bool:
        """Tell whether no output can reach zero up to `end`: the flow then knows its closed form."""
        count, rate = len(flow.times), self.form.units.rate
        length = (end - flow.times[-1]) * rate
        if count < FIRST_LOOK or count & (count - 1) or length < AHEAD * dynamics.step:
            return False
        slow = self.selector.slow_part(dynamics)
        if slow is not None and slow.dynamics.rate.size:  # what is fast will have died out first
            return False
        closed = self.selector.closed_form(dynamics)
        if closed is None:
            return False
        low, high = closed.bounds(dynamics.outputs, c.z, length)
        levels = CROSSES * dynamics.output_sizes @ np.maximum(c.sizes, np.abs(c.z))
        if not ((low > levels) | ((low >= -levels) & (high <= levels))).all():
            return False
        terms = dynamics.expansion(c.z)
        ahead = closed.states(c.z, np.array([dynamics.step]))[0]
        if float(np.abs(ahead - terms.sum(axis=0)).max(initial=0.0)) > AGREES * float(
            np.abs(terms).sum(axis=0).max()
        ):
            return False
        flow.closed = closed
        return True

    def _what_happens(
        self,
        polynomials: Matrix,
        reach: float,
        tolerances: Vector,
        flow: Flow,
        begin: tuple[float, float],
        terms: Matrix,
    ) -> tuple[Crossing | None, float]:
        """Return the first crossing, if there is one, and the place in the step where that is or the step ends.

        Outputs that touch zero on the way without crossing it are noted.
        """
        bounds = bernstein(polynomials, reach)
        least = bounds.min(axis=0)
        if (least > tolerances).all():
            return None, reach
        crossing = first_crossing(polynomials, reach, tolerances, bounds)
        place = reach if crossing is None else crossing.place
        t, length = begin
        for touch in touching_places(polynomials, place, tolerances):
            x = self._state(flow.dynamics.basis @ (touch**POWERS @ terms))
            none = np.zeros(self.form.system.shape[1])
            self._note(Event(t + touch * length, "grazing", x, x, none, flow.mode, flow.mode))
        return crossing, place

    def _is_low(
        self, dynamics: ModeDynamics, c: State, polynomials: Matrix | None, crossing: Crossing
    ) -> bool:
        """Tell whether the outputs that cross zero were or are about to be there but for rounding.

        They rose on the way to a place in the flow's first step by no more than that, or reach zero next to still.
        """
        pairs = list(crossing.outputs)
        if polynomials is not None:
            heights = (crossing.place * FLIGHT)[:, None] ** POWERS @ polynomials[:, pairs]
            if (heights <= LOW * (dynamics.output_sizes[pairs] @ c.sizes)).all():
                return True
        return dynamics.is_slow(c, crossing.outputs)

    def _crossing_at_end(self, dynamics: ModeDynamics, c: State) -> Crossing | None:
        """Return the outputs that are about to become negative at the end of the interval."""
        falling = np.flatnonzero(dynamics.initial_signs(c) < 0.0)
        return Crossing(0.0, tuple(falling.tolist())) if falling.size else None

    def _enter(
        self,
        state: State,
        t: float,
        near: IndexSet,
        kind: EventKind | None,
        at_start: bool,
        meeting: _Meeting | None,
    ) -> tuple[ModeDynamics, State]:
        """Select the mode that goes on from z, jump into it, and note the event; return dynamics and coordinates."""
        check_size(state.z, t)
        if float(np.abs(state.z).max(initial=0.0)) < NOTHING:
            state = State(np.zeros_like(state.z), np.zeros_like(state.z))
        before = state
        left = None if meeting is None else meeting.left
        landing = self._at_rest(state, near) if meeting is not None and meeting.is_low else None
        if landing is None:
            landing = self._land(state, t, near, left)
            if landing.multiplicity > 0:
                kind = "jump"
                if self.method.rebound is not None:
                    landing = self._rebound(before, landing, t)
        dynamics, c, state, impulse, multiplicity = landing
        if kind is None or (kind == "switch" and left == dynamics.mode):
            return dynamics, c
        is_sensitive = multiplicity > 0 and depends_on_order(
            self.selector, before, left or (), () if meeting is None else meeting.outputs, at_start
        )
        self._note(
            Event(
                t,
                kind,
                self._state(before.z),
                self._state(state.z),
                impulse,
                None if at_start else (left if left is not None else near),
                dynamics.mode,
                multiplicity,
                order_sensitive=is_sensitive,
            )
        )
        return dynamics, c

    def _at_rest(self, state: State, mode: IndexSet) -> _Landing | None:
        """Return what goes on in a mode whatever velocity of the size of rounding is lost, None where nothing does."""
        dynamics = self.selector.dynamics(mode)
        if dynamics is None:
            return None
        c = dynamics.enter(state)
        if not dynamics.continues(c):
            return None
        return _Landing(dynamics, c, dynamics.leave(c), np.zeros(self.form.system.shape[1]), 0)

    def _rebound(self, before: State, landing: _Landing, t: float) -> _Landing:
        """Return where the other law of impact leads to."""
        assert self.method.rebound is not None
        contacts = self._contacts(before)
        x, impulse = self.method.rebound(self._state(before.z), self._state(landing.z.z), contacts)
        z = self._with_state(before.z, x)
        change = np.abs(z - before.z)
        sizes = np.maximum(before.sizes, np.where(change > 0.0, float(change.max(initial=0.0)), np.abs(z)))
        again = self._land(State(z, sizes), t, landing.dynamics.mode, None)
        return again._replace(impulse=impulse + again.impulse, multiplicity=landing.multiplicity)

    def _land(self, state: State, t: float, near: IndexSet, left: IndexSet | None) -> _Landing:
        """Select the mode that goes on from z and jump into it, as often as it takes."""
        state, dynamics, shares = self._select(state, t, near, left)
        impulse, multiplicity = np.zeros(self.form.system.shape[1]), 0
        for _ in range(MOST_REINITIALISATIONS):
            c = dynamics.enter(state)
            if not dynamics.is_consistent(state.z):
                multiplicity += 1
                impulse += self._impulse(dynamics, state.z)
                state = dynamics.leave(c)
            if dynamics.continues(c, shares):
                return _Landing(dynamics, c, state, impulse, multiplicity)
            state, dynamics, shares = self._select(state, t, dynamics.mode, dynamics.mode)
        raise IterationLimitError(
            f"{MOST_REINITIALISATIONS} reinitialisations at t = {t:.12g} lead to no mode that goes on"
        )

    def _select(
        self, state: State, t: float, near: IndexSet, without: IndexSet | None
    ) -> tuple[State, ModeDynamics, Shares]:
        """Select the mode that goes on; where rounding leaves none, that of the state after a very short step."""
        try:
            return state, *self.selector.select(state, t, near, without)
        except NonUniqueError:
            raise
        except NumericalError as error:
            for h in SHORT_STEPS:
                stepped = implicit_step(self.form, state, h)
                if stepped is None:
                    continue
                state_after, mode = stepped
                found = self.selector.dynamics(mode)
                shares = next((s for s in LADDER if found is not None and found.admits(state_after, s)), None)
                if found is not None and shares is not None:
                    return state_after, found, shares
            raise error

    def _settle(self, state: State, t: float, near: IndexSet) -> tuple[ModeDynamics, State]:
        """Go on where events follow each other at one instant: in the mode that a short implicit step ends in."""
        for h in SETTLING_STEPS:
            stepped = implicit_step(self.form, state, h)
            found = None if stepped is None else self.selector.dynamics(stepped[1])
            if stepped is None or found is None:
                continue
            for start in (state, stepped[0]):
                c = found.enter(start)
                if found.continues(c):
                    self._note_limit(state, t, near, found, found.leave(c))
                    return found, c
        raise ZenoError(f"{self._repeated(t)}, and no mode goes on")

    def _is_crowded(self, t: float) -> bool:
        """Tell whether so many events lie so close together that rounding may be what drives them."""
        count = MANY_EVENTS + 4 * self.form.system.shape[1]
        since = len(self.events) - self.passed
        return since >= count and t - self.events[-count].time <= CROWDED * (self.span[1] - self.span[0])

    def _step_over(
        self, state: State, t: float, near: IndexSet, end: float
    ) -> tuple[ModeDynamics, State, float]:
        """Pass a crowd of events in the mode that an implicit step over it ends in, which flows for so long.

        Where the next crowd follows at once, the step over that is longer.
        """
        t0, t1 = self.span
        again = t - self.passed_until <= self.leap
        self.leap = 4.0 * self.leap if again else CROWDED * (t1 - t0)
        if self.leap > LONGEST_LEAP * (t1 - t0):
            raise ZenoError(f"{self._repeated(t)}, over an interval longer than can be stepped over")
        h = min(self.leap, end - t)
        stepped = implicit_step(self.form, state, h * self.form.units.rate)
        found = None if stepped is None else self.selector.dynamics(stepped[1])
        if found is None:
            raise ZenoError(f"{self._repeated(t)}, and no mode goes on")
        start = found.enter(state)
        self._note_limit(state, t, near, found, found.leave(start))
        flow = Flow(self.form, found, t, t + h, [t], [start.z])
        self.flows.append(flow)
        after = flow.coordinates_at(np.array([t + h]))[0]
        self.passed, self.passed_until = len(self.events), t + h
        return found, State(after, np.maximum(start.sizes, np.abs(after))), t + h

    def _note_limit(self, state: State, t: float, near: IndexSet, found: ModeDynamics, after: State) -> None:
        none = np.zeros(self.form.system.shape[1])
        self._note(Event(t, "zeno", self._state(state.z), self._state(after.z), none, near, found.mode))
        self.stalled = 0

    def _repeated(self, t: float) -> str:
        """Say which modes follow each other."""
        modes = sorted({str(event.mode_after) for event in self.events[-MANY_EVENTS:]})
        return f"the modes {', '.join(modes)} follow each other near t = {t:.12g} without end"

    def _contacts(self, state: State) -> IndexSet:
        """Return the pairs with y_i = C_i z = 0, to rounding."""
        C = self.form.system.C
        levels = np.abs(C) @ np.maximum(state.sizes, np.abs(state.z))
        return tuple(np.flatnonzero(C @ state.z <= TOUCHES * levels).tolist())

    def _impulse(self, dynamics: ModeDynamics, z: Vector) -> Vector:
        """Return the coefficients of delta in u, shape (k,)."""
        impulse = np.zeros(self.form.system.shape[1])
        mode = list(dynamics.mode)
        if dynamics.impulses.shape[0]:
            impulse[mode] = (dynamics.impulses[-1] @ z)[mode]
        return np.asarray(impulse * self.form.units.pair / self.form.units.rate)

    def _beyond(
        self, limit: ZenoLimit, dynamics: ModeDynamics, c: State, t: float
    ) -> tuple[ModeDynamics, State, float] | None:
        """Go on from the limit of infinitely many events, None where something else happens before it.

        What takes part jumps to the mode behind the limit, as all its remaining events together do, and everything
        flows there up to the limit: what does not take part does so exactly.
        """
        here = dynamics.leave(c)
        z = self.form.state_after(limit.x, limit.time) / self.form.units.state
        sizes = np.maximum(here.sizes, np.abs(z))
        try:
            following, _ = self.selector.select(State(z, sizes), limit.time, dynamics.mode)
        except NumericalError as error:
            raise ZenoError(
                f"events accumulate at t = {limit.time:.12g}, each round {limit.ratio:.6g} times as long as the one "
                f"before, and nothing goes on from there: {error}"
            ) from error
        start = following.enter(here)
        if self._is_left(following, start, (limit.time - t) * self.form.units.rate):
            return None
        flow = Flow(self.form, following, t, limit.time, [t], [start.z])
        after = State(flow.coordinates_at(np.array([limit.time]))[0], start.sizes)
        self.flows.append(flow)
        x = self._state(following.basis @ after.z)
        none = np.zeros(self.form.system.shape[1])
        self._note(
            Event(
                limit.time,
                "zeno",
                x,
                x,
                none,
                dynamics.mode,
                following.mode,
                ratio=limit.ratio,
            )
        )
        return following, after, limit.time

    def _is_left(self, dynamics: ModeDynamics, c: State, length: float) -> bool:
        """Tell whether an output becomes negative within so short a time; its start may be so by rounding."""
        reach = min(1.0, length / dynamics.step)
        terms = dynamics.expansion(c.z)
        levels = dynamics.output_sizes @ np.maximum(c.sizes, reach**POWERS @ np.abs(terms))
        polynomials = dynamics.output_expansion(c.z, terms)
        return first_crossing(polynomials, reach, CROSSES * np.maximum(levels, 1e-290)) is not None

    def _note(self, event: Event) -> None:
        if len(self.events) == self.method.max_events:
            raise IterationLimitError(
                f"{self.method.max_events} events by t = {event.time:.12g}; {self._repeated(event.time)}: raise "
                "max_events, or look for a Zeno point there"
            )
        if event.kind != "grazing":
            self.first_event = min(self.first_event, event.time)
        self.events.append(event)

    def _with_state(self, z: Vector, x: Vector) -> Vector:
        """Return z with another x and the same inputs."""
        n = self.form.states
        return np.concatenate([x / self.form.units.state[:n], z[n:]])

    def _state(self, z: Vector) -> Vector:
        return np.asarray((z * self.form.units.state)[: self.form.states])
