"""How far spot and strike may be apart, and how accurate an exercise boundary is at a tolerance of the price."""

from __future__ import annotations

from pricing_core.american.contracts.contract import Option
from pricing_core.errors import InvalidInputError

# Relative error of an exercise boundary over the square root of the tolerance: 1e-4 at the default tolerance, 1e-5 at
# the smallest one.
BOUNDARY_ACCURACY = 0.1
LARGEST_RATIO = 1e30  # Largest ratio of the spot to the strike, and of the strike to a spot that is not 0.


def check_moneyness(option: Option, spot: float, field: str = "spot") -> None:
    """Raise InvalidInputError where spot and strike are so far apart that their ratio's powers overflow."""
    if spot > 0.0 and not 1.0 / LARGEST_RATIO <= spot / option.strike <= LARGEST_RATIO:
        allowed = f"0, or between {1.0 / LARGEST_RATIO:g} and {LARGEST_RATIO:g} times the strike"
        raise InvalidInputError(field, spot, allowed)
