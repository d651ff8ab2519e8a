"""The engine of the collocation of two boundaries."""

from __future__ import annotations

import math

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.flat_options import is_flat, price_flat, puts_of
from pricing_core.arrays import BoolVector, Vector


class BoundaryCollocation:
    """One segment, two exercise boundaries."""

    name = "boundary collocation"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell American contracts without events and with a positive volatility whose region has two boundaries."""
        now = book.first_segments()
        earned = np.where(book.is_put, now.rate, now.dividend_yield)
        paid = np.where(book.is_put, now.dividend_yield, now.rate)
        return is_flat(book) & (earned < 0.0) & (paid < earned)

    def solve(self, book: Book, request: Request) -> Prices:
        """Solve for the boundaries of all contracts."""
        return price_flat(book, request, method="boundary-collocation", two_boundaries=True)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundaries of one solve, refined until two agree; NaN before they meet."""
        strike, is_put = book.strike[0], book.is_put[0]
        put, tau = puts_of(book), np.maximum(book.expiry[0] - times, 0.0)
        nothing = np.full(times.size, math.nan)
        found = kernel.two_boundaries(
            put.rate[0],
            put.dividend[0],
            put.spread[0],
            tau / book.expiry[0],
            BOUNDARY_ACCURACY * math.sqrt(request.tolerance[0]),
            request.interrupt,
        )
        if found is None:
            return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
        upper, lower, change = found
        near, far = (strike * np.exp(places if is_put else -places) for places in (upper, lower))
        error = np.where(np.isnan(near), math.nan, change * near)
        return Boundaries(near, far, error, np.ones(times.size, dtype=bool))
