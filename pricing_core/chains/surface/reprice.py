"""American quotes repriced: the European prices of a surface, and the premiums under its local volatility."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.early_exercise import Exercise, early_exercise
from pricing_core.chains.surface.implied_surface import ImpliedSurface
from pricing_core.chains.surface.smile_quotes import AmericanQuotes

NEAR = 4.5  # Farther out of the money, in standard deviations, an option has no premium; chosen.
# Least share of a European price's error that an American one has before it is exercised; measured.
LEAST_SHARE = 1.0 / 3.0


@dataclass(frozen=True, slots=True)
class Repriced:
    """The quotes that are two-sided, priced under the local volatility of a surface."""

    local_volatility: LocalVolatility
    premium: Vector
    exercised: BoolVector
    price: Vector

    def share_within(self, quotes: AmericanQuotes) -> float:
        """Return the share of prices within bid and ask."""
        inside = (self.price >= quotes.bid) & (self.price <= quotes.ask)
        return float(np.mean(inside))


def exercise_of(
    surface: ImpliedSurface,
    local_volatility: LocalVolatility,
    quotes: AmericanQuotes,
    interrupt: Callable[[], bool] | None,
) -> Exercise:
    """Return the early exercise of all quotes, 0 where it is certain to be worth nothing."""
    market = surface.coordinates.market
    premium, exercised = np.zeros(quotes.mid.size), np.zeros(quotes.mid.size, dtype=np.bool_)
    for expiry in np.unique(quotes.expiry).tolist():
        check_interrupt(interrupt)
        spread = math.sqrt(float(surface.variance.at(np.zeros(1), expiry)[0].value[0]))
        for option_type, sign in (("put", 1.0), ("call", -1.0)):
            ahead = sign * np.log(quotes.strike / market.spot) > -NEAR * spread
            rows = np.flatnonzero((quotes.expiry == expiry) & (quotes.option_type == option_type) & ahead)
            if rows.size == 0 or _never_exercised(market, option_type, expiry):
                continue
            found = early_exercise(
                local_volatility,
                market,
                surface.coordinates,
                option_type,
                quotes.strike[rows],
                expiry,
                spread,
            )
            premium[rows], exercised[rows] = found.premium, found.exercised
    return Exercise(premium, exercised)


def repriced_by(
    surface: ImpliedSurface,
    local_volatility: LocalVolatility,
    quotes: AmericanQuotes,
    exercise: Exercise,
) -> Repriced:
    """Price all quotes: the European price of the surface and the premium, the payoff where it is exercised."""
    price = np.empty(quotes.mid.size)
    for expiry, option_type, rows in _groups(quotes):
        price[rows] = surface.european_price(option_type, quotes.strike[rows], expiry)
    payoff = payoff_of(surface, quotes)
    price = np.where(exercise.exercised, payoff, np.maximum(price + exercise.premium, payoff))
    return Repriced(local_volatility, exercise.premium, exercise.exercised, price)


def price_errors(surface: ImpliedSurface, quotes: AmericanQuotes, repriced: Repriced) -> Vector:
    """Return the standard errors of the prices, see `correct`."""
    error = np.empty(quotes.mid.size)
    for expiry, option_type, rows in _groups(quotes):
        error[rows] = surface.price_error(option_type, quotes.strike[rows], expiry)
    beyond = np.maximum(repriced.price - payoff_of(surface, quotes), 0.0)
    held = np.maximum(beyond / np.maximum(beyond + repriced.premium, np.finfo(float).tiny), LEAST_SHARE)
    return np.where(repriced.exercised, 0.0, error * held)


def _groups(quotes: AmericanQuotes) -> Iterator[tuple[float, str, NDArray[np.intp]]]:
    """Yield expiry, option type and rows of the quotes that share these."""
    for expiry in np.unique(quotes.expiry).tolist():
        for option_type in ("put", "call"):
            rows = np.flatnonzero((quotes.expiry == expiry) & (quotes.option_type == option_type))
            yield expiry, option_type, rows


def payoff_of(surface: ImpliedSurface, quotes: AmericanQuotes) -> Vector:
    """Return what exercise now brings, 0 or more."""
    spot = surface.coordinates.market.spot
    return np.maximum(np.where(quotes.is_call, spot - quotes.strike, quotes.strike - spot), 0.0)


def _never_exercised(market: Market, option_type: str, expiry: float) -> bool:
    """Whether early exercise is worth nothing: of a call without dividends and yield."""
    if option_type == "put":
        return False
    paid = [each.time for each in market.cash_dividends] + [
        each.time for each in market.proportional_dividends
    ]
    if any(0.0 < time <= expiry for time in paid):
        return False
    lowest_rate = min(_values(market.rate))
    return all(most <= min(0.0, lowest_rate) for most in _values(market.dividend_yield)) and (
        market.borrow_rate == 0.0 and market.underlying == "spot" and market.foreign_rate is None
    )


def _values(curve: Curve) -> tuple[float, ...]:
    return curve.values if isinstance(curve, PiecewiseConstant) else (curve,)
