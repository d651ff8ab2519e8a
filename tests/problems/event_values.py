"""Options with dividends and exercise dates: a table, and quadrature that knows no grid in time or space."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import norm

from pricing_core.american import Market, Option
from tests.problems.true_values import rows_of

Array = NDArray[np.float64]
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(48)
WIDEST = 9.0  # standard deviations
SEARCHED = 400  # spots among which a change of sign is looked for


@dataclass(frozen=True)
class EventValue:
    name: str
    option: Option
    market: Market
    price: float
    european_price: float | None
    ex_time: float | None
    boundary: float | None  # cum dividend, at the ex-time
    reference_error: float  # money


def event_values() -> list[EventValue]:
    """Return tests/data/american_events.csv."""
    values = []
    for r in rows_of("american_events.csv"):
        rate, dividend_yield, volatility = (float(r[c]) for c in ("rate", "dividend_yield", "volatility"))
        ex_time = float(r["dividend_time"]) if r["dividend_time"] else None
        dividends = [] if ex_time is None else [{"time": ex_time, "amount": float(r["dividend_amount"])}]
        values.append(
            EventValue(
                f"{r['set']}-{r['dividend_model']}",
                Option(r["option_type"], float(r["strike"]), float(r["expiry"])),
                Market(
                    float(r["spot"]),
                    rate,
                    volatility,
                    dividend_yield,
                    cash_dividends=dividends,
                    dividend_model=r["dividend_model"],
                ),
                float(r["price"]),
                float(r["european_price"]) if r["european_price"] else None,
                ex_time,
                float(r["boundary"]) if r["boundary"] else None,
                float(r["reference_error"]),
            )
        )
    return values


@dataclass(frozen=True)
class Event:
    """At `time` the spot drops by `amount`, after the holder may, or may not, have exercised on spot + escrow."""

    time: float
    amount: float = 0.0
    exercise: bool = False
    escrow: float = 0.0


def quadrature_value(
    is_put: bool,
    strike: float,
    spot: float,
    expiry: float,
    rate: float,
    dividend_yield: float,
    volatility: float,
    events: list[Event],
) -> float:
    """Return an option exercisable at the events and at expiry by nested Gauss-Legendre quadrature.

    From one event to the next the spot is lognormal: the value is an integral, split at its kinks (where exercise
    begins to pay, and where the dividend takes the spot to zero). Exact to about 1e-10 of the strike; the cost grows a
    hundredfold with every event.
    """
    sign = 1.0 if is_put else -1.0

    def last(s: Array) -> Array:
        return _black_scholes(sign, s, strike, expiry - events[-1].time, rate, dividend_yield, volatility)

    after: Callable[[Array], Array] = last
    at_zero = strike * math.exp(-rate * (expiry - events[-1].time)) if is_put else 0.0
    for k in reversed(range(len(events))):
        event = events[k]
        before, kinks = _before(after, at_zero, event, sign, strike, spot)
        if event.exercise:
            at_zero = max(at_zero, sign * (strike - event.escrow))
        start = events[k - 1].time if k else 0.0
        after = _expected(before, kinks, event.time - start, rate, dividend_yield, volatility)
        at_zero *= math.exp(-rate * (event.time - start))

    return float(after(np.array([spot]))[0])


def _before(
    after: Callable[[Array], Array], at_zero: float, event: Event, sign: float, strike: float, spot: float
) -> tuple[Callable[[Array], Array], list[float]]:
    def held(s: Array) -> Array:
        alive = s > event.amount
        return np.where(alive, after(np.where(alive, s - event.amount, 1.0)), at_zero)

    def gain(s: Array) -> Array:
        return sign * (strike - event.escrow - s) - held(s)

    kinks = [event.amount] if event.amount > 0.0 else []
    if not event.exercise:
        return held, kinks
    searched = np.geomspace(0.02 * min(spot, strike), 50.0 * max(spot, strike), SEARCHED)
    signs = gain(searched) > 1e-12 * strike
    for i in np.flatnonzero(signs[1:] != signs[:-1]):
        ends = searched[i], searched[i + 1]
        kinks.append(float(brentq(lambda s: float(gain(np.array([s]))[0]), *ends, xtol=1e-13 * strike)))
    return lambda s: np.maximum(held(s), sign * (strike - event.escrow - s)), sorted(kinks)


def _expected(
    function: Callable[[Array], Array],
    kinks: list[float],
    duration: float,
    rate: float,
    dividend_yield: float,
    volatility: float,
) -> Callable[[Array], Array]:
    spread = volatility * math.sqrt(duration)
    drift = (rate - dividend_yield - 0.5 * volatility**2) * duration

    def value(s: Array) -> Array:
        places = [(np.log(kink / s) - drift) / spread for kink in kinks]
        cuts = [np.full(s.size, -WIDEST), *[np.clip(z, -WIDEST, WIDEST) for z in places], np.zeros(s.size)]
        cuts = list(np.sort(np.stack([*cuts, np.full(s.size, WIDEST)]), axis=0))
        total = np.zeros(s.size)
        for a, b in pairwise(cuts):
            z = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * POINTS
            values = function((s[:, None] * np.exp(drift + spread * z)).ravel()).reshape(z.shape)
            total += 0.5 * (b - a) * (values * norm.pdf(z) * WEIGHTS).sum(axis=1)
        result: Array = math.exp(-rate * duration) * total
        return result

    return value


def _black_scholes(
    sign: float,
    s: Array,
    strike: float,
    duration: float,
    rate: float,
    dividend_yield: float,
    volatility: float,
) -> Array:
    spread = volatility * math.sqrt(duration)
    d = (np.log(s / strike) + (rate - dividend_yield + 0.5 * volatility**2) * duration) / spread
    bond, stock = strike * math.exp(-rate * duration), s * math.exp(-dividend_yield * duration)
    result: Array = sign * (bond * norm.cdf(sign * (spread - d)) - stock * norm.cdf(-sign * d))
    return result
