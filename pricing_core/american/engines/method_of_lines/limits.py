"""What is known of a schedule without a grid, in units of the strike."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.exercise_region import ExerciseRegion, earning_region, region_at_expiry


@lru_cache(maxsize=64)  # asked at every resolution
def without_exercise(schedule: Schedule) -> Schedule:
    """Return the European option with the same events."""
    held = (replace(segment, exercisable=False, exercise_at_end=False) for segment in schedule.segments)
    return replace(schedule, segments=tuple(held))


def region_before_expiry(schedule: Schedule, before_dividend: ExerciseRegion) -> ExerciseRegion:
    """Return the limit of the exercise region just before expiry in ln(S/K).

    Parameters
    ----------
    before_dividend : ExerciseRegion
        Where exercise just before a dividend at expiry pays, in ln(S/K).
    """
    return before_dividend if _pays_at_end(schedule.segments[-1]) else region_at_expiry(schedule)


def first_boundaries(schedule: Schedule) -> tuple[float, float]:
    """Return where the (near, far) boundary begins, money: in the last segment that has it; NaN where none has."""
    near = far = math.nan
    for segment in schedule.segments:
        if segment.exercisable:
            ends = earning_region(segment, is_put=schedule.is_put).boundaries(schedule)
            near = near if math.isnan(ends[0]) else ends[0]
            far = far if math.isnan(ends[1]) else ends[1]
    return near, far


def _pays_at_end(segment: Segment) -> bool:
    return segment.due > 0.0 or segment.fraction > 0.0
