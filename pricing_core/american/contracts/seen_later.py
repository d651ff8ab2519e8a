"""A contract as it will be at a later time: what is left of its life, its dividends and its curves."""

from __future__ import annotations

from dataclasses import replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.dividends import CashDividend, ProportionalDividend
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
        rate=_later(market.rate, time),
        dividend_yield=_later(market.dividend_yield, time),
        volatility=_later(market.volatility, time),
        cash_dividends=tuple(
            CashDividend(d.time - time, d.amount) for d in market.cash_dividends if d.time > time
        ),
        proportional_dividends=tuple(
            ProportionalDividend(d.time - time, d.fraction)
            for d in market.proportional_dividends
            if d.time > time
        ),
    )


def _later(curve: Curve, time: float) -> Curve:
    if not isinstance(curve, PiecewiseConstant):
        return curve
    left = [(t - time, value) for t, value in zip(curve.times, curve.values, strict=True) if t > time]
    if not left:
        return curve.values[-1]
    return PiecewiseConstant(*zip(*left, strict=True))
