"""Contracts whose spot drifts much further than it diffuses, throughout or for some time.

They are marched with as much volatility as the march of obstacle problems resolves. A price grows with the volatility
(El Karoui, Jeanblanc-Picque, Shreve 1998, for American options on lognormal spots). Where the spot hardly diffuses at
all it lies between the value without any volatility and the one found, with four and eight times as much where no grid
resolves that. Where it does so for some time only, the error is what twice as much volatility there would add: at least
what the volatility has added, as that grows with the volatility or with its square.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, Prices, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.certain import certain_ends, certain_value, moved_boundary
from pricing_core.american.engines.engine import Boundaries, BoundariesAt, Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, least_volatility
from pricing_core.arrays import BoolVector, Vector

MARCH = CompiledMarch()
# Volatility of a time in which the spot hardly diffuses, over the least that is marched: with less the grids are too
# coarse for it, with more it changes the price more. Measured.
RAISED = 4.0, 8.0
LARGEST_DEVIATION = 0.02  # Standard deviation of ln S at expiry up to which the spot hardly diffuses; chosen.


class HardlyDiffusing:
    """The value with more volatility, or the middle between that and the one without any."""

    name = "hardly diffusing"
    method = "zero-volatility"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts that are marched with more volatility, and with their own not at all or on no grid maybe."""
        wanted = ~MARCH.serves(book) | (book.deviation <= LARGEST_DEVIATION)
        if not wanted.any():
            return wanted
        return wanted & ~book.is_local() & (book.expiry > 0.0) & MARCH.serves(_widened(book, 1.0))

    def solve(self, book: Book, request: Request) -> Prices:
        """Price with more volatility; Greeks have error estimates where the spot diffuses for some time."""
        narrow = book.deviation <= LARGEST_DEVIATION
        found = prices(book.count)
        for rows, price in ((narrow, _hardly), (~narrow, _for_some_time)):
            chosen = np.flatnonzero(rows)
            if chosen.size:
                found = found.replaced(chosen, price(book.take(chosen), request.take(chosen)))
        return replace(found, method=np.full(book.count, self.method, dtype=object))

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return the boundaries without volatility, which are off by some standard deviations of ln S at most."""

        def at(times: Vector) -> Boundaries:
            near, far = certain_ends(book, times, request.end_if_interrupted)
            return Boundaries(near, far, moved_boundary(book, near), np.ones(times.size, dtype=bool))

        return at


def _hardly(book: Book, request: Request) -> Prices:
    """Return the middle of the values without volatility and with more of it, and half their difference for an error.

    The Greeks are those with more volatility; they have no error estimates.
    """
    raised = _widened(book, 1.0)
    found, least = MARCH.solve(raised, request), certain_value(book)
    for factor in RAISED:
        rows = np.flatnonzero(~found.settled)
        if rows.size:
            found = found.replaced(rows, MARCH.solve(_widened(book.take(rows), factor), request.take(rows)))
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
    )


def _for_some_time(book: Book, request: Request) -> Prices:
    """Return what is found with more volatility, its errors larger by what twice as much of it changes."""
    found, more = (MARCH.solve(_raised(book, factor), request) for factor in RAISED)
    errors: dict[str, Any] = {
        name: getattr(found, name) + getattr(more, name) + np.abs(getattr(more, of) - getattr(found, of))
        for name, of in (
            ("error", "value"),
            ("boundary_error", "boundary"),
            *((error_of(n), n) for n in GREEKS),
        )
    }
    for of in GREEK_LISTS:
        name, apart = error_of(of), np.abs(getattr(more, of).values - getattr(found, of).values)
        own = getattr(found, name)
        errors[name] = Ragged(own.first, own.values + getattr(more, name).values + apart)
    return replace(
        found, **errors, complete=found.complete & more.complete, settled=found.settled & more.settled
    )


def _widened(book: Book, factor: float) -> Book:
    """Return the contracts with some times as much volatility as is marched."""
    return replace(book, segments=replace(book.segments, volatility=factor * least_volatility(book)))


def _raised(book: Book, factor: float) -> Book:
    """Return the contracts with some times as much volatility as is marched where there is less."""
    own, least = book.segments.volatility, least_volatility(book)
    volatility = np.where(own < least, factor * least, own)
    return replace(book, segments=replace(book.segments, volatility=volatility))
