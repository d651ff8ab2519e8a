"""Splines of degree 5 on knots in standard deviations, with straight wings: what all smiles are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.surface.jet import Jet

DEGREE = 5
WIDTH, STEP = 1.8, 0.14  # Knots at WIDTH sinh(STEP j): a quarter of a deviation apart in the middle; chosen.
LEAST_REACH, MOST_REACH = 6.0, 16.0  # Where the outermost knots may lie, in standard deviations.


@dataclass(frozen=True)
class SmileBasis:
    """The splines B_1 ... B_n over breaks in z, continued by their tangents outside.

    Parameters
    ----------
    breaks : Vector, shape (m,)
        Increasing, in standard deviations.
    """

    breaks: Vector

    @classmethod
    def covering(cls, left: float, right: float) -> SmileBasis:
        """Return the basis on graded breaks that reach as far as the quotes do, within limits."""
        first = -math.ceil(math.asinh(min(max(-left, LEAST_REACH), MOST_REACH) / WIDTH) / STEP)
        last = math.ceil(math.asinh(min(max(right, LEAST_REACH), MOST_REACH) / WIDTH) / STEP)
        return cls(WIDTH * np.sinh(STEP * np.arange(first, last + 1)))

    @cached_property
    def knots(self) -> Vector:
        """The breaks, each end six times, shape (m + 10,)."""
        ends = [np.full(DEGREE, self.breaks[0]), self.breaks, np.full(DEGREE, self.breaks[-1])]
        return np.concatenate(ends)

    @property
    def size(self) -> int:
        """Number of splines n = m + 4."""
        return int(self.breaks.size) + DEGREE - 1

    def jets(self, z: Vector) -> Jet:
        """Return all splines and their derivatives by z at k places, each of shape (k, n)."""
        inside = np.clip(z, self.breaks[0], self.breaks[-1])
        value, first, second = (self._derivative(order)(inside) for order in range(3))
        beyond = (z - inside)[:, None]
        second = np.where(beyond == 0.0, second, 0.0)
        return Jet(value + beyond * first, first, second)

    def represent(self, values: Vector) -> Vector:
        """Return the coefficients of the spline through values at `places`, shape (n,)."""
        return np.asarray(np.linalg.solve(self._derivative(0)(self.places), values), dtype=np.float64)

    @cached_property
    def places(self) -> Vector:
        """Places at which values determine a spline (Greville), shape (n,)."""
        windows = [self.knots[j + 1 : j + 1 + DEGREE].mean() for j in range(self.size)]
        return np.array(windows)

    @cached_property
    def roughness(self) -> Matrix:
        """The integrals of B_i''' B_j''' q^3 dz, shape (n, n), of band 5, see `mass`."""
        return self._gram(3, 3.0)

    @cached_property
    def mass(self) -> Matrix:
        """The integrals of B_i B_j q^-3 dz, q^2 = 1 + (z/WIDTH)^2, shape (n, n), of band 5.

        Far out functions of this size vary as slowly as the breaks there are apart, and are as large as q.
        """
        return self._gram(0, -3.0)

    def _gram(self, order: int, power: float) -> Matrix:
        """Return the integrals of products of derivatives, by Gauss and Legendre on every piece."""
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
        half = 0.5 * np.diff(self.breaks)
        places = (0.5 * (self.breaks[1:] + self.breaks[:-1])[:, None] + half[:, None] * nodes).ravel()
        values, far = self._derivative(order)(places), np.sqrt(1.0 + (places / WIDTH) ** 2)
        return np.asarray(values.T @ (values * (far**power * (half[:, None] * weights).ravel())[:, None]))

    def _derivative(self, order: int) -> BSpline:
        return self._derivatives[order]

    @cached_property
    def _derivatives(self) -> list[BSpline]:
        basis = BSpline(self.knots, np.eye(self.size), DEGREE)
        return [basis, *(basis.derivative(order) for order in (1, 2, 3))]
