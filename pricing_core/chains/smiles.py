"""The volatilities of a chain as the smiles that a surface is fitted to."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.chains.carry import Carry
from pricing_core.chains.quotes import Quotes
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.chains.volatilities import StrikeVolatilities


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


def american_quotes(quotes: Quotes, usable: BoolVector) -> AmericanQuotes:
    """Return all rows of a chain as quotes to reprice; bid and ask are missing where a row takes no part."""
    bid, ask = np.where(usable, quotes.bid, np.nan), np.where(usable, quotes.ask, np.nan)
    return AmericanQuotes(
        quotes.option_type.astype(np.str_), quotes.strike, quotes.expiry, bid, ask, 0.5 * (bid + ask)
    )
