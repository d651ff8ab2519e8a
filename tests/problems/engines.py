"""One contract, or a few, asked of one engine."""

from collections.abc import Callable

import numpy as np

from pricing_core.american import Greeks, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import Engine, Request


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
