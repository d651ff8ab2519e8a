"""What an option may cost at volatilities from zero to infinity: no price lies outside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.engines.certain import certain_value
from pricing_core.arrays import BoolVector, Vector, every, some


@dataclass(frozen=True, slots=True, eq=False)
class PriceBounds:
    """Bounds of n options; money per unit of underlying, every field of shape (n,).

    Parameters
    ----------
    lower, european_lower : Vector
        The value at volatility 0, and that of the option without early exercise.
    upper, european_upper : Vector
        What these tend to as the volatility grows.
    out_of_the_money : Vector
        ln(F/K) for a put, ln(K/F) for a call, F the forward.
    at_once : bool array
        Whether exercise now is best at volatility 0, and brings something.
    """

    lower: Vector
    upper: Vector
    european_lower: Vector
    european_upper: Vector
    out_of_the_money: Vector
    at_once: BoolVector

    def take(self, rows: Rows) -> PriceBounds:
        """Return the bounds of some of the options."""
        return PriceBounds(*(getattr(self, name)[rows] for name in self.__slots__))


def stated_bounds(book: Book) -> PriceBounds:
    """Return the bounds of the contracts as they are stated: those of `bounds_of`, paid after the lag."""
    bounds = bounds_of(book)
    if book.reduction is None:
        return bounds
    names = ("lower", "upper", "european_lower", "european_upper")
    return replace(bounds, **{name: book.reduction.discount * getattr(bounds, name) for name in names})


def range_of(book: Book) -> tuple[Vector, Vector]:
    """Return the least that exercise now, or never, brings, and the largest price without arbitrage, shape (n,)."""
    return np.where(book.now.exercisable, book.payoff(), 0.0), bounds_of(book).upper


def lies_high(book: Book, value: Vector) -> BoolVector:
    """Return False, by a quick test, for values that surely do not lie above the largest price without arbitrage."""
    if some(book.escrowed):
        return np.ones(book.count, dtype=bool)
    largest, segments = np.where(book.is_put, book.strike, book.spot), book.segments
    if every(segments.exercisable):  # then the bound is at least what exercise may bring
        return np.asarray(value > largest)
    is_put = book.is_put if book.is_simple else book.per_segment(book.is_put)
    carried = np.where(is_put, segments.rate, segments.dividend_yield) * segments.duration
    with np.errstate(divide="ignore"):
        lost = carried if book.is_plain else carried - np.where(is_put, 0.0, np.log1p(-segments.fraction))
    lost = lost if book.is_simple else np.add.reduceat(lost, book.first[:-1])
    held: BoolVector = value > largest * np.exp(-np.maximum(lost, 0.0))
    return held


def bounds_of(book: Book) -> PriceBounds:
    """Return the bounds of the contracts, whose volatilities are ignored.

    At volatility 0 the spot is certain. At infinite volatility it goes to 0 on almost every path: a put brings the
    strike, less the escrow; a call the spot, less the fractions and the yield paid before exercise, and what the escrow
    exceeds the strike by; each with interest to the best time; European ones with interest to expiry (Merton 1973).
    """
    segments, sign, K, count = book.segments, book.sign, book.strike, book.count
    lower, european_lower = certain_value(book), certain_value(book.european())
    start = book.diffusing()
    spot, held = start.copy(), np.where(book.is_put, 0.0, start)
    discount, share, upper = np.ones(count), np.ones(count), np.zeros(count)
    duration, escrow, drops = segments.duration, book.escrow(), book.drops()
    with np.errstate(all="ignore"):
        for rows, at in book.by_place():
            h, exercisable = duration[at], segments.exercisable[at]
            before = discount[rows], share[rows]
            after = (
                before[0] * np.exp(-segments.rate[at] * h),
                before[1] * np.exp(-segments.dividend_yield[at] * h),
            )
            due = after[0] * escrow[at]  # worth today the same at every time of the segment
            bond = sign[rows] * (after[0] * K[rows] - due)
            earlier = np.where(exercisable, sign[rows] * (before[0] * K[rows] - due), bond)
            stock = np.maximum(after[1], np.where(exercisable, before[1], 0.0))
            most = np.maximum(np.maximum(bond, earlier), 0.0) + held[rows] * stock
            allowed = exercisable | segments.exercise_at_end[at]
            upper[rows] = np.maximum(upper[rows], np.where(allowed, most, 0.0))
            discount[rows], share[rows] = after[0], after[1] * (1.0 - segments.fraction[at])
            grown = spot[rows] * np.exp((segments.rate[at] - segments.dividend_yield[at]) * h)
            spot[rows] = np.maximum(grown * (1.0 - segments.fraction[at]) - drops[at], 0.0)
        european_upper = np.where(book.is_put, K * discount, held * share)
        forward = np.log(spot / K)
    now = np.where(book.now.exercisable, sign * (K - book.spot), 0.0)
    certain = (start == 0.0) | (book.expiry == 0.0)
    return PriceBounds(
        lower,
        np.where(certain, lower, np.maximum(upper, european_upper)),
        european_lower,
        european_upper,
        sign * forward,
        (now > 0.0) & (now >= lower),
    )
