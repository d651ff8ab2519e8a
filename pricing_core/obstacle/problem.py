"""The obstacle problem, as a user states it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from pricing_core.arrays import as_number, check_list, check_type
from pricing_core.errors import InvalidInputError
from pricing_core.obstacle.diffusion import Diffusion
from pricing_core.obstacle.ends import End, Held, read_end
from pricing_core.obstacle.event import SHORTEST_TIME, Event
from pricing_core.obstacle.functions import Function, Given, read_function
from pricing_core.obstacle.obstacle import Obstacle


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleProblem:
    """-V_t = L V + f + u - w, 0 <= u _|_ V - lower >= 0, 0 <= w _|_ upper - V >= 0, V = payoff at the horizon.

    L V = volatility^2/2 V_xx + drift V_x - rate V. With one obstacle that is (11.62) of the chapter.

    Parameters
    ----------
    diffusion : Diffusion
    payoff : Obstacle
        The value at the horizon; its window and its dates play no part.
    horizon : float
        Years from now, at least 1e-12.
    lower, upper : Obstacle, optional
    source : float or callable
        f: money a year that is received, a number or f(x, t).
    events : sequence of Event
        Events of one time happen in the order in which they are given.
    interval : (float or None, float or None)
        The ends of the interval of x; None where it is to be chosen, wide enough.
    ends : ("linear" | "exponential" | Held | float, the same for the right end)
        At an end V is linear in x, linear in e^x (a price over x = ln S), or has a given value.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.
    """

    diffusion: Diffusion
    payoff: Obstacle
    horizon: float
    lower: Obstacle | None = field(default=None, kw_only=True)
    upper: Obstacle | None = field(default=None, kw_only=True)
    source: Given = field(default=0.0, kw_only=True)
    events: Sequence[Event] = field(default=(), kw_only=True)
    interval: tuple[float | None, float | None] = field(default=(None, None), kw_only=True)
    ends: tuple[End | float, End | float] = field(default=("linear", "linear"), kw_only=True)
    source_function: Function = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_type("diffusion", self.diffusion, Diffusion)
        check_type("payoff", self.payoff, Obstacle)
        for name in ("lower", "upper"):
            if getattr(self, name) is not None:
                check_type(name, getattr(self, name), Obstacle)
        horizon = as_number("horizon", self.horizon)
        if not horizon >= SHORTEST_TIME:
            raise InvalidInputError("horizon", horizon, f"at least {SHORTEST_TIME:g} years")
        object.__setattr__(self, "horizon", horizon)
        object.__setattr__(self, "source_function", read_function("source", self.source))
        for name in ("lower", "upper"):
            self._check_dates(getattr(self, name))
        check_list("events", self.events)
        for event in self.events:
            check_type("events", event, Event)
            if event.time > horizon:
                raise InvalidInputError("events", event.time, f"at most the horizon, {horizon:g}")
        object.__setattr__(self, "events", tuple(sorted(self.events, key=lambda event: event.time)))
        self._read_interval()

    def _check_dates(self, obstacle: Obstacle | None) -> None:
        if obstacle is None:
            return
        if obstacle.during is not None and not (
            obstacle.during[0] < self.horizon and obstacle.during[1] > 0.0
        ):
            allowed = f"a window that meets that from 0 to the horizon, {self.horizon:g}"
            raise InvalidInputError("during", obstacle.during, allowed)
        for time in obstacle.at or ():
            if not 0.0 <= time <= self.horizon:
                raise InvalidInputError("at", time, f"from 0 to the horizon, {self.horizon:g}")

    def _read_interval(self) -> None:
        for name in ("interval", "ends"):
            if not isinstance(getattr(self, name), tuple | list) or len(getattr(self, name)) != 2:
                raise InvalidInputError(name, getattr(self, name), "a pair: the left end, the right end")
        interval = tuple(None if end is None else as_number("interval", end) for end in self.interval)
        left, right = interval
        if left is not None and right is not None and not left < right:
            raise InvalidInputError("interval", interval, "a pair with left < right")
        ends = tuple(read_end(end) for end in self.ends)
        for place, end in zip(interval, ends, strict=True):
            if isinstance(end, Held) and place is None:
                raise InvalidInputError("interval", interval, "given where a value is held at its end")
        object.__setattr__(self, "interval", interval)
        object.__setattr__(self, "ends", ends)

    @property
    def obstacles(self) -> tuple[Obstacle | None, Obstacle | None]:
        """The lower and the upper obstacle."""
        return self.lower, self.upper

    @property
    def segments(self) -> tuple[tuple[float, float], ...]:
        """The intervals of time between which something happens, the last one first, shape (m, 2)."""
        given = [time for obstacle in self.obstacles if obstacle is not None for time in obstacle.times]
        inside = {time for time in (*given, *(event.time for event in self.events)) if time < self.horizon}
        times = sorted({0.0, self.horizon, *(time for time in inside if time > 0.0)})
        return tuple(zip(times[-2::-1], times[:0:-1], strict=True))

    def at_event(self, time: float) -> tuple[Event, ...]:
        """Return the events of a time, in the order in which they happen."""
        return tuple(event for event in self.events if event.time == time)


def just_before(time: float) -> float:
    """Return the largest number below a time, at which obstacles are asked where something happens at it."""
    return math.nextafter(time, -math.inf)
