"""What an option may cost at volatilities from zero to infinity."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.events.certain_schedule import certain_value
from pricing_core.american.tables.book import Book
from pricing_core.arrays import BoolVector, Vector


class PriceBounds(NamedTuple):
    """Every field has shape (n,); money per unit of underlying.

    `lower` is the value at volatility 0, `upper` what the value tends to as the volatility grows;
    `european_lower` and `european_upper` are those of the option without early exercise, and `out_of_the_money` is
    its ln(F/K) for a put, ln(K/F) for a call, F the forward. `at_once` tells whether exercise now is best at
    volatility 0, and brings something.
    """

    lower: Vector
    upper: Vector
    european_lower: Vector
    european_upper: Vector
    out_of_the_money: Vector
    at_once: BoolVector


def join_bounds(bounds: Sequence[PriceBounds]) -> PriceBounds:
    """Return the bounds of several options as one."""
    numbers = np.array([part[:5] for part in bounds], dtype=np.float64).reshape(-1, 5)
    lower, upper, european_lower, european_upper, out_of_the_money = numbers.T
    at_once = np.array([part.at_once[0] for part in bounds], dtype=bool)
    return PriceBounds(lower, upper, european_lower, european_upper, out_of_the_money, at_once)


def book_bounds(book: Book) -> PriceBounds:
    """Return the bounds of options without events; NaN in rows that hold NaN.

    At volatility 0 the option is exercised at the best time, now, at expiry or where r K e^{-rt} = q S e^{-qt}. A
    put costs at most K, a call S, with interest to the best time: K max(1, e^{-rT}) and S max(1, e^{-qT}), European
    K e^{-rT} and S e^{-qT} (Merton 1973).
    """
    S, K, T, rate, dividend_yield = book.spot, book.strike, book.expiry, book.rate, book.dividend_yield
    sign = np.where(book.is_put, 1.0, -1.0)

    def exercised_at(t: Vector) -> Vector:
        return np.maximum(sign * (K * np.exp(-rate * t) - S * np.exp(-dividend_yield * t)), 0.0)

    with np.errstate(all="ignore"):
        at_expiry, at_once = exercised_at(T), exercised_at(np.zeros_like(T))
        stationary = np.log(dividend_yield * S / (rate * K)) / (dividend_yield - rate)
        between = (stationary > 0.0) & (stationary < T)
        best = np.maximum(at_once, np.where(between, exercised_at(np.where(between, stationary, 0.0)), 0.0))
        lower = np.where(book.is_american, np.maximum(best, at_expiry), at_expiry)
        bond, stock = np.exp(-rate * T), np.exp(-dividend_yield * T)
        european_upper = np.where(book.is_put, K * bond, S * stock)
        most = np.where(book.is_put, K, S)
        upper = np.where(book.is_american, np.maximum(most, european_upper), european_upper)
        forward = np.log(S / K) + (rate - dividend_yield) * T
    certain = (T == 0.0) | (S == 0.0)
    return PriceBounds(
        lower,
        np.where(certain, lower, upper),
        at_expiry,
        european_upper,
        sign * forward,
        book.is_american & (at_once > 0.0) & (at_once >= lower),
    )


def schedule_bounds(schedule: Schedule) -> PriceBounds:
    """Return the bounds of one option with events, as vectors of one entry.

    At volatility 0 the spot is certain. At infinite volatility it goes to 0 on almost every path: a put brings the
    strike, less the escrow; a call is worth the spot, less the fractions and the yield paid before exercise.
    """
    sign = 1.0 if schedule.is_put else -1.0
    first, held = schedule.segments[0], 0.0 if schedule.is_put else schedule.spot
    european_lower, lower = certain_value(schedule, exercise=False), certain_value(schedule)
    now = first.escrow_at(0.0)
    at_once = sign * (schedule.strike - schedule.spot - now) if first.exercisable else 0.0
    upper, discount, share, spot = 0.0, 1.0, 1.0, schedule.spot
    for segment in schedule.segments:
        before = (discount, share)
        discount *= math.exp(-segment.rate * segment.duration)
        share *= math.exp(-segment.dividend_yield * segment.duration)
        escrow = discount * segment.escrow  # worth today the same at every time of the segment
        times = [before, (discount, share)] if segment.exercisable else [(discount, share)]
        if segment.exercisable or segment.exercise_at_end:
            most = max(sign * (bond * schedule.strike - escrow) for bond, _ in times)
            upper = max(upper, max(most, 0.0) + held * max(kept for _, kept in times))
        share *= 1.0 - segment.fraction
        spot *= math.exp((segment.rate - segment.dividend_yield) * segment.duration)
        spot = max(spot * (1.0 - segment.fraction) - segment.amount, 0.0)
    european_upper = discount * schedule.strike if schedule.is_put else held * share
    forward = math.log(spot / schedule.strike) if spot > 0.0 else -math.inf
    return PriceBounds(
        np.array([lower]),
        np.array([max(upper, european_upper) if schedule.spot > 0.0 else lower]),
        np.array([european_lower]),
        np.array([european_upper]),
        np.array([sign * forward]),
        np.array([0.0 < at_once >= lower]),
    )
