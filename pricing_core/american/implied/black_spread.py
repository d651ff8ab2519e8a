"""The inverse of Black's formula: the spread sigma sqrt(T) that a time value shows."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from pricing_core.american.engines.black_scholes import ONE_OVER_SQRT_TWO_PI
from pricing_core.arrays import Vector

PASSES = 6
LARGEST_LOG = 700.0  # Largest exponent of e that does not overflow.
LARGEST_GROWTH = 4.0  # Largest factor by which the spread may grow or shrink in a pass; chosen.


def black_time_value(k: Vector, spread: Vector) -> tuple[Vector, Vector]:
    """Return the time value and its derivative by the spread, both of shape (n,).

    An option out of the money by k = |ln(F/K)| costs, with spread s, min(F, K) times

        c = N(s/2 - k/s) - e^k N(-s/2 - k/s),

    N the normal distribution (Black 1976); so does the time value of the one in the money (parity).

    Parameters
    ----------
    k, spread : Vector, shape (n,)
        k >= 0, spread > 0.
    """
    d = 0.5 * spread - k / spread
    c = ndtr(d) - np.exp(np.minimum(k, LARGEST_LOG)) * ndtr(d - spread)
    return c, ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * d * d)


def black_spread(k: Vector, c: Vector) -> Vector:
    """Return the spread at which the time value, in min(F, K), is c; 0 where c <= 0, infinite where c >= 1.

    Halley's method on ln(c/(1 - c)), which is smooth at both ends; 0 < c < 1 is met to about 1e-12 of itself
    wherever the formula itself is that good.

    Parameters
    ----------
    k, c : Vector, shape (n,)

    Examples
    --------
    >>> k = np.array([0.1])
    >>> round(float(black_spread(k, black_time_value(k, np.array([0.25]))[0])[0]), 12)
    0.25
    """
    with np.errstate(all="ignore"):
        inside = np.clip(c, 1e-300, 1.0 - 1e-16)
        goal = np.log(inside) - np.log1p(-inside)
        at_the_money = 2.0 * ndtri(0.5 + 0.5 * inside)
        spread = np.sqrt(at_the_money * at_the_money + 2.0 * k) + 1e-300
        for _ in range(PASSES):
            value, slope = black_time_value(k, spread)
            rest = value * (1.0 - value)
            gap = (np.log(value) - np.log1p(-value) - goal) * rest / slope
            d = 0.5 * spread - k / spread
            bend = (
                d * (d - spread) / spread + (2.0 * value - 1.0) * slope / rest
            )  # second over first derivative
            factor = 1.0 - 0.5 * gap * bend
            step = np.where(factor > 0.25, gap / factor, gap)
            step = np.where(np.isnan(step), np.where(value > inside, np.inf, -np.inf), step)
            spread = np.clip(spread - step, spread / LARGEST_GROWTH, spread * LARGEST_GROWTH)
    return np.where(c <= 0.0, 0.0, np.where(c >= 1.0, np.inf, spread))
