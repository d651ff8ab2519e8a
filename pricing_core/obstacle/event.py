"""What happens at one time: the place moves, or cash is paid."""

from __future__ import annotations

from dataclasses import dataclass, field

from pricing_core.arrays import as_number
from pricing_core.errors import InvalidInputError
from pricing_core.obstacle.functions import Function, Given, read_function

SHORTEST_TIME = 1e-12  # Years to the horizon or to an event: less than a millisecond; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """At `time` the obstacles act, cash(x) is paid, and x becomes move(x).

    V(t-, x) = clip(V(t+, move(x)) + cash(x), lower, upper); at the horizon V(t+) is the payoff.

    Parameters
    ----------
    time : float
        Years from now, at least 1e-12 and at most the horizon.
    move : callable, optional
        f(x): where x is afterwards, such as ln(e^x - dividend).
    cash : float or callable, optional
        Money: a number or f(x), paid to the holder.
    """

    time: float
    move: Given | None = None
    cash: Given | None = None
    functions: tuple[Function | None, Function | None] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", as_number("time", self.time))
        if not self.time >= SHORTEST_TIME:
            raise InvalidInputError("time", self.time, f"at least {SHORTEST_TIME:g}: an event at 0 is over")
        if self.move is None and self.cash is None:
            raise InvalidInputError("event", self, "a move, or cash, or both")
        move = None if self.move is None else read_function("move", self.move)
        cash = None if self.cash is None else read_function("cash", self.cash)
        object.__setattr__(self, "functions", (move, cash))
