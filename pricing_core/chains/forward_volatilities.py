"""The volatilities of a chain as those of the forward, where the spot drops by cash dividends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pricing_core.american.implied.black_spread import black_spread
from pricing_core.arrays import Vector
from pricing_core.chains.quotes import Quotes
from pricing_core.chains.volatilities import QuoteVolatilities

# Smallest and largest ratio of both volatilities of a quote that is believed: beyond, its European price shows no time
# value that is more than rounding; chosen.
LEAST_RATIO, LARGEST_RATIO = 0.5, 2.0


def of_forward(
    quotes: Quotes, found: QuoteVolatilities, forward: Vector, discount: Vector
) -> QuoteVolatilities:
    """Return the volatilities at which Black's formula gives the European prices; those of bid and ask in proportion.

    Between its dividends the spot is lognormal, the forward is not: at an expiry behind several dividends the forward's
    volatility is larger than the spot's, and falls with the strike. A surface is one of the forward.

    Parameters
    ----------
    forward, discount : Vector, shape (n,)
        The forward of each row's expiry, money, and the present value of a unit of money then.

    Returns
    -------
    QuoteVolatilities
        NaN where a price shows no time value.
    """
    sign = np.where(quotes.is_call, 1.0, -1.0)
    with np.errstate(all="ignore"):
        exercised = discount * np.maximum(sign * (forward - quotes.strike), 0.0)
        time_value = (found.european_price - exercised) / (discount * np.minimum(forward, quotes.strike))
        spread = black_spread(np.abs(np.log(forward / quotes.strike)), time_value)
        ratio = spread / np.sqrt(quotes.expiry) / found.mid
        ratio = np.where((ratio >= LEAST_RATIO) & (ratio <= LARGEST_RATIO), ratio, np.nan)
    return replace(found, bid=ratio * found.bid, mid=ratio * found.mid, ask=ratio * found.ask)
