"""The rate that discounts, and the yield that takes from the growth of the spot, of everything a market states.

Futures prices, borrow costs, quanto options and payments that lag behind exercise are reductions: the engines price an
option with another rate and another yield, and know nothing of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, at, seen_from, times_of
from pricing_core.american.contracts.dates import DAYS_PER_YEAR

if TYPE_CHECKING:
    from pricing_core.american.contracts.contract import Option
    from pricing_core.american.contracts.market import Market


def carry_yield(market: Market) -> Curve:
    """Return the yield q of a market: its spot grows at the rate r less q.

    - A spot: the dividend yield and the borrow rate.
    - A futures price does not grow: q = r (Black 1976).
    - Quanto: the underlying grows at the rate r_f of its own currency less the covariance of its logarithm with that
      of the currency's price, so r - r_f and the covariance add to q (Derman, Karasinski and Wecker 1990).

    Examples
    --------
    >>> from pricing_core.american import Market
    >>> carry_yield(Market(100.0, rate=0.05, volatility=0.2, dividend_yield=0.01, borrow_rate=0.02))
    0.03
    """
    if market.underlying == "future":
        return summed((1.0, market.rate), (1.0, market.quanto_covariance))
    terms: list[tuple[float, Curve]] = [(1.0, market.dividend_yield)]
    if market.borrow_rate != 0.0:
        terms.append((1.0, market.borrow_rate))
    if market.quanto_covariance != 0.0:
        terms.append((1.0, market.quanto_covariance))
    if market.foreign_rate is not None:
        terms += [(1.0, market.rate), (-1.0, market.foreign_rate)]
    return summed(*terms) if len(terms) > 1 else market.dividend_yield


def rate_and_yield(option: Option, market: Market) -> tuple[Curve, Curve]:
    """Return the rate and the yield with which the engines price the option paid at once.

    A payoff g that is paid the lag L after exercise at t is worth D(t) g then, D(t) = exp(-integral of r from t to
    t + L). V = D W with W the value of the option paid at once, of the same growth of the spot, and of the rate
    r(t + L): that is (11.46) with D(t) W(t, S) put in.
    """
    rate, dividend_yield = market.rate, carry_yield(market)
    if option.settlement_lag == 0.0 or not isinstance(rate, PiecewiseConstant):
        return rate, dividend_yield
    later = seen_from(rate, option.settlement_lag / DAYS_PER_YEAR)
    return later, summed((1.0, dividend_yield), (1.0, later), (-1.0, rate))


def summed(*terms: tuple[float, Curve]) -> Curve:
    """Return the sum of curves, each times a number.

    Examples
    --------
    >>> summed((1.0, 0.5), (-1.0, PiecewiseConstant([0.5, 1.0], [0.25, 0.125]))).values
    (0.25, 0.375)
    """
    times = sorted({time for _, curve in terms for time in times_of(curve)})
    values: list[float] = [
        sum(weight * at(curve, start) for weight, curve in terms) for start in [0.0, *times[:-1]]
    ]
    return PiecewiseConstant(tuple(times), tuple(values)) if len(set(values)) > 1 else values[0]
