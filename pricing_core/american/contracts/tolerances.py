"""What `price` and its companions accept: tolerances, and how far spot and strike may be apart."""

from pricing_core.american.contracts.contract import Option
from pricing_core.errors import InvalidInputError

SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-8, 1e-2  # fractions of the strike
DEFAULT_TOLERANCE = 1e-6
BOUNDARY_ACCURACY = (
    0.1  # relative, of the root of the tolerance: 1e-4 by default, 1e-5 at the smallest tolerance
)
LARGEST_RATIO = 1e30  # of spot and strike, either way


def check_moneyness(option: Option, spot: float) -> None:
    """Raise InvalidInputError where spot and strike are so far apart that their ratio's powers overflow."""
    if spot > 0.0 and not 1.0 / LARGEST_RATIO <= spot / option.strike <= LARGEST_RATIO:
        allowed = f"0, or between {1.0 / LARGEST_RATIO:g} and {LARGEST_RATIO:g} times the strike"
        raise InvalidInputError("spot", spot, allowed)
