"""Derivatives by the market's parameters: differences of solves that are smooth in them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.dividends import CashDividend
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import Schedule, make_schedule
from pricing_core.american.results import FurtherGreeks

VOLATILITY_SHARE = 0.005  # of the volatility
RATE_STEP = 1e-3  # of a rate, over the years to expiry where they are more than one
AMOUNT_STEP, AMOUNT_SHARE = 1e-3, 0.2  # of the spot, and at most of the amount

Values = Sequence[tuple[float, float]]  # value and delta, money, of each schedule


@dataclass(frozen=True, slots=True)
class ScheduledGreeks:
    """Money per 1.00 of each parameter."""

    vega: float
    rho: float
    dividend_rho: float
    further: FurtherGreeks

    def is_whole(self) -> bool:
        """Tell whether none of them is NaN; vanna and volga, which may be left out, aside."""
        further = self.further
        pieces = (further.dividend_sensitivities, further.rate_bucket_rho, further.volatility_bucket_vega)
        numbers = (
            self.vega,
            self.rho,
            self.dividend_rho,
            *chain.from_iterable(part or () for part in pieces),
        )
        return not any(math.isnan(number) for number in numbers)


@dataclass(frozen=True, slots=True)
class _Difference:
    """Markets and the weights of their values."""

    markets: tuple[Market, ...]
    weights: tuple[float, ...]

    def of(self, values: Sequence[float]) -> float:
        return math.fsum(weight * value for weight, value in zip(self.weights, values, strict=True))


@dataclass(frozen=True, slots=True)
class GreeksPlan:
    """The schedules whose values give the derivatives.

    Parameters
    ----------
    schedules : tuple of Schedule
        All to be solved as finely as the contract itself.
    """

    market: Market
    extended: bool
    differences: tuple[_Difference, ...]
    schedules: tuple[Schedule, ...]

    def finish(self, base: float, values: Values) -> ScheduledGreeks:
        """Return the derivatives.

        Parameters
        ----------
        base : float
            Value of the contract itself, solved as finely.
        values : sequence of (float, float)
            Value and delta of each of the schedules, money.
        """
        remaining = iter(values)
        parts = [[next(remaining) for _ in difference.markets] for difference in self.differences]
        found = [d.of([value for value, _ in part]) for d, part in zip(self.differences, parts, strict=True)]
        rest = iter(found[3:])
        dividends = tuple(next(rest) for _ in self.market.cash_dividends)
        (up, delta_up), (down, delta_down) = parts[0]
        weight = self.differences[0].weights[0]  # 1/(2 step)
        buckets = [
            tuple(next(rest) for _ in curve.values) if isinstance(curve, PiecewiseConstant) else None
            for curve in ((self.market.rate, self.market.volatility) if self.extended else (0.0, 0.0))
        ]
        further = FurtherGreeks(
            dividend_sensitivities=dividends if dividends else None,
            vanna=weight * (delta_up - delta_down) if self.extended else math.nan,
            volga=(up - 2.0 * base + down) * (2.0 * weight) ** 2 if self.extended else math.nan,
            rate_bucket_rho=buckets[0],
            volatility_bucket_vega=buckets[1],
        )
        vega, rho, dividend_rho = found[:3]
        return ScheduledGreeks(vega, rho, dividend_rho, further)


def plan_greeks(option: Option, market: Market, *, extended: bool) -> GreeksPlan:
    """Return what must be solved for the derivatives by volatility, rate, yield and dividends.

    Parameters
    ----------
    extended : bool
        Whether vanna, volga and the pieces of curves are wanted.
    """
    differences = tuple(_differences(option, market, extended))
    schedules = tuple(make_schedule(option, bumped) for d in differences for bumped in d.markets)
    return GreeksPlan(market, extended, differences, schedules)


def _differences(option: Option, market: Market, extended: bool) -> Iterator[_Difference]:
    rate_step = RATE_STEP / max(1.0, option.expiry)
    steps = {
        "volatility": VOLATILITY_SHARE * _smallest(market.volatility),
        "rate": rate_step,
        "dividend_yield": rate_step,
    }
    for name, step in steps.items():
        curve: Curve = getattr(market, name)
        if (
            name != "volatility" and 0.0 <= min(_values(curve)) < step
        ):  # below zero exercise is another matter
            markets = tuple(_with(market, name, _shifted(curve, by)) for by in (0.0, step, 2.0 * step))
            yield _forward(markets, step)
        else:
            yield _central(tuple(_with(market, name, _shifted(curve, by)) for by in (step, -step)), step)
    for index, dividend in enumerate(market.cash_dividends):
        yield _by_amount(market, index, dividend, option.expiry)
    for name in ("rate", "volatility") if extended else ():
        curve = getattr(market, name)
        step, pieces = steps[name], curve.values if isinstance(curve, PiecewiseConstant) else ()
        for piece, at in enumerate(pieces):
            forward = name == "rate" and 0.0 <= at < step  # as above
            by = (0.0, step, 2.0 * step) if forward else (step, -step)
            bumped = tuple(_with(market, name, _shifted(curve, shift, piece)) for shift in by)
            yield (_forward if forward else _central)(bumped, step)


def _central(markets: tuple[Market, ...], step: float) -> _Difference:
    return _Difference(markets, (0.5 / step, -0.5 / step))


def _forward(markets: tuple[Market, ...], step: float) -> _Difference:
    """Return the one-sided difference of second order."""
    return _Difference(markets, (-1.5 / step, 2.0 / step, -0.5 / step))


def _by_amount(market: Market, index: int, dividend: CashDividend, expiry: float) -> _Difference:
    """Return a central difference, or a one-sided one of the same order where the amount is next to nothing."""
    if not 0.0 < dividend.time <= expiry:
        return _Difference((), ())
    step = AMOUNT_STEP * market.spot
    if dividend.amount > 0.0:
        step = min(step, AMOUNT_SHARE * dividend.amount)
        return _central(tuple(_paying(market, index, dividend.amount + by) for by in (step, -step)), step)
    markets = tuple(_paying(market, index, amount) for amount in (0.0, step, 2.0 * step))
    return _forward(markets, step)


def _paying(market: Market, index: int, amount: float) -> Market:
    dividends = list(market.cash_dividends)
    dividends[index] = CashDividend(dividends[index].time, amount)
    return _with(market, "cash_dividends", tuple(dividends))


def _with(market: Market, name: str, value: object) -> Market:
    """Return the market with one field replaced, unchecked: a bump may leave what is allowed."""
    bumped = replace(market)
    object.__setattr__(bumped, name, value)
    return bumped


def _shifted(curve: Curve, by: float, piece: int | None = None) -> Curve:
    """Return the curve with all its values, or one of them, shifted."""
    if not isinstance(curve, PiecewiseConstant):
        return curve + by
    values = tuple(v + by if piece in (None, i) else v for i, v in enumerate(curve.values))
    return PiecewiseConstant(curve.times, values)


def _values(curve: Curve) -> tuple[float, ...]:
    return curve.values if isinstance(curve, PiecewiseConstant) else (curve,)


def _smallest(curve: Curve) -> float:
    return min((value for value in _values(curve) if value > 0.0), default=1.0)
