"""Which contracts the collocation may be tried on."""

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.arrays import BoolVector, Vector

# Largest distance of ln(spot) and ln(strike), in standard deviations of ln S at expiry; chosen.
FURTHEST = 30.0
LARGEST_CALL_DEVIATION = 4.0  # Largest standard deviation of ln S at expiry for a call; measured.
LARGEST_DRIFT = 6.0  # Largest drift of ln S over one segment, in standard deviations over it; calibrated.
SAFE = 3.5  # Fall of ln S, in standard deviations, after which dividends must leave a put's spot; calibrated.
WIDEST = 400.0  # Largest standard deviation of ln S at expiry over that of one segment; measured.
# Largest growth of the share by a negative yield over a segment before a cash dividend, for a put; measured.
LARGEST_OVERHANG = 1e-4
SMALLEST_SPREAD = 1e-7  # Smallest standard deviation of ln S over one segment; measured.


def is_served(book: Book) -> BoolVector:
    """Tell for which schedules the collocation may be tried.

    Every segment must have a positive volatility, large enough beside its drift, and a standard deviation no smaller
    than 1/WIDEST of the whole one; spot and strike must be within reach of each other; a call's spot must not spread
    so far that its parts cancel; and no dividend may be likely to take a put's spot to zero, where the contact set
    begins in a way that is not followed.
    """
    starts, segments = book.first[:-1], book.segments
    duration, x = segments.duration, log_moneyness(book)
    spread = segments.volatility * np.sqrt(duration)
    deviation = np.sqrt(np.add.reduceat(spread * spread, starts))
    least = np.minimum.reduceat(spread, starts)
    served = (book.spot > 0.0) & (np.abs(x) <= FURTHEST * deviation)
    served &= (least >= SMALLEST_SPREAD) & (least >= deviation / WIDEST)
    drift = np.abs(segments.rate - segments.dividend_yield) * duration
    served &= np.logical_and.reduceat(drift <= LARGEST_DRIFT * spread, starts)
    narrow = np.where(book.is_put, _keeps_its_spot(book, spread), deviation <= LARGEST_CALL_DEVIATION)
    return served & narrow


def _keeps_its_spot(book: Book, spread: Vector) -> BoolVector:
    """Tell whether a put's dividends are small against its spot when they are paid, with all but certainty."""
    segments, escrow = book.segments, book.escrow()
    amount = book.drops() / book.per_segment(book.strike)
    growth = np.exp((segments.rate - segments.dividend_yield) * segments.duration)
    forward, (variance, paid) = np.exp(log_moneyness(book)), np.zeros((2, book.count))
    lowest = np.empty(spread.size)  # at every end, before its dividend, on a path that falls as far as it may
    for rows, at in book.by_place():
        ahead = forward[rows] * growth[at]
        variance[rows] += spread[at] ** 2
        fallen = np.exp(-SAFE * np.sqrt(variance[rows]))
        lowest[at] = np.minimum(ahead, 1.0) * fallen - paid[rows] * (1.0 - fallen)
        forward[rows] = np.maximum(ahead * (1.0 - segments.fraction[at]) - amount[at], 0.0)
        paid[rows] += amount[at]
    likely = (amount > 0.0) & (amount >= lowest)
    # Before a cash dividend and with a negative yield, exercise begins between two spots, and later at smaller ones.
    # Before a proportional dividend it begins at a spot of zero, whatever the yield.
    overhang = -segments.dividend_yield * segments.duration
    paid_in_cash = (amount > 0.0) | (escrow > 0.0)
    between = paid_in_cash & segments.exercisable & (overhang > LARGEST_OVERHANG) & (segments.rate > 0.0)
    return ~np.logical_or.reduceat(likely | between, book.first[:-1]) & (forward > 0.0)


def log_moneyness(book: Book) -> Vector:
    """Return ln(S/K) of the spot that diffuses, shape (n,)."""
    spot = book.spot - book.escrow_now() if book.escrowed.any() else book.spot
    with np.errstate(divide="ignore"):  # a spot of 0
        return np.log(spot) - np.log(book.strike)
