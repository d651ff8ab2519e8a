"""The payoff as a constraint in log-moneyness."""

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.flat.closed_form import LARGEST_EXPONENT
from pricing_core.arrays import Vector


def payoff_obstacle(option: Option, x: Vector) -> Vector:
    """Return g(x) = max(1 - e^x, 0) for the put (11.57), max(e^x - 1, 0) for the call."""
    moneyness = np.exp(np.minimum(x, LARGEST_EXPONENT))
    return np.maximum(1.0 - moneyness if option.is_put else moneyness - 1.0, 0.0)
