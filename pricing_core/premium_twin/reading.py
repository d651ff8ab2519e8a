"""From the premium at the labels to options at their spots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.premium_twin.cell import ONE_OVER_SQRT_TWO_PI, mills_ratio
from pricing_core.premium_twin.march import Marched

STENCIL = 6


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one march says at the spots; the obstacle where the option is exercised.

    Parameters
    ----------
    u : Matrix, shape (6, n)
        The premium, its first two derivatives by xi, and those by rate, dividend and spread at fixed xi.
    boundary : Vector, shape (n,)
        ln(S*/K).
    settled : bool array, shape (n,)
        Whether the march kept the boundary.
    """

    u: Matrix
    boundary: Vector
    settled: NDArray[np.bool_]

    def take(self, spots: NDArray[np.intp]) -> "Sight":
        """Return some of the spots."""
        return Sight(self.u[:, spots], self.boundary[spots], self.settled[spots])


class Spots:
    """Spots, and what of their options no march changes; the parameters have shape (n,)."""

    def __init__(self, x: Vector, rate: Vector, dividend: Vector, spread: Vector) -> None:
        self.x, self.rate, self.dividend, self.spread = x, rate, dividend, spread
        self.xi = (x + rate - dividend) / spread - 0.5 * spread
        self.bond, self.moneyness = np.exp(-rate), np.exp(x)
        self.density = ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * (self.xi * self.xi))
        self.in_bond = _weighted_normal(-self.xi, self.bond * self.density, self.bond)
        self.in_stock = _weighted_normal(-(self.xi + spread), self.bond * self.density, np.exp(x - dividend))
        growth = 1.0 / self.bond
        held = growth * (self.moneyness - self.in_stock)
        slope = -(spread * held)
        self.at_once = np.stack(
            [
                growth * (self.in_stock - self.in_bond - np.expm1(x)),
                slope,
                spread * (slope - self.density),
                growth,
                -(growth * self.moneyness),
                -((self.xi + spread) * held) - self.density,
            ]
        )

    def look(self, marched: Marched, row: NDArray[np.intp]) -> Sight:
        """Return what a march says; `row` is that of each spot."""
        y = (self.xi - marched.frame[row]) / marched.spacing
        u = _interpolate(marched.state, row, y)
        u[1] /= marched.spacing
        u[2] /= marched.spacing**2
        if marched.state.shape[0] > 1:
            u[3:] -= u[1] * marched.frame_by[:, row]
        boundary = marched.boundary[row]
        return Sight(np.where(self.x <= boundary, self.at_once, u), boundary, marched.settled[row])

    def premium_bound(self, boundary: Vector) -> Vector:
        """Return what the premium over K is at most, about, that far from the boundary: now, and without expiry."""
        drift = (self.rate - self.dividend) / self.spread - 0.5 * self.spread
        decay = drift + np.sqrt(drift * drift + 2.0 * self.rate)
        deviations = (self.x - boundary) / self.spread
        now = self.rate * np.exp(-0.5 * deviations**2)
        return np.asarray(np.minimum(now, np.exp(-decay * deviations)))

    def differences(self, near: Matrix) -> Matrix:
        """Return the differences of V/K and its derivatives, shape (7, n), from those of u and its own."""
        scale = self.bond / self.spread
        return np.stack(
            [
                self.bond * near[0],
                scale * near[1],
                scale * near[2] / self.spread,
                np.zeros(self.x.size),
                *(self.bond * near[3:]),
            ]
        )

    def values(self, u: Matrix, boundary: Vector) -> Matrix:
        """Return V/K and its derivatives, shape (7, n): the payoff's at and below the boundary."""
        density = self.bond * self.density
        moved = self.bond * u[1] / self.spread
        european = self.in_bond - self.in_stock
        values = np.stack(
            [
                european + self.bond * u[0],
                moved - self.in_stock,
                (self.bond * u[2] / self.spread + density) / self.spread - self.in_stock,
                european,
                moved + self.bond * (u[3] - u[0]) - self.in_bond,
                self.bond * u[4] - moved + self.in_stock,
                self.bond * (u[5] - u[1] * (self.xi / self.spread + 1.0)) + density,
            ]
        )
        at_once = np.zeros_like(values)
        at_once[0], at_once[1:3], at_once[3] = -np.expm1(self.x), -self.moneyness, european
        return np.where(self.x <= boundary, at_once, values)


def _weighted_normal(d: Vector, density: Vector, whole: Vector) -> Vector:
    tail = density * mills_ratio(np.abs(d))
    return np.where(d < 0.0, tail, whole - tail)


def _interpolate(state: NDArray[np.float64], row: NDArray[np.intp], y: Vector) -> Matrix:
    """Return u at y cells from label 0, its first two derivatives by y, and those of the state; zero beyond."""
    last = state.shape[1] - 2 - STENCIL
    first = np.clip(np.where(y >= 2.0, np.minimum(y, 1e9), 2.0).astype(np.int64) - 2, 0, last)
    z = y - first
    inside = z < STENCIL - 3
    z = np.where(inside, z, 0.0)
    labels = [state[:, first + k, row] for k in range(STENCIL)]
    for order in range(1, STENCIL):  # Newton's forward differences
        for k in range(STENCIL - 1, order - 1, -1):
            labels[k] = labels[k] - labels[k - 1]
    binomial, once, twice = np.ones_like(z), np.zeros_like(z), np.zeros_like(z)
    value, slope, curvature = labels[0], np.zeros_like(z), np.zeros_like(z)
    for k in range(1, STENCIL):
        step = z - (k - 1)
        twice = (twice * step + 2.0 * once) / k
        once = (once * step + binomial) / k
        binomial = binomial * step / k
        value = value + binomial * labels[k]
        slope = slope + once * labels[k][0]
        curvature = curvature + twice * labels[k][0]
    found = np.zeros((6, y.size))
    found[0], found[1], found[2] = value[0], slope, curvature
    found[3 : 2 + state.shape[0]] = value[1:]
    return np.where(inside, found, 0.0)
