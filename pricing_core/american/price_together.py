"""Prices of several contracts that wait at the same time, by one call of each of the faster engines."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.valuation import Valuation, valuation
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.market import Market
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import ENGINES, solve


def price_together(
    contracts: Sequence[tuple[Option, Market]],
    book: Book,
    tolerances: Sequence[float],
    greeks: Greeks,
    interrupt: Callable[[], bool] | None = None,
) -> list[Valuation | None]:
    """Return what `price` returns for each contract; None where the compiled engines alone do not settle it.

    Parameters
    ----------
    contracts : sequence of (Option, Market)
        Whose spots are not out of all proportion to the strikes (`check_moneyness`).
    book : Book
        The contracts as a book.
    tolerances : sequence of float
        One for each, as in `price`.
    interrupt : callable, optional
        Asked between steps of the work; True ends it, and what is not settled then is None.
    """
    request = Request(np.array(tolerances), greeks, interrupt=interrupt)
    prices = solve(book, request, engines=ENGINES[:-1])
    ready = (prices.status == "ok") & prices.complete
    return [
        valuation(contract, book, prices, greeks=greeks != "none", row=row) if there else None
        for row, (contract, there) in enumerate(zip(contracts, ready.tolist(), strict=True))
    ]
