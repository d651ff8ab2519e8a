"""Events that accumulate: at one instant, in crowds that rounding drives, and before the limit of infinitely many."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import IndexSet
from pricing_core.errors import NumericalError, ZenoError
from pricing_core.kernel import taylor_step
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.flow_to_event import CROSSES
from pricing_core.lcs.mode_dynamics import ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector, implicit_step
from pricing_core.lcs.run_record import MANY_EVENTS, RunRecord
from pricing_core.lcs.trajectory import Event
from pricing_core.lcs.zeno import NEAR, ROUNDS, ZenoLimit, zeno_limit

MOST_AT_ONE_INSTANT = 10  # events, and 2 for each pair
CROWDED = 1e-8  # of the interval: what so many events are a crowd in
LONGEST_LEAP = 1e-4  # of the interval
SETTLING_STEPS = (1e-9, 1e-8, 1e-7, 1e-6)  # in the form's units


class Beyond(NamedTuple):
    """The time, state and mode in which a run goes on."""

    dynamics: ModeDynamics
    c: State
    time: float


@dataclass(slots=True, eq=False)
class Accumulation:
    """Leads a run past events that follow each other ever faster.

    Parameters
    ----------
    record : RunRecord
    selector : ModeSelector
    span : (float, float)
        The interval of the run.
    """

    record: RunRecord
    selector: ModeSelector
    span: tuple[float, float]
    stalled: int = 0  # events at one instant
    passed: int = 0  # events before the last crowd of them ended
    passed_until: float = -np.inf
    leap: float = 0.0  # that was taken over it

    def past(self, state: State, t: float, near: IndexSet, end: float) -> Beyond | None:
        """Return where to go on from z at t if too many events lie behind it, at one instant or in a crowd; else None.

        Raises
        ------
        ZenoError
            They go on without end, and nothing leads past them.
        """
        if self.stalled >= MOST_AT_ONE_INSTANT + 2 * self.record.form.system.shape[1]:
            return self._settled(state, t, near)
        if self._is_crowded(t):
            return self._stepped_over(state, t, near, end)
        return None

    def beyond_limit(self, dynamics: ModeDynamics, c: State, t: float, end: float) -> Beyond | None:
        """Return where to go on behind the limit of infinitely many events, None where there is none before `end`.

        Raises
        ------
        ZenoError
            Nothing goes on from the limit.
        """
        events, first = self.record.events, self.record.first_event
        if len(events) <= ROUNDS or t - events[-2].time > NEAR * (t - first):
            return None
        limit = zeno_limit(events, end)
        return None if limit is None else self._behind(limit, dynamics, c, t)

    def _settled(self, state: State, t: float, near: IndexSet) -> Beyond:
        """Go on where events follow each other at one instant: in the mode that a short implicit step ends in.

        Where the inputs of that are not unique, it is in the mode that goes on from the state that the step leads to.
        """
        for h in SETTLING_STEPS:
            stepped = implicit_step(self.record.form, state, h)
            if stepped is None:
                continue
            for found in self._going_on_from(*stepped, t):
                for start in (state, stepped[0]):
                    c = found.enter(start)
                    if found.continues(c):
                        self.record.note_limit(t, state, found.leave(c), (near, found.mode))
                        self.stalled = 0
                        return Beyond(found, c, t)
        raise ZenoError(f"{self.record.repeated(t)}, and no mode goes on")

    def _going_on_from(self, state: State, mode: IndexSet, t: float) -> Iterator[ModeDynamics]:
        """Yield the dynamics of the mode, and of the one that is selected from the state."""
        own = self.selector.dynamics(mode)
        if own is not None:
            yield own
        with suppress(NumericalError):
            yield self.selector.select(state, t, mode).dynamics

    def _is_crowded(self, t: float) -> bool:
        """Tell whether so many events lie so close together that rounding may be what drives them."""
        count = MANY_EVENTS + 4 * self.record.form.system.shape[1]
        events = self.record.events
        if len(events) - self.passed < count:
            return False
        return t - events[-count].time <= CROWDED * (self.span[1] - self.span[0])

    def _stepped_over(self, state: State, t: float, near: IndexSet, end: float) -> Beyond:
        """Pass a crowd of events in the mode that an implicit step over it ends in, which flows for so long.

        Where the next crowd follows at once, the step over that is longer.
        """
        (t0, t1), form, record = self.span, self.record.form, self.record
        again = t - self.passed_until <= self.leap
        self.leap = 4.0 * self.leap if again else CROWDED * (t1 - t0)
        if self.leap > LONGEST_LEAP * (t1 - t0):
            raise ZenoError(f"{record.repeated(t)}, over an interval longer than can be stepped over")
        h = min(self.leap, end - t)
        stepped = implicit_step(form, state, h * form.units.rate)
        found = None if stepped is None else next(self._going_on_from(*stepped, t + h), None)
        if found is None:
            raise ZenoError(f"{record.repeated(t)}, and no mode goes on")
        start = found.enter(state)
        record.note_limit(t, state, found.leave(start), (near, found.mode))
        self.stalled = 0
        flow = Flow(form, found, t, t + h, [t], [start.z])
        record.flows.append(flow)
        after = flow.coordinates_at(t + h)
        self.passed, self.passed_until = len(record.events), t + h
        return Beyond(found, State(after, np.maximum(start.sizes, np.abs(after))), t + h)

    def _behind(self, limit: ZenoLimit, dynamics: ModeDynamics, c: State, t: float) -> Beyond | None:
        """Go on from the limit of infinitely many events, None where something else happens before it.

        What takes part jumps to the mode behind the limit, as all its remaining events together do, and everything
        flows there up to the limit: what does not take part does so exactly.
        """
        form, record = self.record.form, self.record
        here = dynamics.leave(c)
        z = form.state_after(limit.x, limit.time) / form.units.state
        sizes = np.maximum(here.sizes, np.abs(z))
        try:
            following = self.selector.select(State(z, sizes), limit.time, dynamics.mode).dynamics
        except NumericalError as error:
            raise ZenoError(
                f"events accumulate at t = {limit.time:.12g}, each round {limit.ratio:.6g} times as long as the one "
                f"before, and nothing goes on from there: {error}"
            ) from error
        start = following.enter(here)
        if _is_left(following, start, (limit.time - t) * form.units.rate):
            return None
        flow = Flow(form, following, t, limit.time, [t], [start.z])
        after = State(flow.coordinates_at(limit.time), start.sizes)
        record.flows.append(flow)
        x, modes = record.state(following.basis @ after.z), (dynamics.mode, following.mode)
        record.note(Event(limit.time, "zeno", x, x, record.no_impulse(), *modes, ratio=limit.ratio))
        return Beyond(following, after, limit.time)


def _is_left(dynamics: ModeDynamics, c: State, length: float) -> bool:
    """Tell whether an output becomes negative within so short a time; its start may be so by rounding."""
    reach = min(1.0, length / dynamics.step)
    return bool(taylor_step(dynamics.scaled_rate, dynamics.outputs, c.z, c.sizes, reach, CROSSES)[1])
