"""The kernel's early exercise premiums in NumPy: the readable reference, and the oracle of its tests."""

from pricing_core.premium_twin.march import premium_march
from pricing_core.premium_twin.values import premium_values, profile_values

__all__ = ["premium_march", "premium_values", "profile_values"]
