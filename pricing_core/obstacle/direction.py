"""A problem that is changed in a direction: of its coefficients, its source, its obstacles, or what its events pay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.arrays import as_real_array
from pricing_core.errors import InvalidInputError, UnknownNameError
from pricing_core.obstacle.diffusion import Diffusion
from pricing_core.obstacle.event import Event
from pricing_core.obstacle.functions import Function, read_function
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.problem import ObstacleProblem

COEFFICIENTS = ("volatility", "drift", "rate")
OBSTACLES = ("payoff", "lower", "upper")
NAMES = (*COEFFICIENTS, "source", *OBSTACLES, "cash")
# By how much of a direction parameters are changed in differences at fixed values: its square is lost, and rounding is
# divided by it.
DIFFERENCE = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours:
    """A problem changed by `size` and by -`size` times a direction, with the same segments as the problem itself."""

    high: ObstacleProblem
    low: ObstacleProblem
    size: float

    @property
    def both(self) -> tuple[ObstacleProblem, ObstacleProblem]:
        """The two problems, the one with more first."""
        return self.high, self.low

    @property
    def is_of_events(self) -> bool:
        """Whether the two share all but what their events do."""
        high, low = self.both
        names = ("diffusion", "payoff", "lower", "upper", "source")
        return high.ends == low.ends and all(getattr(high, name) is getattr(low, name) for name in names)

    def happens_alike(self, time: float) -> bool:
        """Tell whether the two share the events of a time."""
        return self.high.at_event(time) == self.low.at_event(time)

    def difference(self, high: Any, low: Any) -> Any:
        """Return the derivative of what the two problems tell."""
        return (high - low) / (2.0 * self.size)


def neighbours(
    problem: ObstacleProblem, direction: Mapping[str, Any], size: float = DIFFERENCE
) -> Neighbours:
    """Return the problem changed by `size` and by -`size` times a direction."""
    return Neighbours(changed(problem, direction, size), changed(problem, direction, -size), size)


def changed(problem: ObstacleProblem, direction: Mapping[str, Any], size: float) -> ObstacleProblem:
    """Return a problem whose coefficients, obstacles and events are changed by `size` times a direction.

    Raises
    ------
    UnknownNameError, InvalidInputError
        A name is not known, or stands for something that the problem has not.
    """
    unknown = [name for name in direction if name not in NAMES]
    if unknown:
        raise UnknownNameError("direction", unknown, NAMES)
    changes: dict[str, Any] = {}
    diffusion = problem.diffusion
    functions = dict(zip(COEFFICIENTS, diffusion.functions, strict=True))
    if any(name in direction for name in COEFFICIENTS):
        summed = {
            name: _sum(functions[name], direction[name], size)
            if name in direction
            else getattr(diffusion, name)
            for name in COEFFICIENTS
        }
        changes["diffusion"] = Diffusion(**summed, breaks=diffusion.breaks)
    if "source" in direction:
        changes["source"] = _sum(problem.source_function, direction["source"], size)
    for name in OBSTACLES:
        if name in direction:
            obstacle: Obstacle | None = getattr(problem, name)
            if obstacle is None:
                raise InvalidInputError(
                    name, direction[name], f"left out: the problem has no {name} obstacle"
                )
            changes[name] = replace(obstacle, value=_sum(obstacle.function, direction[name], size))
    if "cash" in direction:
        changes["events"] = _with_cash(problem, direction["cash"], size)
    return replace(problem, **changes)


def _sum(function: Function, direction: Any, size: float) -> Any:
    """Return a function of x and t, or of x alone, that is changed by `size` times a direction."""
    other = read_function(function.name, direction)
    if function.has_t or other.has_t:
        return lambda x, t: function(x, t) + size * other(x, t)
    return lambda x: function(x, 0.0) + size * other(x, 0.0)


def _with_cash(problem: ObstacleProblem, amounts: Any, size: float) -> tuple[Event, ...]:
    count = len(problem.events)
    given = as_real_array("cash", amounts)
    if given.size not in (1, count) or count == 0:
        raise InvalidInputError("cash", amounts, f"one number for each of the {count} events")
    given = np.broadcast_to(given.reshape(-1), (count,))
    events = []
    for event, amount in zip(problem.events, given.tolist(), strict=True):
        _, cash = event.functions
        added = size * amount if cash is None else _sum(cash, amount, size)
        events.append(replace(event, cash=added))
    return tuple(events)
