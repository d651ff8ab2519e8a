"""Vanna, volga and derivatives by the pieces of curves for options in flat markets."""

import math
from dataclasses import replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.market import FlatMarket, Market
from pricing_core.american.flat_price import price_flat
from pricing_core.american.results import Valuation
from pricing_core.american.solver_settings import SolverSettings

VOLATILITY_SHARE = 0.01  # of the volatility: the step of the differences


def with_extended_greeks(
    valuation: Valuation, option: Option, flat: FlatMarket, market: Market, tolerance: float
) -> Valuation:
    """Return the valuation with vanna and volga: differences of delta and vega by the volatility.

    A curve that does not change before expiry has its whole rho or vega in the piece that holds then.
    """
    vanna, volga = _by_volatility(valuation, option, flat, tolerance)
    return replace(
        valuation,
        vanna=vanna,
        volga=volga,
        rate_bucket_rho=_bucket(market.rate, valuation.rho),
        volatility_bucket_vega=_bucket(market.volatility, valuation.vega),
    )


def _by_volatility(
    valuation: Valuation, option: Option, flat: FlatMarket, tolerance: float
) -> tuple[float | None, float | None]:
    """Return vanna and volga."""
    if valuation.vega is None or flat.volatility == 0.0:
        return None, None
    if valuation.exercise_now:
        return 0.0, 0.0
    step = VOLATILITY_SHARE * flat.volatility
    up, down = (
        price_flat(option, replace(flat, volatility=flat.volatility + by), SolverSettings(tolerance))
        for by in (step, -step)
    )
    return _difference(up.delta, down.delta, step), _difference(up.vega, down.vega, step)


def _difference(up: float | None, down: float | None, step: float) -> float | None:
    return None if up is None or down is None else (up - down) / (2.0 * step)


def _bucket(curve: Curve, derivative: float | None) -> tuple[float, ...] | None:
    if not isinstance(curve, PiecewiseConstant):
        return None
    whole = math.nan if derivative is None else derivative
    return (whole, *(0.0 for _ in curve.values[1:]))
