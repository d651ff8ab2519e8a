"""Advice on exercise for every row of a book: how likely it is and when, and what a day of waiting costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.advice.cost_of_waiting import without_rights
from pricing_core.american.advice.exercise_advice import INTERRUPTED, boundaries_of, exercised
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
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
    waited = solve(
        without_rights(book, np.full(book.count, DAY)), replace(request, greeks="none", share_solves=False)
    )
    cost: Vector = np.maximum(found.value - waited.value, 0.0)
    return cost
