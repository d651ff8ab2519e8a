"""The exercise boundary of the option without expiry (McKean 1965; Merton 1973)."""

from __future__ import annotations

import math


def perpetual_boundary(*, is_put: bool, rate: float, dividend_yield: float, volatility: float) -> float:
    """Return S*/K of the option without expiry; 0 (put) or infinite (call) where it is never exercised.

    With L the negative root of sigma**2 L (L - 1)/2 + (r - q) L - r = 0, S*/K = L/(L - 1) for the put; the call by
    exchanging r and q.

    Examples
    --------
    >>> round(40 * perpetual_boundary(is_put=True, rate=0.06, dividend_yield=0.0, volatility=0.2), 12)
    30.0
    """
    if not is_put:
        boundary = _put_boundary(dividend_yield, rate, volatility)
        return 1.0 / boundary if boundary > 0.0 else math.inf
    return _put_boundary(rate, dividend_yield, volatility)


def _put_boundary(rate: float, dividend_yield: float, volatility: float) -> float:
    if rate <= 0.0:
        return 0.0
    variance = volatility * volatility
    drift = rate - dividend_yield - 0.5 * variance
    root = math.sqrt(drift * drift + 2.0 * variance * rate)
    # -L without cancellation or division by a vanishing variance: -L = (drift + root)/variance.
    if drift >= 0.0:
        ratio = variance / (drift + root) if drift + root > 0.0 else 0.0
    else:
        ratio = (root - drift) / (2.0 * rate)
    return 1.0 / (1.0 + ratio)  # L/(L - 1) = 1/(1 + 1/(-L))
