"""The carry of a chain, found again whenever the early exercise premiums of its quotes are known better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.carry_pairs import Chain
from pricing_core.american.implied.implied_carry import Premiums
from pricing_core.chains.carry import Carry
from pricing_core.chains.fit_carry import refit_carry
from pricing_core.chains.surface.correct import Carried
from pricing_core.chains.surface.early_exercise import Exercise
from pricing_core.chains.surface.smile_quotes import AmericanQuotes


class Agreement:
    """The latest carry at which call and put agree, as the correction of a surface asks for it.

    Parameters
    ----------
    chain : Chain
    carry : Carry
        With premiums at one volatility for all spots; `carry` then is that of the last premiums.
    market : Market
        Whose yield is what is looked for.
    quotes : AmericanQuotes
        Among which are those of the pairs.
    """

    def __init__(self, chain: Chain, carry: Carry, market: Market, quotes: AmericanQuotes) -> None:
        self.carry, self.quotes = carry, quotes
        self._chain, self._market = chain, market
        self._rows = {
            side: _rows_of(carry, quotes, quotes.is_call == (side == "call")) for side in ("call", "put")
        }

    def __call__(self, exercise: Exercise) -> Carried:
        """Return the market with the yield at which call and put agree if early exercise is worth this."""
        premium = np.append(np.where(exercise.exercised, np.nan, exercise.premium), np.nan)
        difference = premium[self._rows["call"]] - premium[self._rows["put"]]
        premiums = Premiums(np.isfinite(difference), difference)
        self.carry = refit_carry(self._chain, self.carry, premiums)
        errors = np.nan_to_num(self.carry.standard_error) * self.carry.expiry
        return Carried(
            replace(self._market, dividend_yield=self.carry.curve),
            dict(zip(self.carry.expiry.tolist(), errors.tolist(), strict=True)),
        )


def _rows_of(carry: Carry, quotes: AmericanQuotes, side: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the row of one side of every pair, -1 where there is none."""
    assert carry.pairs is not None
    rows = np.flatnonzero(quotes.usable & side)
    quoted = zip(quotes.expiry[rows].tolist(), quotes.strike[rows].tolist(), strict=True)
    found = dict(zip(quoted, rows.tolist(), strict=True))
    keys = zip(carry.pairs.expiry.tolist(), carry.pairs.strike.tolist(), strict=True)
    return np.array([found.get(key, -1) for key in keys], dtype=np.intp)
