"""The dividend yield and the forward that the prices of American calls and puts imply."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

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

if TYPE_CHECKING:
    from pricing_core.american.arrow.frames import Frame

PAIRS = 8  # Number of pairs of an expiry that are used, those nearest the money; chosen.
MOST_PASSES = 20  # Largest number of trial yields; chosen.
SETTLED = 2.0  # Largest change of the forward in the last pass, in tolerances times the spot; chosen.
COARSE = 1e-4  # Tolerance of the first pass, in strikes; chosen.
COARSE_SHARE = (
    0.03  # Tolerance of the next pass, as a share of the change of the forward over the spot; chosen.
)
# Tolerance of the implied volatilities, in those of the prices: a premium moves less than its price does; chosen.
VOLATILITY_TOLERANCES = 4.0
# Number of passes after which the pairs that count stay the same, so that none comes and goes for ever; chosen.
CHOOSING_PASSES = 6
NEAR = 2.0  # Distance from the median, in widths of the quotes, at which a pair always counts; chosen.
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


class ExpiryCarry(NamedTuple):
    """The forward of one expiry: the spot, and its dividends and growth up to then without a yield.

    Parameters
    ----------
    pairs : Pairs, optional
        Those nearest the money, m of them, whether or not they count.
    stock : Vector, shape (m,)
        What each of them says of the discounted forward, its early exercise premiums taken out.
    used : bool array, shape (m,)
        Which of them count.
    """

    forward: float = math.nan
    dividend_yield: float = math.nan
    residual: float = math.nan
    pairs_used: int = 0
    status: str = "no_pairs"
    pairs: Pairs | None = None
    stock: Vector = np.empty(0)
    used: BoolVector = np.empty(0, dtype=bool)


class Premiums(NamedTuple):
    """The early exercise premiums of pairs at the mean of both implied volatilities; arrays of shape (m,).

    Parameters
    ----------
    identified : bool array
        Whether both volatilities were found.
    call_less_put : Vector
        Money per unit of underlying.
    """

    identified: BoolVector
    call_less_put: Vector


def implied_carry(
    chain: Mapping[str, Any] | Frame, *, tolerance: float = DEFAULT_TOLERANCE, threads: int | None = None
) -> ImpliedCarry:
    """Return for every expiry of a chain the dividend yield at which call and put have one volatility per strike.

    At a trial yield the eight pairs nearest the money lose their early exercise premiums, each priced at the mean of
    the implied volatilities of call and put. What is left are European prices, and parity,

        C - P = X - K e^{-rT},    X = S e^{-qT} less the dividends given,

    gives a new yield, until it settles: then both implied volatilities agree. The pairs' X are averaged with weights
    1/width**2, leaving out those that are farther from the median than twice their own width and three robust
    standard deviations. European parity on American prices, without this, is biased by the difference of the premiums.

    Parameters
    ----------
    chain : mapping of str, or a frame
        Quotes of one underlying: columns option_type, strike, expiry or both dates, and bid and ask or option_price,
        shape (n,) or scalar. For all rows alike, as one value or as a column of equal ones: spot; rate, a number or a
        curve; exercise, "american" (default) or "european"; cash_dividends, proportional_dividends and dividend_model
        as in `Market`, where they are known. Rows without a bid above 0 and an ask at least as high take no part.
        Other columns of a frame are not read.
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
    carries = [carry_of_expiry(read, group, tolerance, threads) for group in range(read.expiries.size)]
    return ImpliedCarry(
        expiry=read.expiries,
        forward=np.array([carry.forward for carry in carries], dtype=np.float64),
        dividend_yield=np.array([carry.dividend_yield for carry in carries], dtype=np.float64),
        residual=np.array([carry.residual for carry in carries], dtype=np.float64),
        pairs_used=np.array([carry.pairs_used for carry in carries], dtype=np.int64),
        status=np.array([carry.status for carry in carries], dtype=object),
    )


def discount(rate: Curve, time: float) -> float:
    """Return the present value of a unit of money due at `time`, years from now."""
    return math.exp(-integral(rate, time))


def stock_value(market: Market, dividend_yield: Curve, expiry: float) -> float:
    """Return the present value of the underlying delivered at expiry: its forward, discounted.

    That is S e^{-qT} less the dividends before, each with the yield that it would have paid. A spot that falls below
    a dividend is not thought of.
    """
    due = [d for d in market.cash_dividends if 0.0 < d.time <= expiry]
    drops = [(d.time, 0, d.fraction) for d in market.proportional_dividends if 0.0 < d.time <= expiry]
    value, paid = market.spot, 0.0
    if market.dividend_model == "escrowed":
        value -= math.fsum(d.amount * discount(market.rate, d.time) for d in due)
    else:
        drops += [(d.time, 1, d.amount) for d in due]
    for time, kind, size in sorted(drops):  # on one date the proportional one comes first
        so_far = integral(dividend_yield, time)
        value *= math.exp(paid - so_far)
        value -= size * (discount(market.rate, time) if kind else value)
        paid = so_far
    return value * math.exp(paid - integral(dividend_yield, expiry))


def carry_of_expiry(chain: Chain, group: int, tolerance: float, threads: int | None) -> ExpiryCarry:
    """Iterate on the yield of one expiry, the `group`-th of the chain, from that of European parity."""
    market, expiry = chain.market, float(chain.expiries[group])
    discounted = discount(market.rate, expiry)
    pairs = chain.pairs.take(chain.pairs.group == group)
    middle = stock_value(market, 0.0, expiry) / discounted
    pairs = pairs.take(np.argsort(np.abs(pairs.strike - middle), kind="stable")[:PAIRS])
    parity = parity_stock(pairs, discounted)
    estimate = estimate_stock(market, pairs, parity, np.ones(parity.size, dtype=bool), expiry)
    if chain.exercise == "european" or estimate.status != "ok":
        return _inside(estimate)
    here, before, now = _clipped(estimate.dividend_yield), (math.nan, math.nan), max(COARSE, tolerance)
    for count in range(MOST_PASSES):
        premiums = early_premiums(market, pairs, here, now, threads)
        stock = parity - premiums.call_less_put
        fixed = estimate.used & premiums.identified
        if count < CHOOSING_PASSES or not fixed.any():
            estimate = estimate_stock(market, pairs, stock, premiums.identified, expiry)
        else:
            estimate = mean_stock(market, pairs, stock, fixed, expiry)
        if estimate.status != "ok":
            return estimate
        found = estimate.dividend_yield
        change = estimate.forward * discounted - stock_value(market, here, expiry)
        if now <= tolerance and abs(change) <= SETTLED * tolerance * market.spot:
            return _inside(estimate)
        at, now = now, max(min(COARSE_SHARE * abs(change) / market.spot, now), tolerance)
        slope = (found - before[1]) / (here - before[0])
        slope = 0.0 if math.isnan(slope) else min(max(slope, SMALLEST_SLOPE), LARGEST_SLOPE)
        there = _clipped(here + (found - here) / (1.0 - slope))
        if there != here:
            here, before = there, (here, found)
        elif at <= tolerance:
            break
    return ExpiryCarry(status="no_convergence")


def parity_stock(pairs: Pairs, discounted: float) -> Vector:
    """Return the discounted forward that put-call parity gives for each pair if call and put are European.

    Parameters
    ----------
    discounted : float
        What a unit of money at expiry is worth now.
    """
    return pairs.call - pairs.put + pairs.strike * discounted


def _inside(estimate: ExpiryCarry) -> ExpiryCarry:
    """Return the estimate if its yield is one that a market may have."""
    if estimate.status == "ok" and estimate.dividend_yield != _clipped(estimate.dividend_yield):
        return ExpiryCarry(status="no_convergence")
    return estimate


def _clipped(dividend_yield: float) -> float:
    return min(max(dividend_yield, DIVIDEND_YIELD.least), DIVIDEND_YIELD.most)


def early_premiums(
    market: Market,
    pairs: Pairs,
    dividend_yield: Curve | Vector | list[Curve],
    tolerance: float,
    threads: int | None,
) -> Premiums:
    """Return the early exercise premiums of calls less those of puts, at the mean of their implied volatilities.

    Parameters
    ----------
    dividend_yield : float, PiecewiseConstant, or Vector or list of length 2 m
        One for all, or that of every call and then of every put.
    """
    count = pairs.strike.size
    columns: dict[str, Any] = {
        "option_type": np.repeat(["call", "put"], count),
        "strike": np.tile(pairs.strike, 2),
        "expiry": np.tile(pairs.expiry, 2),
        "spot": market.spot,
        "rate": market.rate,
        "dividend_yield": dividend_yield,
        **{name: value for name in DIVIDENDS if (value := getattr(market, name)) not in ((), "spot")},
    }
    prices = np.concatenate([pairs.call, pairs.put])
    loose = min(VOLATILITY_TOLERANCES * tolerance, TOLERANCE.most)
    implied = implied_volatility_many(columns, prices, tolerance=loose, threads=threads)
    volatility = implied["volatility"].reshape(2, count).mean(axis=0)
    identified = np.isfinite(volatility)
    columns["volatility"] = np.tile(np.where(identified, volatility, np.nan), 2)
    table = price_columns(columns, PricingSettings(tolerance, "none"), threads)
    call, put = table["early_exercise_premium"].reshape(2, count)
    return Premiums(identified & np.isfinite(call) & np.isfinite(put), call - put)


def estimate_stock(
    market: Market, pairs: Pairs, stock: Vector, identified: BoolVector, expiry: float
) -> ExpiryCarry:
    """Return the estimate of the discounted forward from all pairs."""
    if not identified.any():
        return ExpiryCarry()
    median = _weighted_median(stock[identified], 1.0 / pairs.width[identified])
    distance = np.abs(stock - median)
    limit = np.maximum(NEAR * pairs.width, ROBUST * float(np.median(distance[identified])))
    return mean_stock(market, pairs, stock, identified & (distance <= limit), expiry)


def mean_stock(market: Market, pairs: Pairs, stock: Vector, used: BoolVector, expiry: float) -> ExpiryCarry:
    """Return the weighted mean of the discounted forwards of the pairs that take part."""
    weight = 1.0 / pairs.width[used] ** 2
    mean = float(np.average(stock[used], weights=weight))
    residual = math.sqrt(float(np.average((stock[used] - mean) ** 2, weights=weight)))
    found = yield_of_stock(market, mean, expiry)
    forward = mean / discount(market.rate, expiry)
    return ExpiryCarry(forward, found, residual, int(used.sum()), "ok", pairs, stock, used)


def _weighted_median(values: Vector, weights: Vector) -> float:
    order = np.argsort(values, kind="stable")
    shares = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(shares, 0.5 * shares[-1])]])


def yield_of_stock(market: Market, stock: float, expiry: float) -> float:
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
