"""The volatility at which an option's price is the one observed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import ASK, BID, DEFAULT_TOLERANCE, OPTION_PRICE, TOLERANCE
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.tolerances import check_moneyness
from pricing_core.american.implied.volatility_pricers import find_volatilities
from pricing_core.american.implied.volatility_search import STATUSES, ImpliedStatus, why_none
from pricing_core.american.implied.volatility_targets import ANY_VOLATILITY
from pricing_core.errors import InvalidInputError, MissingInputError


@dataclass(frozen=True, slots=True)
class ImpliedVolatility:
    """The result of `implied_volatility`; None where a number is missing, as all but the status are unless it is "ok".

    Parameters
    ----------
    volatility : float or None
        1/sqrt(year), at most 15; of the mid where bid and ask are given.
    status : str
        - "ok";
        - "below_lower_bound": less than the value at volatility 0, by more than the tolerance;
        - "above_upper_bound": no volatility up to 15 makes the option worth so much. Without dividends an American
          put is worth less than K max(1, e^{-rT}) at any, a call less than S max(1, e^{-qT}); European ones less
          than K e^{-rT} and S e^{-qT};
        - "not_identifiable": the value at volatility 0, and of a whole interval of volatilities then: the intrinsic
          value in the exercise region, nothing far out of the money;
        - "no_convergence": the price could not be met, or the engine's error stays above ten tolerances.
    european_price : float or None
        Price of the European option at that volatility: the quote without its early exercise premium.
    price : float or None
        Price of the option itself at that volatility.
    error_estimate : float or None
        Error estimate of that price, money; above tolerance times strike only where the engine reaches no better.
    volatility_error : float or None
        Estimated absolute error of the volatility: what the price's error, and its distance to the quote, change it by.
    iterations : int
        Times that the option was priced; 0 where the bounds alone settle the status.
    method : str
        How that price was computed, as in `Valuation`; "none" unless ok.
    bid_volatility, ask_volatility : float or None
        The volatilities of bid and ask, where these are given and have one.
    price_bound : float or None
        What the price, or the mid, is below, not below, or equal to where the status is "below_lower_bound",
        "above_upper_bound" or "not_identifiable".
    message : str
        The same in words; empty for another status.
    """

    volatility: float | None
    status: ImpliedStatus
    european_price: float | None
    price: float | None
    error_estimate: float | None
    volatility_error: float | None
    iterations: int
    method: str
    bid_volatility: float | None = None
    ask_volatility: float | None = None
    price_bound: float | None = None
    message: str = ""


def implied_volatility(
    option: Option,
    market: Market,
    option_price: float | None = None,
    *,
    bid: float | None = None,
    ask: float | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    interrupt: Callable[[], bool] | None = None,
) -> ImpliedVolatility:
    """Return the constant volatility at which `price` gives the price observed.

    Parameters
    ----------
    option : Option
    market : Market
        Its volatility is ignored.
    option_price : float, optional
        Money per unit of underlying, >= 0.
    bid, ask : float, optional
        In the place of option_price, whose part their mean takes; 0 <= bid <= ask, ask > 0.
    tolerance : float
        What the price at the volatility may miss the one observed by, as a fraction of the strike, 1e-8 to 1e-2.
        The volatility is as good as tolerance times strike over vega.
    interrupt : callable, optional
        As in `price`; True ends the work with status "no_convergence".

    Returns
    -------
    ImpliedVolatility

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed, or both or neither of price and quote are given.

    Examples
    --------
    >>> option, market = Option("put", strike=100.0, expiry=1.0), Market(100.0, rate=0.05, volatility=0.2)
    >>> found = implied_volatility(option, market, option_price=6.0904)
    >>> round(found.volatility, 4), round(found.european_price, 4), found.status
    (0.2, 5.5736, 'ok')
    """
    tolerance = TOLERANCE.check(tolerance)
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    check_moneyness(option, market.spot)
    prices = _observed(option_price, bid, ask)
    contract = option, replace(market, volatility=ANY_VOLATILITY)
    book = Book.of([contract]).take(np.zeros(len(prices), dtype=np.intp))
    found = find_volatilities(book, np.array(prices), np.full(len(prices), tolerance), interrupt)
    sides = [_number(number) for number in found.volatility[1:]] or [None, None]
    return ImpliedVolatility(
        volatility=_number(found.volatility[0]),
        status=STATUSES[found.status.item(0)],
        european_price=_number(found.european[0]),
        price=_number(found.price[0]),
        error_estimate=_number(found.error[0]),
        volatility_error=_number(found.volatility_error[0]),
        iterations=found.pricings.item(0),
        method=found.method.item(0),
        bid_volatility=sides[0],
        ask_volatility=sides[1],
        price_bound=_number(found.price_bound[0]),
        message=why_none(STATUSES[found.status.item(0)], prices[0], found.price_bound.item(0)),
    )


def _observed(option_price: object, bid: object, ask: object) -> list[float]:
    """Return the price, or mid, bid and ask."""
    if option_price is not None:
        if bid is not None or ask is not None:
            raise InvalidInputError("option_price", option_price, "left out where bid and ask are given")
        return [OPTION_PRICE.check(option_price)]
    if bid is None or ask is None:
        missing = "option_price" if bid is None and ask is None else ("bid" if bid is None else "ask")
        raise MissingInputError(missing, "give option_price alone, or both bid and ask")
    low, high = BID.check(bid), ASK.check(ask)
    if high == 0.0 or low > high:
        raise InvalidInputError("ask", ask, f"above 0 and at least the bid, {low:g}")
    return [0.5 * (low + high), low, high]


def _number(number: float) -> float | None:
    return None if math.isnan(number) else float(number)
