"""What is known of an option with events without a grid, in units of the strike."""

import math
from dataclasses import replace

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.flat.exercise_region import EMPTY_REGION, ExerciseRegion, region_at_expiry
from pricing_core.american.flat.limits import european_value
from pricing_core.arrays import Vector


def option_of(schedule: Schedule) -> Option:
    """Return the contract as far as a flat market goes: American, with the schedule's type, strike and expiry."""
    return Option("put" if schedule.is_put else "call", schedule.strike, schedule.segments[-1].end)


def without_exercise(schedule: Schedule) -> Schedule:
    """Return the European option with the same events."""
    held = (replace(segment, exercisable=False, exercise_at_end=False) for segment in schedule.segments)
    return replace(schedule, segments=tuple(held))


def may_exercise_early(schedule: Schedule) -> bool:
    """Whether the holder may exercise before expiry, or just before a dividend at expiry."""
    last = schedule.segments[-1]
    before_dividend = last.exercise_at_end and _pays_at_end(last)
    return before_dividend or any(
        segment.exercisable or (segment.exercise_at_end and segment is not last)
        for segment in schedule.segments
    )


def exact_european(schedule: Schedule) -> Vector | None:
    """Return (v, v_s, v_ss) of the European option by the formula, shape (3,); None where it has none.

    Without cash dividends ln S is normal at expiry: the formula with averaged rate, yield and variance, and a spot
    that the proportional dividends have reduced.
    """
    segments = schedule.segments
    if any(segment.amount > 0.0 for segment in segments):
        return None
    expiry = segments[-1].end
    rate = math.fsum(segment.rate * segment.duration for segment in segments) / expiry
    dividend_yield = math.fsum(segment.dividend_yield * segment.duration for segment in segments) / expiry
    variance = math.fsum(segment.volatility**2 * segment.duration for segment in segments) / expiry
    kept = math.prod(1.0 - segment.fraction for segment in segments)
    market = FlatMarket(kept * schedule.spot / schedule.strike, rate, math.sqrt(variance), dividend_yield)
    option = Option(option_of(schedule).option_type, 1.0, expiry, "european")
    found = european_value(option, market)
    return np.array([found.value, kept * found.delta, kept**2 * found.gamma])


def value_at_zero(schedule: Schedule) -> tuple[float, float, bool]:
    """Return the value at a spot of 0, its slope there, and whether exercise is optimal now: exact."""
    if not schedule.is_put:
        return 0.0, 0.0, False
    value, slope, exercised = 1.0, -1.0, False
    for segment in reversed(schedule.segments):
        slope *= 0.0 if segment.amount > 0.0 else 1.0 - segment.fraction
        at_end = 1.0 - segment.escrow / schedule.strike
        if segment.exercise_at_end and at_end > value:
            value, slope = at_end, -1.0
        value *= math.exp(-segment.rate * segment.duration)
        slope *= math.exp(-segment.dividend_yield * segment.duration)
        now = 1.0 - segment.escrow_at(segment.start) / schedule.strike
        exercised = segment.exercisable and now >= value
        if exercised:
            value, slope = now, -1.0
    return value, slope, exercised


def scheduled_region_at_expiry(schedule: Schedule, before_dividend: ExerciseRegion) -> ExerciseRegion:
    """Return the limit of the exercise region just before expiry in ln(S/K).

    Parameters
    ----------
    before_dividend : ExerciseRegion
        Where exercise just before a dividend at expiry pays, in ln(S/K).
    """
    last = schedule.segments[-1]
    if _pays_at_end(last):
        return before_dividend
    if last.exercisable:
        market = FlatMarket(schedule.spot, last.rate, last.volatility, last.dividend_yield)
        return region_at_expiry(option_of(schedule), market)
    if last.exercise_at_end:
        return ExerciseRegion(-math.inf, 0.0) if schedule.is_put else ExerciseRegion(0.0, math.inf)
    return EMPTY_REGION


def _pays_at_end(segment: Segment) -> bool:
    return segment.amount > 0.0 or segment.fraction > 0.0 or segment.escrow > 0.0
