"""SVI of one expiry, by the quasi-explicit calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize, nnls

from pricing_core.arrays import Vector

LARGEST_SLOPE = 2.0  # Largest slope of a wing of total variance (Lee 2004).
FEWEST_QUOTES = 5  # As many as SVI has parameters.
SEARCH: Any = {"maxfev": 120, "xatol": 1e-4, "fatol": 1e-9}
NARROWEST = 0.05  # Smallest width of the smile's bend in standard deviations; chosen.


@dataclass(frozen=True, slots=True)
class SVI:
    """w(x) = a + b (rho (x - m) + sqrt((x - m)^2 + sigma^2)), the raw parametrisation (Gatheral 2004).

    Parameters
    ----------
    a, b, rho, m, sigma : float
        b >= 0, |rho| <= 1, sigma > 0.
    """

    a: float
    b: float
    rho: float
    m: float
    sigma: float

    def at(self, x: Vector) -> Vector:
        """Return the total variance at x."""
        y = x - self.m
        found: Vector = self.a + self.b * (self.rho * y + np.sqrt(y * y + self.sigma**2))
        return found

    def slope(self, x: Vector) -> Vector:
        """Return the derivative of the total variance by x."""
        y = x - self.m
        found: Vector = self.b * (self.rho + y / np.sqrt(y * y + self.sigma**2))
        return found


def calibrate_svi(x: Vector, variance: Vector, deviation: Vector) -> SVI:
    """Fit SVI to the total variances of an expiry by weighted least squares.

    For given m and sigma the rest is linear: with y = (x - m)/sigma, w is a plus u times (sqrt(y^2 + 1) + y)/2 plus v
    times (sqrt(y^2 + 1) - y)/2, and a, u, v >= 0 is non-negative least squares (after Zeliade 2009). The slopes of the
    wings, u/sigma and v/sigma, are held to at most 2. m and sigma come from Nelder and Mead's simplex.

    Parameters
    ----------
    x, variance, deviation : Vector, shape (n,), n >= 5
        Standard deviations of the total variances.
    """
    weight = 1.0 / deviation
    spread = math.sqrt(float(np.interp(0.0, x, variance)))

    def linear_part(place: Vector) -> tuple[Vector, float, float, float]:
        m, sigma = spread * place[0], spread * (NARROWEST + math.exp(place[1]))
        y = (x - m) / sigma
        root = np.sqrt(y * y + 1.0)
        columns = np.stack([np.ones_like(y), 0.5 * (root + y), 0.5 * (root - y)], axis=1)
        found = nnls(columns * weight[:, None], variance * weight)[0]
        found[1:] = np.minimum(found[1:], LARGEST_SLOPE * sigma)
        misfit = float(np.sum(((columns @ found - variance) * weight) ** 2))
        return found, m, sigma, misfit

    def misfit(place: Vector) -> float:
        return linear_part(np.clip(place, -6.0, 3.0))[3]

    starts = [np.array([m, s]) for m in (-0.3, 0.3) for s in (-0.5, 0.5)]
    best = minimize(misfit, min(starts, key=misfit), method="Nelder-Mead", options=SEARCH).x
    (a, u, v), m, sigma, _ = linear_part(np.clip(best, -6.0, 3.0))
    b = 0.5 * (u + v) / sigma
    return SVI(float(a), float(b), float((u - v) / (u + v)) if b > 0.0 else 0.0, float(m), float(sigma))
