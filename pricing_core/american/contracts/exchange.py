"""The option to exchange one asset for another, as a call on the first."""

from __future__ import annotations

import math

from pricing_core.american.contracts.checks import real_number
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import Curve
from pricing_core.american.contracts.fields import VOLATILITY, Exercise
from pricing_core.american.contracts.market import Market


def exchange_option(
    received: float,
    given: float,
    expiry: float,
    *,
    received_volatility: float,
    given_volatility: float,
    correlation: float,
    received_yield: Curve = 0.0,
    given_yield: Curve = 0.0,
    exercise: Exercise = "american",
) -> tuple[Option, Market]:
    """Return option and market whose value is that of the right to give one asset for another (Margrabe 1978).

    In units of the asset that is given, that asset's yield is the rate, and the strike is 1; times the asset's spot
    it is a call on the asset received, with the spot of the one given as its strike. Its delta is the derivative by
    the spot received; V - S delta over the spot given is that by the other. Tolerances are fractions of the spot given.

    Parameters
    ----------
    received, given : float
        Spots of the two assets, money per unit.
    expiry : float
        Years.
    received_volatility, given_volatility : float
        1/sqrt(year), of the logarithms of the spots.
    correlation : float
        Between these logarithms, -1 to 1.
    received_yield, given_yield : float or PiecewiseConstant
        1/year.
    exercise : {"american", "european"}

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.

    Examples
    --------
    >>> from pricing_core.american import price
    >>> volatilities = {"received_volatility": 0.2, "given_volatility": 0.15, "correlation": 0.5}
    >>> round(price(*exchange_option(100.0, 100.0, 1.0, **volatilities, received_yield=0.06)).price, 4)
    5.0745
    """
    one = VOLATILITY.check(received_volatility, "received_volatility")
    other = VOLATILITY.check(given_volatility, "given_volatility")
    rho = real_number("correlation", correlation, -1.0, 1.0)
    variance = one**2 + other**2 - 2.0 * rho * one * other
    option = Option("call", strike=given, expiry=expiry, exercise=exercise)
    volatility = math.sqrt(max(variance, 0.0))
    return option, Market(received, given_yield, volatility, dividend_yield=received_yield)
