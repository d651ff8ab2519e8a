"""The engine of the premium's march, which the kernel takes from contracts to prices and Greeks in money."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.engine import Boundaries, BoundariesAt, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.premium_march.flat_contracts import is_flat, price_flat, puts_of
from pricing_core.american.engines.premium_march.puts import solve_boundaries
from pricing_core.arrays import BoolVector, Vector


class PremiumMarch:
    """One segment, one exercise boundary."""

    name = "premium march"
    method = "premium-march"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell American contracts without events and with a positive volatility; the kernel may still give them up."""
        return is_flat(book)

    def solve(self, book: Book, request: Request) -> Prices:
        """March the premiums of all contracts."""
        return price_flat(book, request, method=self.method)

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return the boundary of marches to each of the times, refined until two agree."""
        return lambda times: self._boundary(book, times, request)

    def _boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        nothing, strike, is_put = np.full(times.size, math.nan), book.strike.item(), book.is_put.item()
        limit, far = region_at_expiry(book.segments_of()[-1], is_put=is_put).boundaries(strike, is_put=is_put)
        if not math.isnan(far):
            return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
        tau = np.maximum(book.expiry[0] - times, 0.0)
        later = np.flatnonzero(tau > 0.0)
        near, error, found = np.full(tau.size, limit), np.zeros(tau.size), np.ones(tau.size, dtype=bool)
        puts = puts_of(_with_lives(book.take(np.zeros(later.size, dtype=np.intp)), tau[later]))
        accuracy = BOUNDARY_ACCURACY * math.sqrt(request.tolerance[0])
        places, relative, found[later] = solve_boundaries(puts, accuracy, request.interrupt)
        with np.errstate(over="ignore"):  # in those that were not found
            near[later] = strike * np.exp(places if is_put else -places)
        error[later] = relative * near[later]
        return Boundaries(near, nothing, error, found)


def _with_lives(book: Book, years: Vector) -> Book:
    """Return the contracts with these lives."""
    return replace(book, segments=replace(book.segments, end=years))
