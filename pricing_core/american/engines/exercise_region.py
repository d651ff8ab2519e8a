"""The interval of spots at which a contract is exercised."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.american.contracts.fields import SPOT
from pricing_core.arrays import Vector

LARGEST_EXPONENT = 700.0  # Largest exponent of e that does not overflow.


@dataclass(frozen=True, slots=True)
class ExerciseRegion:
    """The log-moneyness interval [lower, upper] in which the option is exercised; empty where lower > upper.

    The end that belongs to the far side (S -> 0 for a put, S -> inf for a call) is infinite unless there are
    two boundaries.
    """

    lower: float
    upper: float

    def contains(self, x: float) -> bool:
        """Whether x lies in the closed region."""
        return self.lower <= x <= self.upper

    def boundaries(self, strike: float, *, is_put: bool) -> tuple[float, float]:
        """Return S*, the boundary nearer the strike, and the other one, in money; NaN where there is none."""
        if self.lower > self.upper:
            return math.nan, math.nan
        ends = (self.upper, self.lower) if is_put else (self.lower, self.upper)
        near, far = (strike * math.exp(min(end, LARGEST_EXPONENT)) for end in ends)
        return near if near <= SPOT.most else math.nan, far if 0.0 < far <= SPOT.most else math.nan


EMPTY_REGION = ExerciseRegion(math.inf, -math.inf)


def region_at_expiry(last: Segment, *, is_put: bool) -> ExerciseRegion:
    """Return the limit of the exercise region just before expiry in ln(S/K), of a contract with this last segment.

    It is right where nothing happens at expiry. Where the holder may not exercise all through the last segment, it is
    wherever the payoff is positive.
    """
    if last.exercisable:
        return earning_region(last, is_put=is_put)
    return ExerciseRegion(-math.inf, 0.0) if is_put else ExerciseRegion(0.0, math.inf)


def earning_region(segment: Segment, *, is_put: bool) -> ExerciseRegion:
    """Return where the payoff is positive and holding it earns less than exercising, in ln(S/K).

    r K > q S for the put: S/K below min(1, r/q) for r, q > 0, in [r/q, 1] for q < r < 0; the call with the
    inequalities reversed. The exercise region begins there before expiry.
    """
    # A call is a put with rate and yield exchanged, and its region mirrored at the strike.
    earned, paid = segment.rate, segment.dividend_yield
    if not is_put:
        earned, paid = paid, earned
    if earned <= 0.0 and earned <= paid:
        return EMPTY_REGION
    if earned < 0.0:
        lower, upper = math.log(earned / paid), 0.0
    else:
        lower, upper = -math.inf, math.log(earned / paid) if 0.0 < earned < paid else 0.0
    return ExerciseRegion(lower, upper) if is_put else ExerciseRegion(-upper, -lower)


def closing_times(book: Book) -> Vector:
    """Return when waiting for the next drop begins to be worth more than exercise, at spots that hardly diffuse.

    Years from now, shape (n,); NaN where that is not between now and the end of the first segment. Exercise of a put
    earns K (1 - exp(-r t)) - S (1 - exp(-q t)) until the drop t years later, which is worth exp(-r t) times itself. Up
    to about then the spot may be in the exercise region, which closes fast.
    """
    now, spot, strike = book.now, book.diffusing(), book.strike
    drop = now.due + now.fraction * spot
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        about = drop / (now.rate * strike - now.dividend_yield * spot)
        lost = strike - spot * -np.expm1(-now.dividend_yield * about)
        waits = np.log((strike + drop) / lost) / now.rate
        known = book.is_put & now.exercisable & (about > 0.0) & (waits > 0.0) & (waits < now.end)
    return np.where(known, now.end - waits, math.nan)


def limits_before_expiry(book: Book) -> Vector:
    """Return where exercise boundaries begin before expiry other than at the strike, of two the one nearer the strike.

    Spots that diffuse, money, shape (n,), of the last segment that has such a limit; NaN where none has.
    """
    return np.array([_limit(book, row) for row in range(book.count)], dtype=np.float64)


def _limit(book: Book, row: int) -> float:
    strike, is_put = book.strike.item(row), book.is_put.item(row)
    for segment in reversed(book.segments_of(row)):
        if segment.exercisable:
            near, _ = earning_region(segment, is_put=is_put).boundaries(strike, is_put=is_put)
            if near > 0.0 and near != strike:
                return near
    return math.nan
