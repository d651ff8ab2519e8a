"""Chains of quotes: from what vendors ship to carry, volatilities, a surface and a local volatility."""

from __future__ import annotations

from pricing_core.extras import needs_extra

with needs_extra("batch"):
    from pricing_core.chains.chain_fit import ChainFit
    from pricing_core.chains.cleaning import FLAGS
    from pricing_core.chains.fit_chain import fit_chain
    from pricing_core.chains.read_chain import read_chain
    from pricing_core.chains.vendor_map import vendor_maps

__all__ = ["FLAGS", "ChainFit", "fit_chain", "read_chain", "vendor_maps"]
