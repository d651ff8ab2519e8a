"""The early exercise premiums of the pairs that tell the carry, under the local volatility of a surface."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.carry_pairs import Pairs
from pricing_core.american.implied.implied_carry import Premiums
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.dupire import dupire
from pricing_core.chains.surface.early_exercise import early_exercise
from pricing_core.chains.surface.implied_surface import ImpliedSurface


def smile_premiums(
    pairs: Pairs, surface: ImpliedSurface, market: Market, interrupt: Callable[[], bool] | None = None
) -> Premiums:
    """Return the premiums of calls less those of puts; of an expiry that the surface passes over none is identified.

    Raises
    ------
    NumericalError
        The interrupt came.
    """
    local_volatility = dupire(surface, market)
    premium = np.full(pairs.strike.size, np.nan)
    fitted = set(surface.expiries.tolist())
    for expiry in sorted(fitted.intersection(pairs.expiry.tolist())):
        check_interrupt(interrupt)
        rows = np.flatnonzero(pairs.expiry == expiry)
        spread = math.sqrt(float(surface.variance.at(np.zeros(1), expiry)[0].value[0]))
        found = [
            early_exercise(
                local_volatility, market, surface.coordinates, side, pairs.strike[rows], expiry, spread
            )
            for side in ("call", "put")
        ]
        held = ~found[0].exercised & ~found[1].exercised
        premium[rows] = np.where(held, found[0].premium - found[1].premium, np.nan)
    return Premiums(np.isfinite(premium), premium)
