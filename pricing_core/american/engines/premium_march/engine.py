"""The engine of the premium's march, which the kernel takes from contracts to prices and Greeks in money."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import CURVES, Book, Rows
from pricing_core.american.book.prices import Prices, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, PARALLEL, of_dividends_not_due
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.premium_march.puts import Puts, solve_boundaries
from pricing_core.arrays import BoolVector, Vector

GREEKS: tuple[Greeks, ...] = (
    "none",
    "standard",
    "extended",
)  # In the order of the kernel's numbers for them.
SMALLEST_SPREAD = 1e-7  # Smallest standard deviation of ln S at expiry that the kernel marches.


class PremiumMarch:
    """One segment, one exercise boundary."""

    name = "premium march"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell American contracts without events and with a positive volatility; the kernel may still give them up."""
        if kernel.price_options is None:
            return np.zeros(book.count, dtype=bool)
        now = book.first_segments()
        served = now.exercisable & (now.volatility * np.sqrt(now.end) >= SMALLEST_SPREAD) & (book.spot > 0.0)
        if book.local is not None:
            served &= ~book.is_local()
        return served if book.is_plain else served & ~book.has_events()

    def solve(self, book: Book, request: Request) -> Prices:
        """March the premiums of all contracts."""
        return _march(book, request)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundary of marches to each of the times, refined until two agree."""
        schedule, nothing = book.schedule(0), np.full(times.size, math.nan)
        limit, far = region_at_expiry(schedule).boundaries(schedule)
        if not math.isnan(far):
            return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
        tau = np.maximum(book.expiry[0] - times, 0.0)
        later = np.flatnonzero(tau > 0.0)
        near, error, found = np.full(tau.size, limit), np.zeros(tau.size), np.ones(tau.size, dtype=bool)
        puts = _as_puts(_with_lives(book.take(np.zeros(later.size, dtype=np.intp)), tau[later]))
        accuracy = BOUNDARY_ACCURACY * math.sqrt(request.tolerance[0])
        places, relative, found[later] = solve_boundaries(puts, accuracy, request.interrupt)
        with np.errstate(over="ignore"):  # in those that were not found
            near[later] = schedule.strike * np.exp(places if schedule.is_put else -places)
        error[later] = relative * near[later]
        return Boundaries(near, nothing, error, found)


def _with_lives(book: Book, years: Vector) -> Book:
    """Return the contracts with these lives."""
    return replace(book, segments=replace(book.segments, end=years))


def _as_puts(book: Book) -> Puts:
    """Return the puts: a call is one with spot and strike, and rate and yield, exchanged."""
    segments, expiry = book.segments, book.segments.end
    x = np.log(book.spot / book.strike)
    return Puts(
        np.where(book.is_put, x, -x),
        np.where(book.is_put, segments.rate, segments.dividend_yield) * expiry,
        np.where(book.is_put, segments.dividend_yield, segments.rate) * expiry,
        segments.volatility * np.sqrt(expiry),
    )


def _march(book: Book, request: Request) -> Prices:
    now, greeks = book.segments, request.greeks
    columns, exercised, settled, steps = kernel.price_options(
        book.is_put,
        book.spot,
        book.strike,
        now.end,
        now.rate,
        now.dividend_yield,
        now.volatility,
        request.tolerance,
        GREEKS.index(greeks),
        request.share_solves,
        request.threads,
        request.interrupt,
    )
    lists: dict[str, Any] = {"complete": True}
    if greeks != "none":
        lists[DIVIDENDS] = of_dividends_not_due(book)
    if greeks == "extended":
        lists |= _buckets(book, columns)
    return prices(
        book.count,
        exercised=exercised,
        settled=settled,
        method="premium-march",
        solves=1,
        steps=steps,
        **columns,
        **lists,
    )


def _buckets(book: Book, found: dict[str, Vector]) -> dict[str, Any]:
    """Return the buckets of curves that do not change any more, with their errors; `complete` tells where all are."""
    expiry = book.segments.end
    columns: dict[str, Any] = {"complete": np.ones(book.count, dtype=bool)}
    for name in CURVES:
        times = getattr(book.listed, name)
        if times.values.size == 0:
            columns[BUCKETS[name]] = columns[error_of(BUCKETS[name])] = times
            continue
        for bucket, parallel in (
            (BUCKETS[name], PARALLEL[name]),
            (error_of(BUCKETS[name]), error_of(PARALLEL[name])),
        ):
            columns[bucket], whole = _whole_in_one_piece(times, expiry, found[parallel])
        columns["complete"] &= whole
    return columns


def _whole_in_one_piece(times: Ragged, expiry: Vector, derivative: Vector) -> tuple[Ragged, BoolVector]:
    """Return the buckets of curves of which one piece alone holds before expiry, and for which contracts that is so."""
    values, whole = np.zeros(times.values.size), np.ones(expiry.size, dtype=bool)
    for row in np.flatnonzero(times.counts()).tolist():
        ends: Rows = times.first[row : row + 2]
        pieces = times.values[ends[0] : ends[1]]
        values[ends[0]] = derivative[row]
        whole[row] = pieces.size == 1 or bool(pieces[0] >= expiry[row])
        if not whole[row]:
            values[ends[0] : ends[1]] = math.nan
    return Ragged(times.first, values), whole
