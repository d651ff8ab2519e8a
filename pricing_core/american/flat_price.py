"""Contracts in flat markets: the march; the general path; and where that misses the tolerance, that of schedules."""

import math
from collections.abc import Callable

from pricing_core.american.contract import Option
from pricing_core.american.limits import european_value
from pricing_core.american.market import FlatMarket, Market
from pricing_core.american.resolution import Resolution
from pricing_core.american.results import Valuation, without_price
from pricing_core.american.schedule import make_schedule
from pricing_core.american.scheduled import price_scheduled_alone
from pricing_core.american.tridiagonal_step import LCPMethod
from pricing_core.american.valuation import Method, march_value, price_alone


def price_flat(
    option: Option,
    market: FlatMarket,
    *,
    tolerance: float,
    method: Method = "auto",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: bool = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price one option without events, its arguments checked; they are those of `pricing_core.american.price`."""
    if method == "auto" and lcp_method == "tridiagonal" and resolution is None:
        if interrupt is not None and interrupt():
            return without_price(option, market.spot, european_value(option, market).value)
        marched = march_value(option, market, tolerance, greeks)
        if marched is not None:
            return marched
        return price_left_over(option, market, tolerance=tolerance, greeks=greeks, interrupt=interrupt)
    return price_alone(
        option,
        market,
        tolerance=tolerance,
        method=method,
        lcp_method=lcp_method,
        greeks=greeks,
        resolution=resolution,
        interrupt=interrupt,
    )


def price_left_over(
    option: Option,
    market: FlatMarket,
    *,
    tolerance: float,
    greeks: bool = True,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price by a formula or on the general path; parameters as for `pricing_core.american.price`.

    The path of schedules places the exercise boundaries inside their cells, which pays where there are two; it is
    slower, so it is taken only where the other misses the tolerance, and kept where its error is smaller.
    """
    first = price_alone(option, market, tolerance=tolerance, greeks=greeks, interrupt=interrupt)
    if first.status != "tolerance_not_met" or first.diagnostics.solved_by != "method of lines":
        return first
    general = Market(market.spot, market.rate, market.volatility, market.dividend_yield)
    second = price_scheduled_alone(
        option, general, make_schedule(option, general), tolerance, greeks=greeks, interrupt=interrupt
    )
    return second if _error(second) < _error(first) else first


def _error(valuation: Valuation) -> float:
    return math.inf if valuation.error_estimate is None else valuation.error_estimate
