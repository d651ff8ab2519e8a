"""Derivatives by parameters, carried along with the value: with the contact set held fast they are linear problems.

The value is stationary in the exercise boundary, so that its derivative v_p solves v_p' = L v_p + L_p v where the
option is held, and is g_p where it is exercised: on the grid the same matrices as the value's, one more right-hand side
for each parameter and step. At an event they follow from the derivative of the event's own map. The kernel does that;
here is which parameters it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.differences import plan_directions

STICKY = "delta_sticky_moneyness"
SURFACE_STEP = 1e-4  # How far a surface is moved in ln S; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """A parameter: the schedule with a little more and a little less of it.

    Parameters
    ----------
    kind : str
        The column of `Prices` that the derivative belongs to.
    entry : int
        The place in it.
    up, down : Schedule
        Cut like the schedule itself.
    step : float
        Half of what they differ by.
    """

    kind: str
    entry: int
    up: Schedule
    down: Schedule
    step: float

    @property
    def moves_surface(self) -> bool:
        """Whether it changes the surface of a local volatility, beyond a parallel shift."""
        return self.up.local != self.down.local

    @property
    def spot(self) -> float:
        """What the spot that diffuses changes by in units of the strike: escrowed dividends reduce it."""
        return (self.up.spot - self.down.spot) / (2.0 * self.step * self.up.strike)


def directions_of(
    book: Book, *, extended: bool, only: str = "", interrupt: Callable[[], bool] | None = None
) -> tuple[Direction, ...]:
    """Return the parameters of a book of one contract; none where one asks for a further cut or when interrupted.

    Parameters
    ----------
    only : str
        The one kind that is wanted, if not all are.
    interrupt : callable, optional
        Asked before each of them: a contract may have hundreds.
    """
    found: list[Direction] = []
    for kind, entry, up, down, step in plan_directions(book, extended=extended):
        if interrupt is not None and interrupt():
            return ()
        if not only or kind == only:
            found.append(Direction(kind, entry, up.schedule(0), down.schedule(0), step))
    schedule = book.schedule(0)
    if schedule.local is not None and found and not only:
        above, below = (moved(schedule, side * SURFACE_STEP) for side in (1.0, -1.0))
        found.append(Direction(STICKY, 0, above, below, SURFACE_STEP))
    return tuple(found)


def moved(schedule: Schedule, by: float) -> Schedule:
    """Return the schedule with the spots of its local volatility moved by so much in ln S."""
    assert schedule.local is not None
    surface = schedule.local.volatility.moved(math.exp(by))
    return replace(schedule, local=replace(schedule.local, volatility=surface))
