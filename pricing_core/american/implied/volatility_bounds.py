"""What one option may cost at volatilities from zero to infinity."""

from __future__ import annotations

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.engines.price_bounds import bounds_of

ANY_VOLATILITY = 0.2  # Volatility, 1/sqrt(year), that stands in for the one that is looked for.


def price_bounds(option: Option, market: Market) -> tuple[float, float]:
    """Return the value at volatility 0, and what the value tends to as the volatility grows; money.

    Parameters
    ----------
    option : Option
    market : Market
        Its volatility is ignored.

    Raises
    ------
    InvalidInputError
        Escrowed dividends are worth the spot or more.

    Examples
    --------
    A put that is exercised now brings 10, and no volatility makes it worth its strike (Merton 1973):

    >>> price_bounds(Option("put", 100.0, 1.0), Market(spot=90.0, rate=0.05, volatility=0.2))
    (10.0, 100.0)
    """
    bounds = bounds_of(Book.of([(option, market)]))
    return bounds.lower.item(), bounds.upper.item()
