"""Price one option to a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.resolution import LCPMethod, Resolution
from pricing_core.american.book.valuation import Valuation, valuation
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, GREEKS, TOLERANCE, Greeks
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.tolerances import check_moneyness
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.american.method import Method, engines_of
from pricing_core.errors import NumericalError


def price(
    option: Option,
    market: Market,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: Greeks = "standard",
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price an option to a tolerance.

    American options are solved as what they are, linear complementarity systems, (11.59)-(11.65) of Schumacher's
    chapter on complementarity systems; European ones whose spot at expiry is lognormal, and those never exercised
    early, by the closed formula.

    Parameters
    ----------
    option : Option
    market : Market
    tolerance : float
        Absolute error of the price as a fraction of the strike, 1e-8 to 1e-2.
    method : {"auto", "lcs", "crank-nicolson"}
        "auto" is, without events, the compiled march of the premium in a frame that moves with the exercise
        boundary; where there are two boundaries, dividends at known times, curves, Bermudan dates, exercise windows or
        a local volatility the march of the obstacle problem. "lcs" is the chapter's road: the system (11.63) on a grid,
        stepped by SDIRK2, one complementarity problem a stage; "crank-nicolson" is that stepped by Crank and Nicolson's
        method. Contracts with a closed formula are priced by it in any case.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each stage's complementarity problem on the chapter's road; one other than "tridiagonal" takes
        "auto" there. The first two are policy iteration, whose linear systems are tridiagonal.
    greeks : {"none", "standard", "extended"}
        "none" leaves out all Greeks; "extended" adds vanna, volga, charm, and rho, dividend rho and vega by
        the pieces of curves.
    resolution : Resolution, optional
        Solve by the chapter's road at exactly this grid and these steps, once, without extrapolation; the error is
        estimated from a second solve with half as many of each.
    interrupt : callable, optional
        Asked between steps of the work; True ends it with status "deadline".

    Returns
    -------
    Valuation
        With status "tolerance_not_met" where the estimated error exceeds the tolerance at the finest
        resolution.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.
    NumericalError
        No engine could price the contract.

    Examples
    --------
    >>> valuation = price(Option("put", strike=100.0, expiry=1.0), Market(100.0, rate=0.05, volatility=0.2))
    >>> round(valuation.price, 3), round(valuation.exercise_boundary, 1), valuation.status
    (6.09, 80.9, 'ok')
    """
    tolerance = TOLERANCE.check(tolerance)
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    greeks = GREEKS.check_choice(greeks)
    engines = engines_of(method, lcp_method, resolution)
    check_moneyness(option, market.spot)
    request = Request(np.array([tolerance]), greeks, interrupt=interrupt)
    book = Book.of([(option, market)])
    prices = solve(book, request, engines=engines)
    if prices.status[0] == "out_of_domain":
        raise NumericalError(prices.message[0] or "no method could price this contract")
    return valuation((option, market), book, prices, greeks=greeks != "none")
