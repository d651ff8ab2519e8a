"""Contracts with events and at most one exercise boundary between any two of them: collocation of the multiplier.

Between two events the multiplier of the option's complementarity system is known on the contact set, so that the
exercise boundary alone is left to find; docs/multiplier_collocation.md tells how.
"""

from __future__ import annotations

from pricing_core.american.engines.multiplier_collocation.engine import MultiplierCollocation

__all__ = ["MultiplierCollocation"]
