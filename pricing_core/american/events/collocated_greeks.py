"""Derivatives by the parameters of options with events, by the collocation at the level above their price's."""

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from pricing_core.american.contracts.schedule import Schedule, make_schedule
from pricing_core.american.events.collocation import FINEST, solve_book
from pricing_core.american.events.packed_schedules import pack
from pricing_core.american.events.scheduled_book import Contract
from pricing_core.american.events.scheduled_greeks import ScheduledGreeks, plan_greeks
from pricing_core.american.events.scheduled_lcs import solve_schedule_lcs, values_on_same_grid

CLOSE, CLOSE_LEVEL = (
    1e-8,
    4,
)  # strikes: the boundaries' tolerance where their degrees are their own, and the level
GENERAL_TOLERANCE = 1e-5  # of the general path's grid where it serves the derivatives
SEGMENTS_AT_ONCE = 500  # a fraction of a second between two looks at the clock


class DeadlinePassedError(Exception):
    """The interrupt came before the derivatives were found."""


def collocated_greeks(
    contracts: Mapping[int, Contract],
    levels: Mapping[int, int],
    *,
    extended: bool,
    threads: int = 1,
    interrupt: Callable[[], bool] | None = None,
) -> dict[int, ScheduledGreeks]:
    """Return the derivatives by the parameters of contracts that are held, each from the level of its price.

    The level above it gives every boundary a fixed degree: bumped or not, it is solved alike. Where a bumped schedule
    does not settle so, the next level serves, then degrees of its own to a small tolerance, at last the general path.

    Raises
    ------
    DeadlinePassedError
        The interrupt came before the end.
    """
    plans = {row: plan_greeks(*contract, extended=extended) for row, contract in contracts.items()}
    parts = {row: (make_schedule(*contracts[row]), *plan.schedules) for row, plan in plans.items()}
    derivatives: dict[int, ScheduledGreeks] = {}
    for above in (1, 2, None):
        left = [row for row in plans if row not in derivatives or not derivatives[row].is_whole()]
        level = {row: CLOSE_LEVEL if above is None else min(levels[row] + above, FINEST) for row in left}
        tolerance = CLOSE if above is None else 0.0
        for row, values in _values_at(level, parts, tolerance, threads, interrupt):
            derivatives[row] = plans[row].finish(values[0][0], values[1:])
    for row, plan in plans.items():
        if not derivatives[row].is_whole():
            solution = solve_schedule_lcs(parts[row][0], GENERAL_TOLERANCE, interrupt=interrupt)
            values = values_on_same_grid(solution, parts[row])
            derivatives[row] = plan.finish(values[0][0], values[1:])
            if not derivatives[row].is_whole() and interrupt is not None and interrupt():
                raise DeadlinePassedError
    return derivatives


def _values_at(
    levels: Mapping[int, int],
    parts: dict[int, tuple[Schedule, ...]],
    tolerance: float,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> Iterator[tuple[int, list[tuple[float, float]]]]:
    """Yield each row with the (value, delta) of its schedules, in money, NaN where they do not settle."""
    every = [schedule for row in levels for schedule in parts[row]]
    level = np.repeat(list(levels.values()), [len(parts[row]) for row in levels]).astype(np.int64)
    pairs: list[tuple[float, float]] = []
    for part in _portions(every):
        if interrupt is not None and interrupt():
            raise DeadlinePassedError
        tolerances = np.full(level[part].size, tolerance)
        numbers, settled = solve_book(pack(every[part]), level[part], threads, tolerances)
        pairs += [
            (schedule.strike * value, schedule.strike / schedule.spot * slope)
            if sound
            else (math.nan, math.nan)
            for schedule, value, slope, sound in zip(
                every[part], numbers[0].tolist(), numbers[1].tolist(), settled.tolist(), strict=True
            )
        ]
    at = 0
    for row in levels:
        yield row, pairs[at : at + len(parts[row])]
        at += len(parts[row])


def _portions(schedules: list[Schedule]) -> Iterator[slice]:
    """Cut the list where the segments so far are enough for one call of the kernel."""
    start, segments = 0, 0
    for k, schedule in enumerate(schedules):
        segments += len(schedule.segments)
        if segments >= SEGMENTS_AT_ONCE:
            yield slice(start, k + 1)
            start, segments = k + 1, 0
    if start < len(schedules):
        yield slice(start, len(schedules))
