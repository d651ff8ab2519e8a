"""The early exercise boundary of options with events."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket, Market
from pricing_core.american.contracts.schedule import Schedule, Segment, make_schedule
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.events.collocation import FINEST, boundaries_at, is_served
from pricing_core.american.events.packed_schedules import pack
from pricing_core.american.events.scheduled_lcs import boundaries_lcs
from pricing_core.american.flat.exercise_region import region_at_expiry
from pricing_core.arrays import Matrix, Vector

FIRST_LEVEL, TIGHT_LEVEL, TIGHT_TOLERANCE = 4, 5, 1e-7
CAUTION = 3.0  # the stated error in distances of two levels


def schedule_of_boundary(option: Option, market: Market) -> Schedule:
    """Return the schedule seen from the strike: the boundary does not depend on the spot."""
    beyond = option.strike + math.fsum(dividend.amount for dividend in market.cash_dividends)
    return replace(make_schedule(option, replace(market, spot=beyond)), spot=option.strike)


def event_times(schedule: Schedule) -> Vector:
    """Return the ends of the segments, years from now."""
    return np.array([segment.end for segment in schedule.segments])


def scheduled_boundary(
    option: Option,
    schedule: Schedule,
    times: Vector,
    tolerance: float,
    interrupt: Callable[[], bool] | None,
) -> tuple[Matrix, Vector]:
    """Return the (near, far) boundary in money at increasing times, shape (m, 2), and the near one's error.

    At the time of an event it is that just before it; at expiry the limit, if nothing happens then.

    Raises
    ------
    NumericalError
        The interrupt came before the end.
    """
    ends, error = np.full((times.size, 2), math.nan), np.full(times.size, math.nan)
    if option.exercise == "european":
        return ends, error
    found = _collocated(schedule, times, tolerance)
    if found is None:
        return boundaries_lcs(schedule, times, tolerance, interrupt), error
    ends[:, 0], error = found
    last = schedule.segments[-1]
    if last.amount == last.fraction == last.escrow == 0.0 and times[-1] == last.end:
        ends[-1, 0], error[-1] = _at_expiry(option, last), 0.0
    return ends, error


def _at_expiry(option: Option, last: Segment) -> float:
    """Return the boundary's limit; without continuous exercise before, whatever pays is exercised."""
    if not last.exercisable:
        return option.strike
    flat = FlatMarket(option.strike, last.rate, last.volatility, last.dividend_yield)
    return region_at_expiry(option, flat).boundaries(option)[0]


def _collocated(schedule: Schedule, times: Vector, tolerance: float) -> tuple[Vector, Vector] | None:
    """Return the boundary in money and its error from two levels that are close enough, or from the closest two."""
    if not is_served(pack([schedule]))[0]:
        return None
    escrow = np.array([_escrow_at(schedule.segments, float(time)) for time in times])
    best: tuple[Vector, Vector] | None = None
    coarse: Vector | None = None
    for level in range((FIRST_LEVEL if tolerance > TIGHT_TOLERANCE else TIGHT_LEVEL) - 1, FINEST + 1):
        places, settled = boundaries_at(schedule, times, level)
        fine = schedule.strike * np.exp(places) + escrow if settled else None
        if fine is not None and coarse is not None:
            error = np.abs(fine - coarse)
            if best is None or np.nansum(error) < np.nansum(best[1]):
                best = fine, error
            if np.nanmax(error / fine, initial=0.0) <= BOUNDARY_ACCURACY * math.sqrt(tolerance):
                break
        coarse = fine
    return None if best is None else (best[0], CAUTION * best[1])


def _escrow_at(segments: tuple[Segment, ...], time: float) -> float:
    """Return A just before what happens at `time`, money."""
    for segment in segments:
        if time <= segment.end * (1.0 + 1e-12):
            return segment.escrow_at(time)
    return 0.0
