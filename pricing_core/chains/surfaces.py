"""The surface and the local volatility of the smiles of a chain, where they can be fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.correct import Carried, correct
from pricing_core.chains.surface.dupire import dupire
from pricing_core.chains.surface.early_exercise import Exercise
from pricing_core.chains.surface.fit import fit_surface
from pricing_core.chains.surface.implied_surface import ImpliedSurface
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.errors import InvalidInputError, NumericalError


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """What could be fitted to the smiles, see `ChainFit`; `message` says why something is missing."""

    model_price: Vector
    surface: ImpliedSurface | None = None
    local_volatility: LocalVolatility | None = None
    share_within_before: float = float("nan")
    share_within_after: float = float("nan")
    message: str = ""
    price_error: Vector | None = None


def fit_surfaces(
    smiles: Sequence[SmileQuotes],
    market: Market,
    quotes: AmericanQuotes,
    exercise: str,
    carry: Callable[[Exercise], Carried],
    interrupt: Callable[[], bool] | None,
) -> Fitted:
    """Fit a surface to the smiles, and a local volatility under which the prices meet the quotes.

    What cannot be fitted is None, with the reason; European quotes need no correction.

    Raises
    ------
    NumericalError
        The interrupt came.
    """
    count = quotes.strike.size
    check_interrupt(interrupt)
    try:
        surface = fit_surface(smiles, market, interrupt=interrupt)
    except (InvalidInputError, NumericalError) as fault:
        check_interrupt(interrupt)
        return without_surface(count, f"surface: {fault}")
    check_interrupt(interrupt)
    try:
        if exercise == "european":
            return _european(market, quotes, surface)
        found = correct(surface, market, quotes, carry=carry, interrupt=interrupt)
    except (InvalidInputError, NumericalError) as fault:
        check_interrupt(interrupt)
        message = f"local volatility: {fault}"
        return replace(without_surface(count, message), surface=surface)
    return Fitted(
        found.model_price,
        found.surface,
        found.local_volatility,
        found.share_within_before,
        found.share_within_after,
        price_error=found.price_error,
    )


def without_surface(count: int, message: str) -> Fitted:
    """Return that nothing was fitted to so many quotes, and why."""
    return Fitted(np.full(count, np.nan), message=message)


def _european(market: Market, quotes: AmericanQuotes, surface: ImpliedSurface) -> Fitted:
    price, error = (np.full(quotes.strike.size, np.nan) for _ in range(2))
    for expiry in np.unique(quotes.expiry[quotes.usable]).tolist():
        for side in ("call", "put"):
            rows = quotes.usable & (quotes.expiry == expiry) & (quotes.option_type == side)
            price[rows] = surface.european_price(side, quotes.strike[rows], expiry)
            error[rows] = surface.price_error(side, quotes.strike[rows], expiry)
    inside = (price >= quotes.bid) & (price <= quotes.ask)
    share = float(inside[quotes.usable].mean())
    return Fitted(price, surface, dupire(surface, market), share, share, price_error=error)
