"""Options with events whose spot does not diffuse: zero volatility, or a spot of zero."""

import math

import numpy as np

from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.events.packed_schedules import PackedSchedules
from pricing_core.arrays import Vector

SMALLEST_SPREAD = 1e-12  # sigma sqrt(T) below which chance makes no difference


def certain_value(schedule: Schedule, *, exercise: bool = True) -> float:
    """Return the value of the best time to exercise on the spot's certain path, in money.

    On a stretch of constant rates s = +-(K e^{-rt} - S e^{-qt}) has one stationary point, r K e^{-rt} = q S e^{-qt}:
    the best of both ends and that point.
    """
    sign = 1.0 if schedule.is_put else -1.0
    spot, discount, best = schedule.spot, 1.0, 0.0
    for segment in schedule.segments:
        h = segment.duration
        times = []
        if exercise and segment.exercisable:
            times = [0.0, h, *_stationary(schedule.strike, spot, segment)]
        elif exercise and segment.exercise_at_end:
            times = [h]
        for t in times:
            strike = schedule.strike - segment.escrow * math.exp(-segment.rate * (h - t))
            pays = strike - spot * math.exp((segment.rate - segment.dividend_yield) * t)
            best = max(best, sign * pays * discount * math.exp(-segment.rate * t))
        spot *= math.exp((segment.rate - segment.dividend_yield) * h)
        spot = max(spot * (1.0 - segment.fraction) - segment.amount, 0.0)
        discount *= math.exp(-segment.rate * h)
    return max(best, sign * (schedule.strike - spot) * discount, 0.0)


def uncertainty(book: PackedSchedules) -> Vector:
    """Return bounds on what chance adds or takes, in money, shape (n,).

    Dividends make the spot at most smaller; as for `deterministic_error`, |V - V(volatility 0)| is at most
    2 S sup e^{-int q} sqrt(e^{int sigma**2} - 1), and int -q at most that of its positive part.
    """
    columns, starts = book.columns(), book.first[:-1]
    variance = np.add.reduceat(columns.volatility**2 * columns.duration, starts)
    growth = np.add.reduceat(np.maximum(-columns.dividend_yield, 0.0) * columns.duration, starts)
    bound = 2.0 * book.spot * np.exp(growth) * np.sqrt(np.expm1(np.minimum(variance, 1.0)))
    return np.where((variance > 1.0) & (book.spot > 0.0), np.inf, bound)


def _stationary(strike: float, spot: float, segment: Segment) -> list[float]:
    """Return the inner time at which waiting neither costs nor gains, if there is one."""
    rate, dividend = segment.rate, segment.dividend_yield
    costs = rate * strike
    ratio = dividend * spot / costs if costs != 0.0 else 0.0
    if ratio <= 0.0 or rate == dividend:
        return []
    t = math.log(ratio) / (dividend - rate)
    return [t] if 0.0 < t < segment.duration else []
