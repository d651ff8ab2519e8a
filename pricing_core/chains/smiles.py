"""The volatilities of a chain as the smiles that a surface is fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.chains.carry import Carry
from pricing_core.chains.quotes import Quotes
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.chains.volatilities import StrikeVolatilities

SHORTEST = 1.0 / 365.0  # years: a surface is fitted to expiries with so much left; measured.
CORE_REACH = (
    2.5  # Standard deviations of the spot around the forward within which quotes tell the premiums; chosen.
)
CORE_SIZE = 13  # Number of volatilities of an expiry that are enough for that; chosen.


def smiles_of(strikes: StrikeVolatilities, carry: Carry) -> list[SmileQuotes]:
    """Return the smile of every expiry that has a volatility."""
    smiles = []
    for place, expiry in enumerate(carry.expiry.tolist()):
        rows = strikes.expiry == expiry
        if rows.any():
            strike, forward = strikes.strike[rows], float(carry.forward[place])
            smiles.append(
                SmileQuotes(
                    expiry,
                    forward,
                    np.log(strike / forward),
                    strike,
                    strikes.volatility[rows],
                    strikes.deviation[rows],
                )
            )
    return smiles


def lasting(smiles: Sequence[SmileQuotes]) -> list[SmileQuotes]:
    """Return the smiles of expiries with a day or more left; all of them where there is none.

    Hours before an expiry its smile is that of a single jump, and ties those of the next weeks to it.
    """
    found = [smile for smile in smiles if smile.expiry >= SHORTEST]
    return found or list(smiles)


def core_of(smile: SmileQuotes) -> SmileQuotes:
    """Return a dozen volatilities around the forward: enough for the premiums of options at the money."""
    reach = CORE_REACH * float(np.median(smile.volatility)) * math.sqrt(smile.expiry)
    inside = np.flatnonzero(np.abs(smile.log_moneyness) <= reach)
    if inside.size < CORE_SIZE:
        nearest = np.argsort(np.abs(smile.log_moneyness), kind="stable")[:CORE_SIZE]
        rows = np.sort(nearest)
    else:
        rows = inside[np.unique(np.linspace(0, inside.size - 1, CORE_SIZE).round().astype(np.intp))]
    columns = (smile.log_moneyness, smile.strike, smile.volatility, smile.deviation)
    return SmileQuotes(smile.expiry, smile.forward, *(column[rows] for column in columns))


def american_quotes(quotes: Quotes, usable: BoolVector) -> AmericanQuotes:
    """Return all rows of a chain as quotes to reprice; bid and ask are missing where a row takes no part."""
    bid, ask = np.where(usable, quotes.bid, np.nan), np.where(usable, quotes.ask, np.nan)
    return AmericanQuotes(
        quotes.option_type.astype(np.str_), quotes.strike, quotes.expiry, bid, ask, 0.5 * (bid + ask)
    )
