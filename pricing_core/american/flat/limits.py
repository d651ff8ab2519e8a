"""Options that need no grid: at expiry, without uncertainty, European, never exercised early."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.closed_form import european_values, zero_volatility_value
from pricing_core.american.flat.exercise_region import never_exercised

SMALLEST_SPREAD = 1e-12  # volatility * sqrt(expiry) below which chance makes no difference


@dataclass(frozen=True, slots=True)
class ClosedValue:
    """Value and derivatives in money, from a formula.

    Units as in `pricing_core.american.Valuation`. `error` bounds what the formula leaves out, in money.
    """

    value: float
    delta: float
    gamma: float
    theta: float
    vega: float
    rho: float
    dividend_rho: float
    error: float = 0.0


def is_closed_form(option: Option, market: FlatMarket) -> bool:
    """Whether the European formula (or its limit) is the answer whatever the tolerance."""
    return option.exercise == "european" or never_exercised(option, market)


def expired_value(option: Option, market: FlatMarket) -> ClosedValue:
    """Return the intrinsic value of an option at expiry."""
    payoff = option.payoff(market.spot)
    slope = 0.0 if payoff == 0.0 else (-1.0 if option.is_put else 1.0)
    return ClosedValue(payoff, slope, 0.0, 0.0, 0.0, 0.0, 0.0)


def european_value(option: Option, market: FlatMarket) -> ClosedValue:
    """Return the European option with its Greeks; spot, volatility and expiry may be 0."""
    if option.expiry == 0.0:
        return expired_value(option, market)
    if market.spot == 0.0 or market.volatility * math.sqrt(option.expiry) < SMALLEST_SPREAD:
        european = Option(option.option_type, option.strike, option.expiry, "european")
        return replace(deterministic_value(european, market), error=deterministic_error(option, market))
    x = np.array([math.log(market.spot) - math.log(option.strike)])
    rows = european_values(option.option_type, x, option.expiry, market)
    K, S = option.strike, market.spot
    slope, curvature, value = (float(a[0]) for a in (rows.slope, rows.curvature, rows.value))
    return ClosedValue(
        value=K * value,
        delta=K / S * slope,
        gamma=K / S * (curvature / S),
        theta=K * holding_theta(market, value, slope, curvature),
        vega=K * float(rows.by_volatility[0]),
        rho=K * float(rows.by_rate[0]),
        dividend_rho=K * float(rows.by_yield[0]),
        error=1e-15 * (K + S),
    )


def holding_theta(market: FlatMarket, value: float, slope: float, curvature: float) -> float:
    """Return dV/dt / K where the option is held, from (11.46): r v - (r - q) v_x - sigma**2/2 (v_xx - v_x)."""
    drift = market.rate - market.dividend_yield
    return market.rate * value - drift * slope - 0.5 * market.volatility**2 * curvature


def deterministic_value(option: Option, market: FlatMarket) -> ClosedValue:
    """Return the option where ln(spot) does not diffuse: zero volatility, or a spot of zero.

    The holder exercises at the best time, `zero_volatility_value`; the derivatives are those of the payoff at
    that time.
    """
    value, best = zero_volatility_value(option, market)
    if value == 0.0:
        return ClosedValue(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    sign = 1.0 if option.is_put else -1.0
    bond = option.strike * math.exp(-market.rate * best)
    stock = market.spot * math.exp(-market.dividend_yield * best)
    at_expiry = best == option.expiry
    return ClosedValue(
        value=value,
        delta=-sign * math.exp(-market.dividend_yield * best),
        gamma=0.0,
        theta=sign * (market.rate * bond - market.dividend_yield * stock) if at_expiry else 0.0,
        vega=0.0,
        rho=-sign * best * bond,
        dividend_rho=sign * best * stock,
    )


def is_deterministic(option: Option, market: FlatMarket, tolerance: float) -> bool:
    """Whether chance matters less than a tenth of the tolerance, a fraction of the strike."""
    return deterministic_error(option, market) <= 0.1 * tolerance * option.strike


def deterministic_error(option: Option, market: FlatMarket) -> float:
    """Return a bound on |V - V(volatility 0)|, in money.

    For every stopping time |E e^{-r t} (K - S_t)^+ - ...| <= S e^{-q t} E |e^{sigma W - sigma**2 t/2} - 1|,
    and by Doob's inequality E sup |...| <= 2 sqrt(e^{sigma**2 T} - 1).
    """
    variance = market.volatility**2 * option.expiry
    if variance == 0.0 or market.spot == 0.0:
        return 0.0
    if variance > 1.0:
        return math.inf
    growth = max(1.0, math.exp(-market.dividend_yield * option.expiry))
    return 2.0 * market.spot * growth * math.sqrt(math.expm1(variance))
