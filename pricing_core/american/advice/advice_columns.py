"""Advice on exercise for every row of a book: how likely it is and when, and what a day of waiting costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.advice.exercise_advice import INTERRUPTED, boundaries_of, exercised
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.book.segments import Segments
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, NumericalError, PricingCoreError

DAY = 1.0 / DAYS_PER_YEAR


@dataclass(frozen=True, slots=True, eq=False)
class AdviceColumns:
    """Advice on n contracts, NaN where there is none, by the names of the results.

    Parameters
    ----------
    exercise_probability, expected_exercise_time, assignment_probability, cost_of_waiting : Vector, shape (n,)
    exercise_probability_error : Vector, shape (n,)
    """

    exercise_probability: Vector
    exercise_probability_error: Vector
    expected_exercise_time: Vector
    assignment_probability: Vector
    cost_of_waiting: Vector


def advice_columns(book: Book, found: Prices, request: Request) -> AdviceColumns:
    """Return the advice on contracts whose prices were found, one after the other.

    A contract takes 30 ms without events and without a local volatility, with either some tenths of a second.
    """
    columns = np.full((len(AdviceColumns.__slots__), book.count), math.nan)
    known = np.flatnonzero(~np.isnan(found.value))
    columns[4, known] = _cost_of_a_day(book.take(known), found.take(known), request.take(known))
    for row in known.tolist():
        try:
            columns[:4, row] = _advice(book.part(slice(row, row + 1)), bool(found.exercised[row]), request)
        except PricingCoreError:
            continue  # its price has its own status
    return AdviceColumns(*columns)


def _advice(book: Book, exercise_now: bool, request: Request) -> tuple[float, float, float, float]:
    """Return probability, its error, expected time and probability of assignment of one contract."""
    if exercise_now and book.expiry.item(0) > 0.0:
        return 1.0, 0.0, 0.0, 1.0
    if book.expiry.item(0) == 0.0:
        return 0.0, 0.0, math.nan, float(book.payoff().item(0) > 0.0)
    if (book.segments.volatility <= 0.0).any():
        raise InvalidInputError("volatility", 0.0, "above 0 in advice on exercise")

    def check() -> None:
        if request.is_interrupted():
            raise NumericalError(INTERRUPTED)

    at_strike = replace(book.diffusing_at(book.strike), reduction=None)
    boundaries = boundaries_of(at_strike, request.interrupt, check)
    march, error = exercised(book, boundaries, book.expiry, check)
    probability = march.probability
    when = march.first_moment() / probability if probability > 0.0 else math.nan
    return probability, error, when, probability + march.at_expiry


def _cost_of_a_day(book: Book, found: Prices, request: Request) -> Vector:
    """Return what the contracts are worth more than those that cannot be exercised for a day, money."""
    waited = solve(_without_rights(book, DAY), replace(request, greeks="none", share_solves=False))
    cost: Vector = np.maximum(found.value - waited.value, 0.0)
    return cost


def _without_rights(book: Book, time: float) -> Book:
    """Return the contracts without the right to exercise before a time; at expiry it stays."""
    owner = book.per_segment(np.arange(book.count))
    segments = book.segments
    cut = (segments.start < time) & (segments.end > time) & segments.exercisable
    names = Segments.__slots__
    columns = {name: np.repeat(getattr(segments, name), 1 + cut) for name in names}
    place = np.flatnonzero(cut) + np.arange(int(cut.sum()))  # of the first halves
    columns["end"][place] = columns["start"][place + 1] = time
    for name in ("fraction", "due"):
        columns[name][place] = 0.0
    early = (columns["start"] < time) & (columns["end"] <= time)
    last = np.zeros(early.size, dtype=bool)
    counts = np.diff(book.first) + np.bincount(owner[cut], minlength=book.count)
    first = np.concatenate([[0], np.cumsum(counts)])
    last[first[1:] - 1] = True
    columns["exercisable"] = columns["exercisable"] & ~early
    columns["exercise_at_end"] = columns["exercise_at_end"] & (~early | last | (columns["end"] >= time))
    return replace(book, first=first, segments=Segments(**columns))
