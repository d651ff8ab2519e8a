"""American contracts without events and with one exercise boundary: the compiled march of the early exercise premium.

The early exercise premium solves the option's complementarity system without the kink at the strike, in a frame that
moves with the exercise boundary; docs/premium_march.md tells how.
"""

from __future__ import annotations

from pricing_core.american.engines.premium_march.engine import PremiumMarch

__all__ = ["PremiumMarch"]
