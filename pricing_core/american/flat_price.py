"""Contracts in flat markets: the march; the general path; and where that misses the tolerance, that of schedules."""

import math

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket, Market
from pricing_core.american.events.scheduled import price_scheduled_alone
from pricing_core.american.flat.limits import european_value
from pricing_core.american.results import Valuation, without_price
from pricing_core.american.solver_settings import SolverSettings
from pricing_core.american.valuation import march_value, price_alone


def price_flat(option: Option, market: FlatMarket, settings: SolverSettings) -> Valuation:
    """Price one option without events."""
    if not settings.is_automatic:
        return price_alone(option, market, settings)
    if settings.is_interrupted():
        return without_price(option, market.spot, european_value(option, market).value)
    marched = march_value(option, market, settings.tolerance, settings.greeks is not False)
    return price_left_over(option, market, settings) if marched is None else marched


def price_left_over(option: Option, market: FlatMarket, settings: SolverSettings) -> Valuation:
    """Price by a formula or on the general path.

    The path of schedules places the exercise boundaries inside their cells, which pays where there are two; it is
    slower, so it is taken only where the other misses the tolerance, and kept where its error is smaller.
    """
    first = price_alone(option, market, settings)
    if first.status != "tolerance_not_met" or first.diagnostics.solved_by != "method of lines":
        return first
    general = Market(market.spot, market.rate, market.volatility, market.dividend_yield)
    second = price_scheduled_alone(option, general, settings)
    return second if _error(second) < _error(first) else first


def _error(valuation: Valuation) -> float:
    return math.inf if valuation.error_estimate is None else valuation.error_estimate
