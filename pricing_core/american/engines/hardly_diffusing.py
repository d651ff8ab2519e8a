"""Contracts whose spot drifts much further than it diffuses, between two values that are known.

A price grows with the volatility (El Karoui, Jeanblanc-Picque, Shreve 1998, for American options on lognormal spots):
it lies between the value without any and that with as much as the march of obstacle problems resolves.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, Prices, error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.certain import certain_ends, certain_value, moved_boundary
from pricing_core.american.engines.engine import Boundaries, BoundariesAt, Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, least_volatility
from pricing_core.arrays import BoolVector, Vector

MARCH = CompiledMarch()
LARGEST_DEVIATION = 0.02  # Standard deviation of ln S at expiry up to which the spot hardly diffuses; chosen.


class HardlyDiffusing:
    """The middle of the value without volatility and that with more of it, and half their difference for an error."""

    name = "hardly diffusing"
    method = "zero-volatility"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts that would be marched with more volatility, and are not with their own."""
        own = MARCH.serves(book)
        if own.all():
            return ~own
        narrow = (book.deviation() <= LARGEST_DEVIATION) & ~book.is_local() & (book.expiry > 0.0)
        return ~own & narrow & MARCH.serves(_raised(book))

    def solve(self, book: Book, request: Request) -> Prices:
        """Price with more volatility; what is found has its Greeks, which have no error estimates."""
        raised = _raised(book)
        found = MARCH.solve(raised, request)
        least = certain_value(book)
        most = np.maximum(found.value + found.error, least)
        unknown: dict[str, Any] = {error_of(name): np.full(book.count, math.nan) for name in GREEKS}
        for name in GREEK_LISTS:
            own = getattr(found, name)
            unknown[error_of(name)] = Ragged(own.first, np.full(own.values.size, math.nan))
        return replace(
            found,
            **unknown,
            value=0.5 * (least + most),
            european=np.minimum(found.european, most),
            error=0.5 * (most - least),
            boundary_error=found.boundary_error + moved_boundary(raised, found.boundary),
            method=np.full(book.count, self.method, dtype=object),
        )

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return the boundaries without volatility, which are off by some standard deviations of ln S at most."""
        del request

        def at(times: Vector) -> Boundaries:
            near, far = certain_ends(book, times)
            return Boundaries(near, far, moved_boundary(book, near), np.ones(times.size, dtype=bool))

        return at


def _raised(book: Book) -> Book:
    """Return the contracts with as much volatility as is marched, in each segment at least its own."""
    return replace(book, segments=replace(book.segments, volatility=least_volatility(book)))
