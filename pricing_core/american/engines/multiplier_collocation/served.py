"""Which contracts the collocation may be tried on."""

from __future__ import annotations

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.arrays import BoolVector, Vector

# Largest distance of ln(spot) and ln(strike), in standard deviations of ln S at expiry; chosen.
FURTHEST = 30.0
LARGEST_CALL_DEVIATION = 4.0  # Largest standard deviation of ln S at expiry for a call; measured.
LARGEST_DRIFT = 6.0  # Largest drift of ln S over one segment, in standard deviations over it; calibrated.


def is_served(book: Book) -> BoolVector:
    """Tell for which schedules the collocation may be tried.

    Every segment must have a positive volatility, large enough beside its drift; spot and strike must be within reach
    of each other; and a call's spot must not spread so far that its parts cancel.
    """
    starts, segments = book.first[:-1], book.segments
    duration, x = segments.duration, log_moneyness(book)
    spread = segments.volatility * np.sqrt(duration)
    deviation = np.sqrt(np.add.reduceat(spread * spread, starts))
    served = (book.spot > 0.0) & (np.abs(x) <= FURTHEST * deviation)
    drift = np.abs(segments.rate - segments.dividend_yield) * duration
    served &= np.logical_and.reduceat((spread > 0.0) & (drift <= LARGEST_DRIFT * spread), starts)
    return served & (book.is_put | (deviation <= LARGEST_CALL_DEVIATION))


def log_moneyness(book: Book) -> Vector:
    """Return ln(S/K) of the spot that diffuses, shape (n,)."""
    spot = book.spot - book.escrow_now() if book.escrowed.any() else book.spot
    with np.errstate(divide="ignore", invalid="ignore"):  # a spot of 0, or below what is escrowed by rounding
        return np.log(spot) - np.log(book.strike)
