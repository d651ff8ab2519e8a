"""Closed formulas: the European option with its sensitivities, the perpetual boundary, zero volatility.

Dimensionless throughout, as in (11.51)-(11.52): x = ln(S/K), v = V/K, tau = time to expiry.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.arrays import Vector

ONE_OVER_SQRT_TWO_PI = 1.0 / math.sqrt(2.0 * math.pi)
LARGEST_EXPONENT = 700.0  # exp of more overflows


@dataclass(frozen=True, slots=True)
class EuropeanValues:
    """v and its derivatives at log-moneyness x; every field has the shape of x.

    Parameters
    ----------
    value : Vector
        v = V/K.
    slope, curvature : Vector
        v_x and v_xx - v_x, that is S delta / K and S**2 gamma / K.
    by_volatility, by_rate, by_yield : Vector
        dv/dsigma, dv/dr, dv/dq.
    """

    value: Vector
    slope: Vector
    curvature: Vector
    by_volatility: Vector
    by_rate: Vector
    by_yield: Vector


def european_values(option_type: str, x: Vector, tau: float, market: FlatMarket) -> EuropeanValues:
    """Evaluate Black, Scholes and Merton's formula for volatility * sqrt(tau) > 0.

    Parameters
    ----------
    x : Vector
        ln(S/K); -inf for S = 0 is allowed.
    tau : float
        Years, > 0.
    """
    sign = 1.0 if option_type == "call" else -1.0
    spread = market.volatility * math.sqrt(tau)
    d1 = (x + (market.rate - market.dividend_yield) * tau) / spread + 0.5 * spread
    d2 = d1 - spread
    stock = np.exp(np.minimum(x - market.dividend_yield * tau, LARGEST_EXPONENT))
    bond = math.exp(-market.rate * tau)
    in_stock = sign * stock * ndtr(sign * d1)
    in_bond = sign * bond * ndtr(sign * d2)
    density = stock * ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * np.square(d1))
    return EuropeanValues(
        value=in_stock - in_bond,
        slope=in_stock,
        curvature=density / spread,
        by_volatility=density * math.sqrt(tau),
        by_rate=tau * in_bond,
        by_yield=-tau * in_stock,
    )


def perpetual_boundary(market: FlatMarket, option_type: str) -> float:
    """Return S*/K of the option without expiry; 0 (put) or inf (call) where it is never exercised.

    With L the negative root of sigma**2 L (L - 1)/2 + (r - q) L - r = 0, S*/K = L/(L - 1) for the put
    (McKean 1965; Merton 1973); the call by exchanging r and q.

    Examples
    --------
    >>> round(40 * perpetual_boundary(FlatMarket(36.0, rate=0.06, volatility=0.2), "put"), 12)
    30.0
    """
    rate, dividend_yield = market.rate, market.dividend_yield
    if option_type == "call":
        rate, dividend_yield = dividend_yield, rate
    boundary = _perpetual_put_boundary(rate, dividend_yield, market.volatility)
    if option_type == "put":
        return boundary
    return 1.0 / boundary if boundary > 0.0 else math.inf


def _perpetual_put_boundary(rate: float, dividend_yield: float, volatility: float) -> float:
    if rate <= 0.0:
        return 0.0
    variance = volatility * volatility
    drift = rate - dividend_yield - 0.5 * variance
    root = math.sqrt(drift * drift + 2.0 * variance * rate)
    # -L without cancellation or division by a vanishing variance: -L = (drift + root)/variance.
    if drift >= 0.0:
        ratio = variance / (drift + root) if drift + root > 0.0 else 0.0
    else:
        ratio = (root - drift) / (2.0 * rate)
    return 1.0 / (1.0 + ratio)  # L/(L - 1) = 1/(1 + 1/(-L))


def zero_volatility_value(option: Option, market: FlatMarket) -> tuple[float, float]:
    """Return the value without uncertainty and the best time to exercise, in money and years.

    The spot is S e^{(r - q) t}; exercise at t is worth, today, +-(K e^{-rt} - S e^{-qt}) or nothing. A smooth
    function with one stationary point, r K e^{-rt} = q S e^{-qt}: the best of both ends and that point.
    """
    sign = 1.0 if option.is_put else -1.0
    rate, dividend_yield = market.rate, market.dividend_yield

    def exercised_at(t: float) -> float:
        pays = option.strike * math.exp(-rate * t) - market.spot * math.exp(-dividend_yield * t)
        return max(sign * pays, 0.0)

    times = [option.expiry]
    if option.exercise == "american":
        times.insert(0, 0.0)
        costs = rate * option.strike  # of waiting, at once; it can underflow
        ratio = dividend_yield * market.spot / costs if costs != 0.0 else 0.0
        if ratio > 0.0 and rate != dividend_yield:
            stationary = math.log(ratio) / (dividend_yield - rate)
            if 0.0 < stationary < option.expiry:
                times.append(stationary)
    best = max(times, key=exercised_at)
    return exercised_at(best), best
