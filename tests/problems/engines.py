"""One contract, or a few, asked of one engine."""

from collections.abc import Callable

import numpy as np

from pricing_core.american import Greeks, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import Engine, Request
from pricing_core.american.engines.multiplier_collocation import MultiplierCollocation
from pricing_core.american.engines.multiplier_collocation.served import is_served


class CollocationAlone(MultiplierCollocation):
    """The collocation, asked of contracts without events as well, where it is the march's independent check."""

    def serves(self, book):
        """Tell what the collocation can do, whoever else could."""
        return is_served(book)


def solved(
    engine: Engine,
    *contracts: tuple[Option, Market],
    tolerance: float = 1e-6,
    greeks: Greeks = "none",
    interrupt: Callable[[], bool] | None = None,
) -> Prices:
    """Return what the engine alone says of contracts that it serves."""
    book = Book.of(contracts)
    assert engine.serves(book).all()
    return engine.solve(book, Request(np.full(book.count, tolerance), greeks, interrupt=interrupt))
