"""The search for volatilities with this library's engines: the fast ones first, all of them for what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.engine import Engine, Request
from pricing_core.american.engines.price_bounds import stated_bounds
from pricing_core.american.engines.solve import ENGINES, FAST_ENGINES, solve
from pricing_core.american.implied.volatility_search import (
    NO_CONVERGENCE,
    NOT_SERVED,
    FoundVolatilities,
    Pricer,
    search,
)
from pricing_core.american.implied.volatility_targets import Targets
from pricing_core.arrays import Vector


def find_volatilities(
    book: Book, prices: Vector, tolerance: Vector, interrupt: Callable[[], bool] | None = None
) -> FoundVolatilities:
    """Search the volatilities of all contracts of a book, whose own are ignored.

    Parameters
    ----------
    prices, tolerance : Vector, shape (n,)
        Money, and fractions of the strikes.
    interrupt : callable, optional
        Asked before every round of prices; True ends the search with status "no_convergence".
    """
    targets = Targets(prices, stated_bounds(book), book.spot, book.strike, book.expiry, tolerance)
    found = search(targets, _pricer(book, FAST_ENGINES, interrupt, with_vega=True))
    left = np.flatnonzero(found.status == NOT_SERVED)
    if left.size:
        every = _pricer(book.take(left), ENGINES, interrupt, with_vega=False)
        found.store(left, search(targets.take(left), every))
    found.status[found.status == NOT_SERVED] = NO_CONVERGENCE
    return found


def _pricer(
    book: Book, engines: Sequence[Engine], interrupt: Callable[[], bool] | None, *, with_vega: bool
) -> Pricer:
    """Return the function that prices some of the contracts at volatilities, by these engines."""

    def price_at(rows: NDArray[np.intp], volatility: Vector, tolerance: Vector, vega: bool) -> Prices:
        greeks: Greeks = "standard" if vega and with_vega else "none"
        request = Request(tolerance, greeks, interrupt=interrupt)
        return solve(book.take(rows).with_volatility(volatility), request, engines=engines)

    return price_at
