"""The march of early exercise premiums in NumPy, function for function what the compiled kernel offers."""

from pricing_core.premium_twin.mesh import STEPS
from pricing_core.premium_twin.solve import march_boundaries, solve_puts

__all__ = ["STEPS", "march_boundaries", "solve_puts"]
