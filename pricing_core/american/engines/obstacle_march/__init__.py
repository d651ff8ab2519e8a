"""Books by the compiled march of their obstacle problems: whatever happens to a contract, one algorithm.

`docs/obstacle.md` has the mathematics, `pricing_core.obstacle` the same march for any obstacle problem.
"""

from __future__ import annotations

from pricing_core.american.engines.obstacle_march.compiled import CompiledMarch

__all__ = ["CompiledMarch"]
