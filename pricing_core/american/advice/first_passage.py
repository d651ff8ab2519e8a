"""When a Brownian motion with drift first meets a moving edge below it.

With X the motion, c the edge, and F(t) the mass absorbed up to t, every path that lies below the edge at t has met it
before (Fortet 1943):

    P(X_t <= c(t)) = integral over s <= t of P(X_t <= c(t) | X_s = c(s)) dF(s).

The kernel tends to 1/2 as s tends to t, so that this is an equation of the second kind for F. F is linear between the
points of a mesh, and the kernel is averaged over each of its intervals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from pricing_core.american.advice.laws import REACH, Density, Law, normal_density, resolved
from pricing_core.arrays import Matrix, Vector

INSIDE, LAST = (
    4,
    8,
)  # Numbers of Gauss points in an interval of the mesh, and in the last one before each time; chosen.
# Smallest mean of the kernel over the interval that ends now: below it the edge falls away from everyone who was on it
# by more than three standard deviations, and nobody meets it; chosen.
LEAST_KERNEL = 1e-3


def gauss(count: int) -> tuple[Vector, Vector]:
    """Return nodes and weights of Gauss and Legendre's rule on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """A motion from a law above a moving edge that absorbs it, over a length of time.

    Time is told by a parameter from 0 to 1, of which it is the square of a sine: meshes that are even in the parameter
    are dense at both ends, where F has roots.

    Parameters
    ----------
    law : Law
        At the start, all of it above the edge or on it.
    drift, volatility : float
        1/year, 1/sqrt(year); the volatility is above 0.
    length : float
        Years, above 0.
    edge : callable
        Takes parameters and returns places of the edge, of the same shape.
    check : callable
        Called between the steps of the work; may raise.
    """

    law: Law
    drift: float
    volatility: float
    length: float
    edge: Callable[[Vector], Vector]
    check: Callable[[], None]

    def mirrored(self) -> Passage:
        """Return the passage of -X, from below the edge."""
        edge = self.edge
        return replace(self, law=self.law.mirrored(), drift=-self.drift, edge=lambda x: -edge(x))

    def time(self, parameter: Vector) -> Vector:
        """Return the years since the start."""
        return np.asarray(self.length * np.sin(0.5 * np.pi * parameter) ** 2)

    def absorbed(self, count: int) -> Vector:
        """Return F at the points of a mesh of `count` intervals, increasing, shape (count + 1,).

        The error is of second order in the size of the intervals.
        """
        h = 1.0 / count
        mesh = np.linspace(0.0, 1.0, count + 1)
        points = mesh[1:]
        elapsed = self.time(points)
        reached = self.law.below(self.edge(points), self.drift * elapsed, self.volatility * np.sqrt(elapsed))
        nodes, weights = gauss(INSIDE)
        inside = (mesh[:-1, None] + h * nodes).ravel()
        earlier = self._kernel(points[:, None], inside[None, :]).reshape(count, count, INSIDE) @ weights
        roots, weights = gauss(LAST)  # the kernel is smooth in the root of the time that is left
        now = self._kernel(points[:, None], points[:, None] - h * roots**2) @ (2.0 * roots * weights)
        gained = np.zeros(count)
        left = self.law.mass
        for i in np.flatnonzero(now > LEAST_KERNEL).tolist():
            gained[i] = min(max((reached[i] - earlier[i, :i] @ gained[:i]) / now[i], 0.0), left)
            left -= gained[i]
        return np.concatenate([[0.0], np.cumsum(gained)])

    def survivors(self, absorbed: Vector) -> tuple[Density | None, float]:
        """Return the law of the mass that is left at the end, and by how much it differs from what F leaves.

        Parameters
        ----------
        absorbed : Vector, shape (count + 1,)
            F, as found.
        """
        mass = self.law.mass - float(absorbed[-1])
        spread = self.volatility * np.sqrt(self.length)
        low = float(self.edge(np.array([1.0]))[0])
        high = self.law.support[1] + self.drift * self.length + REACH * spread
        if mass <= 0.0 or high <= low:
            return None, max(mass, 0.0)
        nodes, weights = self._nodes(absorbed.size - 1)
        masses = (weights * np.diff(absorbed)[:, None]).ravel()
        since = np.maximum(self.length - self.time(nodes), 0.0)
        spreads = np.maximum(self.volatility * np.sqrt(since), 1e-300)
        centres = self.edge(nodes) + self.drift * since
        used = masses > 0.0
        masses, spreads, centres = masses[used] / spreads[used], spreads[used], centres[used]

        def density(place: Vector) -> Vector:
            self.check()
            free = self.law.density(place, self.drift * self.length, float(spread))
            return free - normal_density((place[:, None] - centres) / spreads) @ masses

        found = resolved(density, low, high)
        if not found.mass > 0.0:
            return None, mass
        return found.with_mass(mass), abs(found.mass - mass)

    def _kernel(self, now: Matrix, before: Matrix) -> Matrix:
        """Return the probability to lie below the edge now for who was on it before."""
        since = np.maximum(self.time(now) - self.time(before), 0.0)
        spread = np.maximum(self.volatility * np.sqrt(since), 1e-300)
        return np.asarray(ndtr((self.edge(now) - self.edge(before) - self.drift * since) / spread))

    def _nodes(self, count: int) -> tuple[Vector, Matrix]:
        """Return parameters (count LAST,) and shares (count, LAST) of every interval; the last is seen from its end."""
        nodes, weights = gauss(LAST)
        h = 1.0 / count
        parameters = np.linspace(0.0, 1.0, count + 1)[:-1, None] + h * nodes
        shares = np.repeat(weights[None, :], count, axis=0)
        parameters[-1] = 1.0 - h * nodes[::-1] ** 2
        shares[-1] = (2.0 * nodes * weights)[::-1]
        return parameters.ravel(), shares
