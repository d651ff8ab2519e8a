"""Correct a surface until the American quotes reprice under its local volatility.

Volatilities taken from American quotes one by one assume that each option's early exercise is worth what it is under a
flat volatility. Under a smile it is worth something else. Given a local volatility, the early exercise premium of every
quote is known (`early_exercise`); the mid less that premium is a European price, whose surface has a local volatility
of its own: a fixed point, which two or three rounds reach, for the premium hardly depends on the change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.dupire import dupire
from pricing_core.chains.surface.early_exercise import Exercise, early_exercise
from pricing_core.chains.surface.fit import fit_surface
from pricing_core.chains.surface.forward_greeks import forward_greeks
from pricing_core.chains.surface.implied_surface import ImpliedSurface
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.chains.surface.smoothing import Scales
from pricing_core.errors import InvalidInputError, Told

# Largest early exercise premium, as a share of what an option is worth beyond its payoff, of a quote that tells a
# volatility: above it the premium takes back most of what the European price gains; chosen.
LARGEST_PREMIUM = 0.4
LEAST_SHARE = (
    1.0 / 3.0
)  # Least share of a European price's error that an American one has before it is exercised; measured.
NEAR = 4.5  # Farther out of the money, in standard deviations, an option has no premium; chosen.
LEAST_VEGA = 1e-6  # Smallest vega, in spots, of a quote that tells a volatility; chosen.
# Changes of a model price, in spots and in the noise of its quote, the larger of which stops the rounds; chosen.
SETTLED, SETTLED_IN_NOISE = 5e-6, 0.5


class Carried(NamedTuple):
    """A market with the carry of a chain, and the standard errors of ln(forward) by expiry, years."""

    market: Market
    forward_error: Mapping[float, float]


@dataclass(frozen=True, slots=True)
class Correction:
    """A corrected surface, its local volatility, and how the American quotes reprice.

    Parameters
    ----------
    surface : ImpliedSurface
    local_volatility : LocalVolatility
    model_price, price_error, early_exercise_premium : Vector, shape (n,)
        Money, of each quote under the local volatility; NaN for a quote that is not two-sided. price_error is the
        standard error of model_price.
    exercised : BoolVector, shape (n,)
        Whether exercise is optimal now.
    informative : BoolVector, shape (n,)
        Which quotes the corrected surface was fitted to.
    share_within_before, share_within_after : float
        Share of the two-sided quotes whose model price lies within bid and ask, under the local volatility of the
        surface that was given, and after the last round.
    largest_changes : tuple of float
        Largest change of a model price in each round, money.
    """

    surface: ImpliedSurface
    local_volatility: LocalVolatility
    model_price: Vector
    price_error: Vector
    early_exercise_premium: Vector
    exercised: BoolVector
    informative: BoolVector
    share_within_before: float
    share_within_after: float
    largest_changes: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _Repriced:
    """The quotes that are two-sided, priced under the local volatility of a surface."""

    local_volatility: LocalVolatility
    premium: Vector
    exercised: BoolVector
    price: Vector

    def share_within(self, quotes: AmericanQuotes) -> float:
        """Return the share of prices within bid and ask."""
        inside = (self.price >= quotes.bid) & (self.price <= quotes.ask)
        return float(np.mean(inside))


def correct(
    surface: ImpliedSurface,
    market: Market,
    american_quotes: AmericanQuotes,
    *,
    rounds: int = 3,
    carry: Callable[[Exercise], Carried] | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Correction:
    """Return the surface whose local volatility reprices American quotes.

    The standard errors of prices are those of European ones, less the share of what options are worth beyond their
    payoff that is their premium: early exercise takes back what they gain. Of those that are exercised they are 0.

    Parameters
    ----------
    surface : ImpliedSurface
        Fitted to the volatilities of the quotes taken one by one.
    market : Market
        That of the fit.
    american_quotes : AmericanQuotes
        Of the expiries of the surface, or others.
    rounds : int
        Largest number of rounds.
    carry : callable, optional
        Takes the early exercise of all quotes (premiums NaN where a quote is not two-sided), and returns the market
        with the yield at which call and put then agree; without it the yield stays what it is, and certain.
    interrupt : callable, optional
        Asked between expiries and rounds; True ends the work.

    Raises
    ------
    InvalidInputError
        No quote is two-sided.
    NumericalError
        The interrupt came.
    """
    usable = np.flatnonzero(american_quotes.usable)
    if usable.size == 0:
        raise InvalidInputError(
            "american_quotes", Told(f"{american_quotes.mid.size} quotes"), "some with bid < ask"
        )
    quotes = american_quotes.take(usable)
    local_volatility = dupire(surface, market)
    exercise = _exercise(surface, local_volatility, quotes, interrupt)
    first = repriced = _repriced(surface, local_volatility, quotes, exercise)
    informative = np.zeros(usable.size, dtype=np.bool_)
    changes: list[float] = []
    certain: Mapping[float, float] = {}
    carried = Carried(market, certain)
    scales: Scales | None = None
    for _ in range(rounds):
        if carry is not None:
            held = _spread_out(american_quotes, usable, exercise.exercised.astype(np.float64)) == 1.0
            premium = _spread_out(american_quotes, usable, repriced.premium)
            carried = carry(Exercise(premium, held))
            market = carried.market
            surface = replace(surface, coordinates=replace(surface.coordinates, market=market))
            repriced = _repriced(surface, local_volatility, quotes, exercise)
        smiles, informative = _smiles(surface, quotes, repriced, carried.forward_error)
        if not smiles:
            break
        check_interrupt(interrupt)
        surface = fit_surface(smiles, market, scales=scales, interrupt=interrupt)
        scales = surface.scales
        local_volatility = dupire(surface, market)
        exercise = _exercise(surface, local_volatility, quotes, interrupt)
        before, repriced = repriced, _repriced(surface, local_volatility, quotes, exercise)
        change = np.abs(repriced.price - before.price)
        changes.append(float(np.max(change)))
        noise = 0.5 * surface.scales.noise * (quotes.ask - quotes.bid)
        if np.all(change < np.maximum(SETTLED * market.spot, SETTLED_IN_NOISE * noise)):
            break
    return Correction(
        surface,
        repriced.local_volatility,
        _spread_out(american_quotes, usable, repriced.price),
        _spread_out(american_quotes, usable, _price_errors(surface, quotes, repriced)),
        _spread_out(american_quotes, usable, repriced.premium),
        _spread_out(american_quotes, usable, repriced.exercised.astype(np.float64)) == 1.0,
        _spread_out(american_quotes, usable, informative.astype(np.float64)) == 1.0,
        first.share_within(quotes),
        repriced.share_within(quotes),
        tuple(changes),
    )


def _exercise(
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


def _repriced(
    surface: ImpliedSurface,
    local_volatility: LocalVolatility,
    quotes: AmericanQuotes,
    exercise: Exercise,
) -> _Repriced:
    """Price all quotes: the European price of the surface and the premium, the payoff where it is exercised."""
    price = np.empty(quotes.mid.size)
    for expiry, option_type, rows in _groups(quotes):
        price[rows] = surface.european_price(option_type, quotes.strike[rows], expiry)
    payoff = _payoff(surface, quotes)
    price = np.where(exercise.exercised, payoff, np.maximum(price + exercise.premium, payoff))
    return _Repriced(local_volatility, exercise.premium, exercise.exercised, price)


def _price_errors(surface: ImpliedSurface, quotes: AmericanQuotes, repriced: _Repriced) -> Vector:
    """Return the standard errors of the prices, see `correct`."""
    error = np.empty(quotes.mid.size)
    for expiry, option_type, rows in _groups(quotes):
        error[rows] = surface.price_error(option_type, quotes.strike[rows], expiry)
    beyond = np.maximum(repriced.price - _payoff(surface, quotes), 0.0)
    held = np.maximum(beyond / np.maximum(beyond + repriced.premium, np.finfo(float).tiny), LEAST_SHARE)
    return np.where(repriced.exercised, 0.0, error * held)


def _groups(quotes: AmericanQuotes) -> Iterator[tuple[float, str, NDArray[np.intp]]]:
    """Yield expiry, option type and rows of the quotes that share these."""
    for expiry in np.unique(quotes.expiry).tolist():
        for option_type in ("put", "call"):
            rows = np.flatnonzero((quotes.expiry == expiry) & (quotes.option_type == option_type))
            yield expiry, option_type, rows


def _payoff(surface: ImpliedSurface, quotes: AmericanQuotes) -> Vector:
    """Return what exercise now brings, 0 or more."""
    spot = surface.coordinates.market.spot
    return np.maximum(np.where(quotes.is_call, spot - quotes.strike, quotes.strike - spot), 0.0)


def _smiles(
    surface: ImpliedSurface,
    quotes: AmericanQuotes,
    repriced: _Repriced,
    forward_error: Mapping[float, float],
) -> tuple[list[SmileQuotes], BoolVector]:
    """Return the volatilities that the mids mean, the premiums as they are, and which quotes they come from.

    To first order about the surface, so that the noise of a quote stays as it is whatever its sign.
    """
    spot = surface.coordinates.market.spot
    beyond = np.maximum(repriced.price - _payoff(surface, quotes), 1e-12 * spot)
    informative = ~repriced.exercised & (repriced.premium < LARGEST_PREMIUM * beyond) & (quotes.bid > 0.0)
    found = []
    for expiry in np.unique(quotes.expiry).tolist():
        rows = np.flatnonzero(informative & (quotes.expiry == expiry))
        rows = rows[np.argsort(quotes.strike[rows], kind="stable")]
        forward, strike = surface.coordinates.forward(expiry), quotes.strike[rows]
        volatility, k = surface.volatility(strike, expiry), np.log(strike / forward)
        discount = surface.coordinates.discount(expiry)
        gained, delta = forward_greeks("call", forward, strike, volatility, expiry)
        vega, delta = discount * gained, discount * np.where(quotes.is_call[rows], delta, delta - 1.0)
        told = vega > LEAST_VEGA * spot
        informative[rows[~told]] = False
        if told.any():
            changed = volatility + (quotes.mid - repriced.price)[rows] / vega
            deviation = 0.5 * (quotes.ask - quotes.bid)[rows] / vega
            found.append(
                SmileQuotes(
                    expiry,
                    forward,
                    k[told],
                    strike[told],
                    changed[told],
                    deviation[told],
                    forward_error.get(expiry, 0.0),
                    -forward * (delta / vega)[told],
                )
            )
    return found, informative


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


def _spread_out(quotes: AmericanQuotes, rows: np.ndarray, values: Vector) -> Vector:
    """Return values of some quotes as a column of all, NaN elsewhere."""
    found = np.full(quotes.mid.size, np.nan)
    found[rows] = values
    return found
