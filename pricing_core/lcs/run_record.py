"""What a simulation from event to event has noted: its flows and its events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.errors import IterationLimitError
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.mode_dynamics import State
from pricing_core.lcs.trajectory import Event

MANY_EVENTS = 20  # and 4 for each pair


@dataclass(slots=True, eq=False)
class RunRecord:
    """The flows and events of a run in progress.

    Parameters
    ----------
    form : AutonomousForm
    max_events : int
    """

    form: AutonomousForm
    max_events: int
    flows: list[Flow] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    first_event: float = math.inf

    def note(self, event: Event) -> None:
        """Add an event.

        Raises
        ------
        IterationLimitError
            It is one too many.
        """
        if len(self.events) == self.max_events:
            raise IterationLimitError(
                f"{self.max_events} events by t = {event.time:.12g}; {self.repeated(event.time)}: raise "
                "max_events, or look for a Zeno point there"
            )
        if self.form.exchanged:
            event = self._reported(event)
        if event.kind != "grazing":
            self.first_event = min(self.first_event, event.time)
        self.events.append(event)

    def _reported(self, event: Event) -> Event:
        """Return the event with the modes that are reported; of an exchanged pair the impulse of u is that of y."""
        before, after = (
            None if mode is None else self.form.reported_mode(mode)
            for mode in (event.mode_before, event.mode_after)
        )
        impulse = event.impulse.copy()
        impulse[list(self.form.exchanged)] = 0.0
        return replace(event, mode_before=before, mode_after=after, impulse=impulse)

    def note_limit(self, t: float, before: State, after: State, modes: tuple[IndexSet, IndexSet]) -> None:
        """Add the limit of infinitely many events whose ratio is not known."""
        x = self.state(before.z), self.state(after.z)
        self.note(Event(t, "zeno", *x, self.no_impulse(), *modes))

    def repeated(self, t: float) -> str:
        """Return a sentence that names the modes which follow each other."""
        modes = sorted({str(event.mode_after) for event in self.events[-MANY_EVENTS:]})
        return f"the modes {', '.join(modes)} follow each other near t = {t:.12g} without end"

    def state(self, z: Vector) -> Vector:
        """Return x, in the units given, or what is reported in its place."""
        return np.asarray(self.form.reported(z))

    def no_impulse(self) -> Vector:
        """Return the impulse of what is not a jump."""
        return np.zeros(self.form.system.shape[1])
