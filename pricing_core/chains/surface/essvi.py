"""Smiles of eSSVI: a smile per expiry with three parameters each, free of arbitrage by conditions in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.interruption import check_interrupt

LARGEST_SLOPE = 1.9  # Largest slope of a wing, below the 2 of Lee (2004).
LEAST_GROWTH = 1e-4  # Least relative growth of the variance at the money from one expiry to the next; chosen.


@dataclass(frozen=True, slots=True)
class ESSVI:
    """w(x) = (theta + chi x + sqrt((psi x + rho theta)^2 + (1 - rho^2) theta^2)) / 2, chi = rho psi.

    theta is the total variance at the money, psi = theta phi (Gatheral and Jacquier 2014; Hendriks and Martini 2019).
    The slopes of the wings are left = (psi - chi)/2 and right = (psi + chi)/2.

    Parameters
    ----------
    theta, left, right : float
        theta > 0; left, right > 0. Without butterfly arbitrage where max(left, right) <= 2 and
        (left + right) max(left, right) <= 2 theta; without calendar arbitrage where theta, left and right grow with
        the expiry and psi/theta falls (sufficient conditions).
    """

    theta: float
    left: float
    right: float

    @property
    def psi(self) -> float:
        """The sum of the slopes of the two wings."""
        return self.left + self.right

    @property
    def rho(self) -> float:
        """The correlation rho of the smile."""
        return (self.right - self.left) / self.psi

    def at(self, x: Vector) -> Vector:
        """Return the total variance at x."""
        return self._parts(x)[0]

    def gradient(self, x: Vector) -> Matrix:
        """Return its derivatives by theta, left and right, shape (n, 3)."""
        _, root = self._parts(x)
        theta, left, right = self.theta, self.left, self.right
        psi, chi = left + right, right - left
        by_theta = 0.5 * (1.0 + (chi * x + theta) / root)
        by_psi, by_chi = 0.5 * psi * x * x / root, 0.5 * (x + x * theta / root)
        return np.stack([by_theta, by_psi - by_chi, by_psi + by_chi], axis=1)

    def _parts(self, x: Vector) -> tuple[Vector, Vector]:
        # The radicand is psi^2 x^2 + 2 chi x theta + theta^2.
        psi, chi = self.psi, self.right - self.left
        root = np.sqrt(psi**2 * x * x + 2.0 * chi * x * self.theta + self.theta**2)
        return 0.5 * (self.theta + chi * x + root), root


def calibrate_essvi(
    smiles: Sequence[tuple[Vector, Vector, Vector]],
    starts: Sequence[ESSVI],
    interrupt: Callable[[], bool] | None = None,
) -> list[ESSVI]:
    """Fit a smile per expiry, in the order of the expiries, each within what the one before leaves free of arbitrage.

    Parameters
    ----------
    smiles : sequence of (x, variance, deviation)
        Vectors of shape (n,), n >= 1, for each expiry.
    starts : sequence of ESSVI
        Where the search begins, for each expiry.
    """
    found: list[ESSVI] = []
    for smile, start in zip(smiles, starts, strict=True):
        check_interrupt(interrupt)
        found.append(_calibrated(smile, start, found[-1] if found else None))
    return found


def _calibrated(smile: tuple[Vector, Vector, Vector], start: ESSVI, before: ESSVI | None) -> ESSVI:
    """Fit one expiry in a box, then shrink towards the smile of the one before until the joint conditions hold."""
    x, variance, deviation = smile
    least = np.array([1e-8, 1e-8, 1e-8])
    if before is not None:
        least = np.array([before.theta * (1.0 + LEAST_GROWTH), before.left, before.right])
    most = np.array([max(50.0, 10.0 * least[0]), *np.maximum(LARGEST_SLOPE, least[1:] * 1.01)])
    first = np.clip([start.theta, start.left, start.right], least * (1.0 + 1e-9) + 1e-12, most * (1.0 - 1e-9))
    free = 3 if x.size >= 4 else 1
    scale = np.array([first[0], math.sqrt(first[0]), math.sqrt(first[0])])[:free]

    def smile_of(place: Vector) -> ESSVI:
        return ESSVI(*(float(value) for value in np.concatenate([place * scale, first[free:]])))

    def residuals(place: Vector) -> Vector:
        return np.asarray((smile_of(place).at(x) - variance) / deviation)

    def jacobian(place: Vector) -> Matrix:
        return np.asarray(smile_of(place).gradient(x)[:, :free] * scale / deviation[:, None])

    fit = least_squares(
        residuals,
        first[:free] / scale,
        jac=jacobian,
        bounds=(least[:free] / scale, most[:free] / scale),
        loss="soft_l1",
        max_nfev=60,
    )
    return _admissible(smile_of(fit.x), before)


def _admissible(smile: ESSVI, before: ESSVI | None) -> ESSVI:
    """Return the smile with its slopes cut to what its theta allows."""
    base_left, base_right = (before.left, before.right) if before is not None else (0.0, 0.0)
    more_left, more_right = max(smile.left - base_left, 0.0), max(smile.right - base_right, 0.0)
    share = 1.0
    if before is not None and more_left + more_right > 0.0:
        room = before.psi * (smile.theta / before.theta - 1.0)
        share = min(1.0, room / (more_left + more_right))
    for _ in range(60):
        left, right = base_left + share * more_left, base_right + share * more_right
        steep = max(left, right)
        if steep <= LARGEST_SLOPE and (left + right) * steep <= 2.0 * smile.theta:
            break
        share *= 0.9
    tiny = 1e-9 * smile.theta
    return ESSVI(smile.theta, max(left, tiny), max(right, tiny))
