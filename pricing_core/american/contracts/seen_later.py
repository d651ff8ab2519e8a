"""A contract as it will be at a later time: what is left of its life, its dividends and its curves."""

from __future__ import annotations

from dataclasses import replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import seen_from
from pricing_core.american.contracts.dividends import CashDividend, ProportionalDividend
from pricing_core.american.contracts.local_volatility import volatility_seen_from
from pricing_core.american.contracts.market import Market


def seen_later(option: Option, market: Market, time: float) -> tuple[Option, Market]:
    """Return the contract seen from `time`, 0 <= time <= expiry, just after what happens then.

    Examples
    --------
    >>> later, _ = seen_later(Option("put", 100.0, 1.0, exercise_start=0.5), Market(100.0, 0.05, 0.2), 0.75)
    >>> later.expiry, later.exercise_start
    (0.25, 0.0)
    """
    left = tuple(t - time for t in option.exercise_times if t > time)
    held = replace(
        option,
        expiry=option.expiry - time,
        exercise="european" if option.exercise == "bermudan" and not left else option.exercise,
        exercise_times=left,
        exercise_start=max(option.exercise_start - time, 0.0),
    )
    return held, replace(
        market,
        rate=seen_from(market.rate, time),
        dividend_yield=seen_from(market.dividend_yield, time),
        volatility=volatility_seen_from(market.volatility, time),
        borrow_rate=seen_from(market.borrow_rate, time),
        foreign_rate=None if market.foreign_rate is None else seen_from(market.foreign_rate, time),
        cash_dividends=tuple(
            CashDividend(d.time - time, d.amount) for d in market.cash_dividends if d.time > time
        ),
        proportional_dividends=tuple(
            ProportionalDividend(d.time - time, d.fraction)
            for d in market.proportional_dividends
            if d.time > time
        ),
    )
