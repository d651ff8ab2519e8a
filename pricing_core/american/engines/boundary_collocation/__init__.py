"""American contracts without events and with two exercise boundaries: the compiled collocation of both.

Where rate and yield are negative the exercise region may lie between two boundaries, which may meet before now.
"""

from __future__ import annotations

from pricing_core.american.engines.boundary_collocation.engine import BoundaryCollocation

__all__ = ["BoundaryCollocation"]
