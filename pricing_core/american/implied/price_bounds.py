"""What one option may cost, whatever the volatility."""

from dataclasses import replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import make_schedule, without_events
from pricing_core.american.contracts.tolerances import DEFAULT_TOLERANCE
from pricing_core.american.implied.volatility_bounds import book_bounds, schedule_bounds
from pricing_core.american.tables.book import single_row

ANY_VOLATILITY = 0.2


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
    market = replace(market, volatility=ANY_VOLATILITY)
    plain = without_events(option, market)
    if plain is None:
        bounds = schedule_bounds(make_schedule(option, market))
    else:
        bounds = book_bounds(single_row(*plain, DEFAULT_TOLERANCE))
    return bounds.lower.item(), bounds.upper.item()
