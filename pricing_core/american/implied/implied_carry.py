"""The dividend yield and the forward that the prices of American calls and puts imply."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve, integral
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, DIVIDEND_YIELD, TOLERANCE
from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.carry_pairs import DIVIDENDS, Chain, Pairs, read_chain
from pricing_core.american.implied.implied_volatility_many import implied_volatility_many
from pricing_core.american.price_many import price_columns
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.arrays import BoolVector, Vector

PAIRS = 8  # Number of pairs of an expiry that are used, those nearest the money; chosen.
MOST_PASSES = 20  # Largest number of trial yields; chosen.
SETTLED = 2.0  # Largest change of the forward in the last pass, in tolerances times the spot; chosen.
COARSE = 1e-4  # Tolerance of the first pass, in strikes; chosen.
COARSE_SHARE = (
    0.03  # Tolerance of the next pass, as a share of the change of the forward over the spot; chosen.
)
# Tolerance of the implied volatilities, in those of the prices: a premium moves less than its price does; chosen.
VOLATILITY_TOLERANCES = 4.0
SMALLEST_SLOPE, LARGEST_SLOPE = -0.5, 0.8  # Limits of the slope that the secant believes; chosen.
ROBUST = 3.0 * 1.4826  # Three standard deviations of a normal distribution, in median absolute deviations.


@dataclass(frozen=True, slots=True, eq=False)
class ImpliedCarry:
    """The result of `implied_carry`; every array has shape (n,), one entry per expiry, in order.

    Parameters
    ----------
    expiry : Vector
        Years.
    forward : Vector
        Expected spot at expiry, after the dividends that are due by then, money per unit of underlying; NaN unless ok.
    dividend_yield : Vector
        1/year, continuously compounded, on top of the dividends that are given; the cost of borrowing is part of it.
        NaN unless ok.
    residual : Vector
        Root of the weighted mean square of what the pairs used miss parity by, money per unit of underlying; NaN
        unless ok.
    pairs_used : int array
    status : object array of str
        "ok"; "no_pairs": no call and put of one strike with prices that a volatility explains; "no_convergence": the
        yield did not settle, or lies outside -0.5 to 2.
    """

    expiry: Vector
    forward: Vector
    dividend_yield: Vector
    residual: Vector
    pairs_used: NDArray[np.int64]
    status: NDArray[np.object_]


class _Carry(NamedTuple):
    """What is known of the stock of one expiry, the spot without yield and dividends up to then."""

    forward: float = math.nan
    dividend_yield: float = math.nan
    residual: float = math.nan
    pairs_used: int = 0
    status: str = "no_pairs"


def implied_carry(
    chain: Mapping[str, Any], *, tolerance: float = DEFAULT_TOLERANCE, threads: int | None = None
) -> ImpliedCarry:
    """Return for every expiry of a chain the dividend yield at which call and put have one volatility per strike.

    At a trial yield the eight pairs nearest the money lose their early exercise premiums, each priced at the mean of
    the implied volatilities of call and put. What is left are European prices, and parity,

        C - P = X - K e^{-rT},    X = S e^{-qT} less the dividends given,

    gives a new yield, until it settles: then both implied volatilities agree. The pairs' X are averaged with weights
    1/width**2, leaving out those that are farther from the median than their own width and three robust standard
    deviations. European parity on American prices, without this, is biased by the difference of the premiums.

    Parameters
    ----------
    chain : mapping of str
        Quotes of one underlying: columns option_type, strike, expiry, and bid and ask or option_price, shape (n,) or
        scalar; spot, a number; rate, a number or a curve; exercise, "american" (default) or "european", for all;
        cash_dividends, proportional_dividends and dividend_model as in `Market`, where they are known. Rows without a
        bid above 0 and an ask at least as high take no part.
    tolerance : float
        Tolerance of the prices, as a fraction of the strike, 1e-8 to 1e-2.
    threads : int, optional
        How many to use, >= 1; one by default.

    Returns
    -------
    ImpliedCarry

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, lengths differ, or what the options share is outside what is allowed.

    Examples
    --------
    >>> from pricing_core.american import price_many
    >>> chain = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 1.0, "spot": 100.0, "rate": 0.05}
    >>> prices = price_many({**chain, "volatility": 0.2, "dividend_yield": 0.03})["price"]
    >>> carry = implied_carry({**chain, "option_price": prices})
    >>> carry.dividend_yield.round(4).tolist(), carry.forward.round(2).tolist()
    ([0.03], [102.02])
    """
    tolerance = TOLERANCE.check(tolerance)
    read = read_chain(chain)
    carries = [
        _carry(read, read.pairs.take(read.pairs.group == group), expiry, tolerance, threads)
        for group, expiry in enumerate(read.expiries.tolist())
    ]
    forwards, yields, residuals, used, statuses = zip(*carries, strict=True) if carries else ((),) * 5
    return ImpliedCarry(
        expiry=read.expiries,
        forward=np.array(forwards, dtype=np.float64),
        dividend_yield=np.array(yields, dtype=np.float64),
        residual=np.array(residuals, dtype=np.float64),
        pairs_used=np.array(used, dtype=np.int64),
        status=np.array(statuses, dtype=object),
    )


def discount(rate: Curve, time: float) -> float:
    """Return what a unit of money due at `time` is worth now."""
    return math.exp(-integral(rate, time))


def stock_value(market: Market, dividend_yield: float, expiry: float) -> float:
    """Return what the underlying to be had at expiry is worth now: its forward, discounted.

    That is S e^{-qT} less the dividends before, each with the yield that it would have paid. A spot that falls below
    a dividend is not thought of.
    """
    due = [d for d in market.cash_dividends if 0.0 < d.time <= expiry]
    drops = [(d.time, 0, d.fraction) for d in market.proportional_dividends if 0.0 < d.time <= expiry]
    value, last = market.spot, 0.0
    if market.dividend_model == "escrowed":
        value -= math.fsum(d.amount * discount(market.rate, d.time) for d in due)
    else:
        drops += [(d.time, 1, d.amount) for d in due]
    for time, kind, size in sorted(drops):  # on one date the proportional one comes first
        value *= math.exp(-dividend_yield * (time - last))
        value -= size * (discount(market.rate, time) if kind else value)
        last = time
    return value * math.exp(-dividend_yield * (expiry - last))


def _carry(chain: Chain, pairs: Pairs, expiry: float, tolerance: float, threads: int | None) -> _Carry:
    """Iterate on the yield of one expiry, from that of European parity."""
    market, discounted = chain.market, discount(chain.market.rate, expiry)
    middle = stock_value(market, 0.0, expiry) / discounted
    nearest = np.argsort(np.abs(pairs.strike - middle), kind="stable")[:PAIRS]
    pairs = pairs.take(nearest)
    parity = pairs.call - pairs.put + pairs.strike * discounted
    everywhere = np.ones(parity.size, dtype=bool)
    estimate = _estimate(chain, parity, pairs.width, everywhere, expiry)
    if chain.exercise == "european" or estimate.status != "ok":
        return _inside(estimate)
    here, before, now = _clipped(estimate.dividend_yield), (math.nan, math.nan), max(COARSE, tolerance)
    for _ in range(MOST_PASSES):
        identified, premium = _premiums(chain, pairs, here, now, threads)
        estimate = _estimate(chain, parity - premium, pairs.width, identified, expiry)
        if estimate.status != "ok":
            return estimate
        found = estimate.dividend_yield
        change = estimate.forward * discounted - stock_value(market, here, expiry)
        if now <= tolerance and abs(change) <= SETTLED * tolerance * market.spot:
            return _inside(estimate)
        now = max(min(COARSE_SHARE * abs(change) / market.spot, now), tolerance)
        slope = (found - before[1]) / (here - before[0])
        slope = 0.0 if math.isnan(slope) else min(max(slope, SMALLEST_SLOPE), LARGEST_SLOPE)
        there = _clipped(here + (found - here) / (1.0 - slope))
        if there == here:
            break
        here, before = there, (here, found)
    return _Carry(status="no_convergence")


def _inside(estimate: _Carry) -> _Carry:
    """Return the estimate if its yield is one that a market may have."""
    if estimate.status == "ok" and estimate.dividend_yield != _clipped(estimate.dividend_yield):
        return _Carry(status="no_convergence")
    return estimate


def _clipped(dividend_yield: float) -> float:
    return min(max(dividend_yield, DIVIDEND_YIELD.least), DIVIDEND_YIELD.most)


def _premiums(
    chain: Chain, pairs: Pairs, dividend_yield: float, tolerance: float, threads: int | None
) -> tuple[BoolVector, Vector]:
    """Return which pairs have two volatilities, and the call's early exercise premium less the put's at their mean."""
    count = pairs.strike.size
    columns: dict[str, Any] = {
        "option_type": np.repeat(["call", "put"], count),
        "strike": np.tile(pairs.strike, 2),
        "expiry": np.tile(pairs.expiry, 2),
        "spot": chain.market.spot,
        "rate": chain.market.rate,
        "dividend_yield": dividend_yield,
        **{name: value for name in DIVIDENDS if (value := getattr(chain.market, name)) not in ((), "spot")},
    }
    prices = np.concatenate([pairs.call, pairs.put])
    loose = min(VOLATILITY_TOLERANCES * tolerance, TOLERANCE.most)
    implied = implied_volatility_many(columns, prices, tolerance=loose, threads=threads)
    volatility = implied["volatility"].reshape(2, count).mean(axis=0)
    identified = np.isfinite(volatility)
    columns["volatility"] = np.tile(np.where(identified, volatility, np.nan), 2)
    table = price_columns(columns, PricingSettings(tolerance, "none"), threads)
    call, put = table["early_exercise_premium"].reshape(2, count)
    return identified & np.isfinite(call) & np.isfinite(put), call - put


def _estimate(chain: Chain, stock: Vector, width: Vector, identified: BoolVector, expiry: float) -> _Carry:
    """Return what the pairs' discounted forwards tell together."""
    stock, width = stock[identified], width[identified]
    if not stock.size:
        return _Carry()
    median = _weighted_median(stock, 1.0 / width)
    distance = np.abs(stock - median)
    used = distance <= np.maximum(width, ROBUST * float(np.median(distance)))
    weight = 1.0 / width[used] ** 2
    mean = float(np.average(stock[used], weights=weight))
    residual = math.sqrt(float(np.average((stock[used] - mean) ** 2, weights=weight)))
    found = _yield_of(chain.market, mean, expiry)
    return _Carry(mean / discount(chain.market.rate, expiry), found, residual, int(used.sum()), "ok")


def _weighted_median(values: Vector, weights: Vector) -> float:
    order = np.argsort(values, kind="stable")
    shares = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(shares, 0.5 * shares[-1])]])


def _yield_of(market: Market, stock: float, expiry: float) -> float:
    """Return the yield at which `stock_value` is `stock`; infinite where there is none."""
    found = 0.0
    for _ in range(MOST_PASSES):
        value = stock_value(market, found, expiry)
        if not (value > 0.0 and stock > 0.0):
            return math.inf
        change = math.log(value / stock) / expiry
        found += change
        if abs(change) <= 1e-14:
            break
    return found
