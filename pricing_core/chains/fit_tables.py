"""The parts of a fit as tables, to be written or sent."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from pricing_core.chains.chain_fit import ChainFit, numbers
from pricing_core.chains.surface.dupire import local_volatility_error
from pricing_core.chains.surface.implied_surface import ImpliedSurface

PARAMETERS = ("a", "b", "rho", "m", "sigma")


def tables_of(fit: ChainFit) -> dict[str, pa.Table]:
    """Return quotes, carry, pairs and dividends by name; surface and local_volatility where there are any."""
    tables = {"quotes": fit.quotes, "carry": fit.carry, "pairs": fit.pairs, "dividends": fit.dividends}
    if fit.surface is not None:
        tables["surface"] = surface_table(fit.surface)
    if fit.local_volatility is not None:
        tables["local_volatility"] = local_volatility_table(fit)
    return tables


def surface_table(surface: ImpliedSurface) -> pa.Table:
    """Return a row per expiry: how it was fitted, SVI of its own, eSSVI across, and what is proved of it.

    The parameters are in the surface's coordinate, which is ln(strike/forward) where no cash dividend is due later.
    """
    proved = {
        expiry: (butterfly, calendar)
        for expiry, butterfly, calendar in zip(
            surface.expiries.tolist(), surface.proof.butterfly, surface.proof.calendar, strict=True
        )
    }
    rows = []
    for fit in surface.statuses:
        row = {
            name: getattr(fit, name)
            for name in ("expiry", "status", "message", "quotes_used", "forward", "rms")
        }
        row |= {f"svi_{name}": None if fit.svi is None else getattr(fit.svi, name) for name in PARAMETERS}
        row |= {
            f"essvi_{name}": None if fit.essvi is None else getattr(fit.essvi, name)
            for name in ("theta", "psi", "rho")
        }
        row["butterfly_free"], row["calendar_free"] = proved.get(fit.expiry, (None, None))
        rows.append({name: None if value != value else value for name, value in row.items()})  # noqa: PLR0124
    return pa.Table.from_pylist(rows)


def local_volatility_table(fit: ChainFit) -> pa.Table:
    """Return a row per node: time (years), spot (money), volatility and its standard error."""
    local, surface = fit.local_volatility, fit.surface
    assert local is not None
    assert surface is not None
    times, spots = np.asarray(local.times), np.asarray(local.spots)
    errors = [local_volatility_error(surface, fit.market, spots, time) for time in times.tolist()]
    return pa.table(
        {
            "time": numbers(np.repeat(times, spots.size)),
            "spot": numbers(np.tile(spots, times.size)),
            "volatility": numbers(np.ravel(local.values)),
            "standard_error": numbers(np.concatenate(errors)),
        }
    )
