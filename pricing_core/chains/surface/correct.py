"""Correct a surface until the American quotes reprice under its local volatility.

Volatilities taken from American quotes one by one assume that each option's early exercise is worth what it is under a
flat volatility. Under a smile it is worth something else. Given a local volatility, the early exercise premium of every
quote is known (`early_exercise`); the mid less that premium is a European price, whose surface has a local volatility
of its own: a fixed point, which two or three rounds reach, for the premium hardly depends on the change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.dupire import dupire
from pricing_core.chains.surface.early_exercise import Exercise
from pricing_core.chains.surface.fit import fit_surface
from pricing_core.chains.surface.forward_greeks import forward_greeks
from pricing_core.chains.surface.implied_surface import ImpliedSurface
from pricing_core.chains.surface.reprice import (
    Repriced,
    exercise_of,
    payoff_of,
    price_errors,
    repriced_by,
)
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.chains.surface.smoothing import Scales
from pricing_core.errors import InvalidInputError, Told

# Largest early exercise premium, as a share of what an option is worth beyond its payoff, of a quote that tells a
# volatility: above it the premium takes back most of what the European price gains; chosen.
LARGEST_PREMIUM = 0.4
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
        The market of the fit.
    american_quotes : AmericanQuotes
        American quotes of the expiries of the surface, or of others.
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
    exercise = exercise_of(surface, local_volatility, quotes, interrupt)
    first = repriced = repriced_by(surface, local_volatility, quotes, exercise)
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
            repriced = repriced_by(surface, local_volatility, quotes, exercise)
        smiles, informative = _smiles(surface, quotes, repriced, carried.forward_error)
        if not smiles:
            break
        check_interrupt(interrupt)
        surface = fit_surface(smiles, market, scales=scales, interrupt=interrupt)
        scales = surface.scales
        local_volatility = dupire(surface, market)
        exercise = exercise_of(surface, local_volatility, quotes, interrupt)
        before, repriced = repriced, repriced_by(surface, local_volatility, quotes, exercise)
        change = np.abs(repriced.price - before.price)
        changes.append(float(np.max(change)))
        noise = 0.5 * surface.scales.noise * (quotes.ask - quotes.bid)
        if np.all(change < np.maximum(SETTLED * market.spot, SETTLED_IN_NOISE * noise)):
            break
    return Correction(
        surface,
        repriced.local_volatility,
        _spread_out(american_quotes, usable, repriced.price),
        _spread_out(american_quotes, usable, price_errors(surface, quotes, repriced)),
        _spread_out(american_quotes, usable, repriced.premium),
        _spread_out(american_quotes, usable, repriced.exercised.astype(np.float64)) == 1.0,
        _spread_out(american_quotes, usable, informative.astype(np.float64)) == 1.0,
        first.share_within(quotes),
        repriced.share_within(quotes),
        tuple(changes),
    )


def _smiles(
    surface: ImpliedSurface,
    quotes: AmericanQuotes,
    repriced: Repriced,
    forward_error: Mapping[float, float],
) -> tuple[list[SmileQuotes], BoolVector]:
    """Return the volatilities that the mids mean, the premiums as they are, and which quotes they come from.

    To first order about the surface, so that the noise of a quote stays as it is whatever its sign.
    """
    spot = surface.coordinates.market.spot
    beyond = np.maximum(repriced.price - payoff_of(surface, quotes), 1e-12 * spot)
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


def _spread_out(quotes: AmericanQuotes, rows: np.ndarray, values: Vector) -> Vector:
    """Return values of some quotes as a column of all, NaN elsewhere."""
    found = np.full(quotes.mid.size, np.nan)
    found[rows] = values
    return found
