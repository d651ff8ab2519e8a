"""What Black's undiscounted price gains with the volatility and with the forward."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from pricing_core.arrays import Vector


def forward_greeks(
    option_type: str, forward: float, strike: Vector, volatility: Vector, expiry: float
) -> tuple[Vector, Vector]:
    """Return the vega, money, and the delta of Black's formula (1976), each of shape (n,)."""
    spread = volatility * math.sqrt(expiry)
    d = np.log(forward / strike) / spread + 0.5 * spread
    vega = forward * np.exp(-0.5 * d * d) * math.sqrt(expiry / (2.0 * math.pi))
    return vega, ndtr(d) if option_type == "call" else ndtr(d) - 1.0
