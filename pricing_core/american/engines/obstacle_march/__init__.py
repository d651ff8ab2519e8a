"""Contracts by the march of their obstacle problems: whatever happens to a contract, one algorithm.

`docs/obstacle.md` has the mathematics, `pricing_core.obstacle` the march for any obstacle problem; `march_book.py`
gives books to the compiled march, and is imported where it is asked for.
"""

from __future__ import annotations

from pricing_core.american.engines.obstacle_march.compiled import (
    CompiledMarch,
    least_volatility,
    leaves_out_the_strike,
)
from pricing_core.american.engines.obstacle_march.engine import MarchWithoutKernel, ObstacleMarch

__all__ = [
    "CompiledMarch",
    "MarchWithoutKernel",
    "ObstacleMarch",
    "least_volatility",
    "leaves_out_the_strike",
]
