"""The front door to one price: check, and choose the path."""

from collections.abc import Callable
from dataclasses import replace

from pricing_core.american.contracts.contract import Option, check_kind, real_number
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import without_events
from pricing_core.american.contracts.tolerances import (
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
    check_moneyness,
)
from pricing_core.american.events.scheduled import price_scheduled
from pricing_core.american.extended_greeks import with_extended_greeks
from pricing_core.american.flat.resolution import Resolution
from pricing_core.american.flat.tridiagonal_step import LCPMethod
from pricing_core.american.flat_price import price_flat
from pricing_core.american.results import Valuation
from pricing_core.american.solver_settings import Greeks, Method, SolverSettings
from pricing_core.errors import InvalidInputError


def price(
    option: Option,
    market: Market,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: Greeks = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price an option to a tolerance.

    American options are solved as what they are, linear complementarity systems, (11.59)-(11.65) of Schumacher's
    chapter on complementarity systems; European ones in a flat market, and those never exercised early, by the closed
    formula.

    Parameters
    ----------
    option : Option
    market : Market
    tolerance : float
        Absolute error of the price as a fraction of the strike, 1e-8 to 1e-2.
    method : {"auto", "lcs", "crank-nicolson"}
        "auto" is, in a flat market, the compiled march of the premium in a frame that moves with the exercise
        boundary, and with dividends at known times, curves, Bermudan dates or exercise windows the collocation of
        the multiplier; where there are two boundaries, or these do not settle, "lcs": the general path on a fixed
        grid, stepped by SDIRK2. "crank-nicolson" is that path stepped by Crank and Nicolson's method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each step's complementarity problem on the general path; one other than "tridiagonal" takes
        "auto" there.
    greeks : bool or "extended"
        False leaves out vega, rho, dividend rho and the dividend sensitivities, which cost more than the price;
        "extended" adds vanna, volga, and rho and vega by the pieces of curves.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps on the general path, once, without extrapolation; the error is
        estimated from a second solve with half as many of each.
    interrupt : callable, optional
        Asked before every time step; True ends the work with status "deadline".

    Returns
    -------
    Valuation
        With status "tolerance_not_met" where the estimated error exceeds the tolerance at the finest
        resolution.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.

    Examples
    --------
    >>> valuation = price(Option("put", strike=100.0, expiry=1.0), Market(100.0, rate=0.05, volatility=0.2))
    >>> round(valuation.price, 3), round(valuation.exercise_boundary, 1), valuation.status
    (6.09, 80.9, 'ok')
    """
    tolerance = real_number("tolerance", tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    if greeks != "extended":
        check_kind("greeks", greeks, bool, 'True, False or "extended"')
    _check_choice("method", method, ("auto", "lcs", "crank-nicolson"))
    _check_choice("lcp_method", lcp_method, ("tridiagonal", "policy", "psor", "lemke"))
    check_moneyness(option, market.spot)
    settings = SolverSettings(tolerance, method, lcp_method, greeks, resolution, interrupt)
    plain = without_events(option, market)
    if plain is None:
        return price_scheduled(option, market, settings)
    valuation = price_flat(*plain, replace(settings, greeks=greeks is not False))
    return with_extended_greeks(valuation, *plain, market, tolerance) if greeks == "extended" else valuation


def _check_choice(field: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InvalidInputError(field, value, "one of " + ", ".join(f'"{choice}"' for choice in allowed))
