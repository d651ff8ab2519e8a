"""Which contracts have a closed formula: European ones, and those never exercised early, on a lognormal spot."""

from __future__ import annotations

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.arrays import BoolVector, every, some


def has_formula(book: Book) -> BoolVector:
    """Tell European contracts, and those never exercised early, whose spot at expiry is lognormal."""
    return (~may_exercise(book) | _never_exercised(book)) & is_lognormal(book)


def is_lognormal(book: Book) -> BoolVector:
    """Tell contracts whose spot at expiry is lognormal: without cash dividends in the spot model, and not local."""
    drops = book.drops() > 0.0
    found: BoolVector = ~_any(book, drops) if some(drops) else np.ones(book.count, dtype=bool)
    return found if book.local is None else found & ~book.is_local()


def may_exercise(book: Book) -> BoolVector:
    """Tell contracts that may be exercised before expiry, or just before a dividend at expiry."""
    segments = book.segments
    if book.is_plain:
        return segments.exercisable
    early = segments.exercise_at_end.copy()
    last = book.first[1:] - 1
    early[last] &= (segments.fraction[last] > 0.0) | (segments.due[last] > 0.0)
    return _any(book, early | segments.exercisable)


def _never_exercised(book: Book) -> BoolVector:
    """Tell contracts without dividends whose holder never earns by exercise.

    That is where at all times r <= 0 and r <= q for a put, q <= 0 and q <= r for a call (11.46): then r K - q S, what
    a put's exercise earns, is at most 0 wherever the payoff is positive.
    """
    segments, is_put = book.segments, book.per_segment(book.is_put)
    earned = np.where(is_put, segments.rate, segments.dividend_yield)
    if every(earned > 0.0):
        return np.zeros(book.count, dtype=bool)
    paid = np.where(is_put, segments.dividend_yield, segments.rate)
    never: BoolVector = (earned <= 0.0) & (earned <= paid)
    if book.is_plain:
        return never
    never &= (segments.fraction == 0.0) & (segments.due == 0.0)
    return never if book.is_simple else np.logical_and.reduceat(never, book.first[:-1])


def _any(book: Book, flags: BoolVector) -> BoolVector:
    return flags if book.is_simple else np.logical_or.reduceat(flags, book.first[:-1])
