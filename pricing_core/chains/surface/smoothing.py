"""The most probable smiles of all expiries together, given their quotes, and what is uncertain about them.

In units of theta_i, the variance at the money, and of z = x/sqrt(theta_i), the smile of expiry i is that of the eSSVI
backbone, plus its derivatives by the backbone's three parameters times small numbers, plus a smooth remainder f_i(z):
splines of `SmileBasis` all of them. f is Gaussian with the precision

    (mass + L^6 roughness) / (3 L a^2)  in z,     e^(-|ln T_i - ln T_j|/memory) the correlation of two expiries,

so that a is its standard deviation at the money and L the distance over which it varies there. Noise is Gaussian with
`noise` times the stated deviation of each quote. The four numbers maximise the marginal likelihood; the rest is linear.
The posterior covariance holds the bias of smoothing as well (Wahba 1983; Nychka 1988), so intervals cover as they say
on average.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.smile_basis import DEGREE, SmileBasis
from pricing_core.errors import NumericalError

PARAMETERS = 3  # Number of parameters of the backbone's smile.
# Prior standard deviations of their changes, relative to theta and sqrt(theta), and memory in ln T; chosen.
LOOSE, LOOSE_MEMORY = np.array([0.5, 0.4, 0.4]), 2.0
# Where the search for (noise, a, L, memory) begins, and how many factors of e each is usually away from there.
CENTRES, SPREADS = np.log([0.5, 0.05, 1.5, 1.0]), np.array([6.0, 2.5, 0.35, 1.0])
LEAST_NOISE, MOST_NOISE = 1e-3, 1e6  # Smallest and largest ratio of noise to stated deviation; chosen.
WORST = 1e30  # The misfit where rounding leaves no factor.
EVALUATIONS = 140  # Largest number of evaluations of the likelihood.


@dataclass(frozen=True, slots=True)
class Scales:
    """How far the smiles may deviate from the backbone, and the quotes from the smiles.

    Parameters
    ----------
    noise : float
        Standard deviation of the quotes in units of the stated ones.
    amplitude, length, memory : float
        a in units of theta, L in standard deviations of the forward, memory in ln T.
    """

    noise: float
    amplitude: float
    length: float
    memory: float

    @classmethod
    def of(cls, logs: Vector) -> Scales:
        """Return the scales with these logarithms, cut to what arithmetic allows."""
        low, high = CENTRES - 4.0 * SPREADS, CENTRES + 4.0 * SPREADS
        low[0], high[0] = math.log(LEAST_NOISE), math.log(MOST_NOISE)
        return cls(*(float(value) for value in np.exp(np.clip(logs, low, high))))

    def logs(self) -> Vector:
        """Return the logarithms of the four numbers."""
        return np.log([self.noise, self.amplitude, self.length, self.memory])


@dataclass(frozen=True)
class SmoothingProblem:
    """Total variances of all expiries with their deviations, and the backbone they are compared with.

    Parameters
    ----------
    basis : SmileBasis
    expiries : Vector, shape (m,)
    backbone : sequence of ESSVI, m of them
    smiles : sequence of (x, variance, deviation)
        Vectors of shape (n_i,) for each expiry.
    """

    basis: SmileBasis
    expiries: Vector
    backbone: Sequence[ESSVI]
    smiles: Sequence[tuple[Vector, Vector, Vector]]

    @property
    def block(self) -> int:
        """Number of unknowns of an expiry: coefficients, then changes of the backbone's parameters."""
        return self.basis.size + PARAMETERS

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.block * self.expiries.size

    @cached_property
    def mean(self) -> Matrix:
        """Coefficients of the backbone's smiles in units of theta, shape (m, n)."""
        places = self.basis.places
        rows = [self.basis.represent(s.at(places * math.sqrt(s.theta)) / s.theta) for s in self.backbone]
        return np.array(rows)

    @cached_property
    def maps(self) -> list[Matrix]:
        """How the unknowns of each expiry change its coefficients, shape (n, n + 3)."""
        places = self.basis.places
        found = []
        for smile in self.backbone:
            root = math.sqrt(smile.theta)
            unit = np.array([1.0, 1.0 / root, 1.0 / root])
            changes = smile.gradient(places * root) * unit
            tangents = np.stack([self.basis.represent(column) for column in changes.T], axis=1)
            found.append(np.concatenate([np.eye(self.basis.size), tangents], axis=1))
        return found

    @cached_property
    def designs(self) -> list[Matrix]:
        """Derivatives of the quotes of an expiry by its unknowns, in units of their deviations, shape (n_i, n + 3)."""
        rows = []
        for smile, (x, _, deviation), own in zip(self.backbone, self.smiles, self.maps, strict=True):
            splines = self.basis.jets(x / math.sqrt(smile.theta)).value
            rows.append(smile.theta / deviation[:, None] * (splines @ own))
        return rows

    @cached_property
    def residuals(self) -> list[Vector]:
        """The quotes less the backbone, in units of their deviations, shape (n_i,)."""
        found = []
        for smile, (x, variance, deviation), mean in zip(self.backbone, self.smiles, self.mean, strict=True):
            splines = self.basis.jets(x / math.sqrt(smile.theta)).value
            found.append((variance - smile.theta * (splines @ mean)) / deviation)
        return found

    @cached_property
    def band(self) -> Matrix:
        """The normal equations of the quotes at noise 1, lower band, shape (n + 9, N)."""
        found = np.zeros((self.block + DEGREE + 1, self.unknowns))
        for i, design in enumerate(self.designs):
            normal = design.T @ design
            for offset in range(self.block):
                start = i * self.block
                found[offset, start : start + self.block - offset] = np.diagonal(normal, -offset)
        return found

    @cached_property
    def right_side(self) -> Vector:
        """The right side of the normal equations at noise 1, shape (N,)."""
        return np.concatenate([d.T @ r for d, r in zip(self.designs, self.residuals, strict=True)])

    def precision(self, scales: Scales) -> Matrix:
        """Return the prior precision, lower band, shape (n + 9, N)."""
        found = np.zeros_like(self.band)
        smooth = self._smooth(scales)
        within, across = _correlation(self.expiries, scales.memory)
        loose_within, loose_across = _correlation(self.expiries, LOOSE_MEMORY)
        n = self.basis.size
        for i in range(self.expiries.size):
            start = i * self.block
            last = i == self.expiries.size - 1
            for offset in range(-DEGREE, DEGREE + 1):
                diagonal = np.diagonal(smooth, -offset)
                columns = slice(start + max(-offset, 0), start + max(-offset, 0) + diagonal.size)
                if offset >= 0:
                    found[offset, columns] += within[i] * diagonal
                if not last:
                    found[self.block + offset, columns] += across[i] * diagonal
            loose = slice(start + n, start + self.block)
            found[0, loose] += loose_within[i] / LOOSE**2
            if not last:
                found[self.block, loose] += loose_across[i] / LOOSE**2
        return found

    def misfit(self, scales: Scales) -> float:
        """Return minus twice the logarithm of the marginal likelihood, and of a vague prior of the four numbers."""
        weight = scales.noise**-2
        try:
            factor = cholesky_banded(
                weight * self.band + self.precision(scales), lower=True, check_finite=False
            )
        except np.linalg.LinAlgError:
            return WORST
        scaled = weight * self.right_side
        explained = float(scaled @ cho_solve_banded((factor, True), scaled, check_finite=False))
        total = weight * math.fsum(float(r @ r) for r in self.residuals)
        count = sum(r.size for r in self.residuals)
        within, across = _correlation(self.expiries, scales.memory)
        time_determinant = float(np.linalg.slogdet(_tridiagonal(within, across))[1])
        smile_determinant = float(np.linalg.slogdet(self._smooth(scales))[1])
        prior = self.basis.size * time_determinant + self.expiries.size * smile_determinant
        vague = float(np.sum(((scales.logs() - CENTRES) / SPREADS) ** 2))
        return (
            2.0 * count * math.log(scales.noise)
            + 2.0 * float(np.sum(np.log(factor[0])))
            - prior
            + total
            - explained
            + vague
        )

    def most_likely(self, start: Scales | None = None, interrupt: Callable[[], bool] | None = None) -> Scales:
        """Return the four numbers of the largest marginal likelihood (Nelder and Mead's simplex)."""
        first = CENTRES.copy() if start is None else start.logs()
        if start is None:
            missed = float(np.median(np.abs(np.concatenate(self.residuals))))
            first[0] = math.log(max(missed, math.exp(CENTRES[0])))
        corners = first + np.vstack([np.zeros(4), np.diag([-1.0, 1.0, 0.3, 0.7])])

        def misfit(logs: Vector) -> float:
            check_interrupt(interrupt)
            return self.misfit(Scales.of(logs))

        search: Any = {"initial_simplex": corners, "maxfev": EVALUATIONS, "xatol": 0.03, "fatol": 0.1}
        found = minimize(misfit, first, method="Nelder-Mead", options=search)
        return Scales.of(found.x)

    def _smooth(self, scales: Scales) -> Matrix:
        length = scales.length
        return (self.basis.mass + length**6 * self.basis.roughness) / (3.0 * length * scales.amplitude**2)


@dataclass(frozen=True)
class Posterior:
    """The most probable smiles, and their covariance.

    Parameters
    ----------
    problem : SmoothingProblem
    scales : Scales
    """

    problem: SmoothingProblem
    scales: Scales

    @cached_property
    def precision(self) -> Matrix:
        """Precision of the unknowns, lower band."""
        return self.problem.band / self.scales.noise**2 + self.problem.precision(self.scales)

    @cached_property
    def factor(self) -> Matrix:
        """Cholesky's factor L of the precision, lower band.

        Raises
        ------
        NumericalError
            The deviations of the quotes are of too different sizes for it.
        """
        try:
            return np.asarray(cholesky_banded(self.precision, lower=True, check_finite=False))
        except np.linalg.LinAlgError as fault:
            message = (
                "the smiles are not determined to rounding: give quotes deviations that differ less in size"
            )
            raise NumericalError(message) from fault

    @cached_property
    def unknowns(self) -> Matrix:
        """The most probable unknowns, shape (m, n + 3)."""
        scaled = self.problem.right_side / self.scales.noise**2
        solved = cho_solve_banded((self.factor, True), scaled, check_finite=False)
        found: Matrix = solved.reshape(self.problem.expiries.size, self.problem.block)
        return found

    def coefficients(self, unknowns: Matrix) -> Matrix:
        """Return the coefficients of the smiles in units of theta, shape (m, n)."""
        changes = [own @ row for own, row in zip(self.problem.maps, unknowns, strict=True)]
        return np.asarray(self.problem.mean + np.array(changes))

    def residuals(self) -> list[Vector]:
        """Return the quotes less the smiles, in units of noise times their deviations."""
        found = zip(self.problem.designs, self.problem.residuals, self.unknowns, strict=True)
        return [(residual - design @ row) / self.scales.noise for design, residual, row in found]

    @cached_property
    def covariance(self) -> Matrix:
        """Covariance of the coefficients of all expiries, one after the other, shape (m n, m n)."""
        problem, n = self.problem, self.problem.basis.size
        columns = np.zeros((problem.unknowns, n * problem.expiries.size))
        for i, own in enumerate(problem.maps):
            columns[i * problem.block : (i + 1) * problem.block, i * n : (i + 1) * n] = own.T
        solved = cho_solve_banded((self.factor, True), columns, check_finite=False)
        covariance: Matrix = columns.T @ solved
        return covariance

    def responses(self, shifts: Sequence[Vector]) -> Matrix:
        """Return the derivatives of the coefficients of all smiles by the quotes of an expiry, shape (m n, m).

        Parameters
        ----------
        shifts : sequence of Vector, shape (n_i,)
            What the quotes of each expiry change by, in their deviations.
        """
        problem, n = self.problem, self.problem.basis.size
        sides = np.zeros((problem.unknowns, problem.expiries.size))
        for i, (design, shift) in enumerate(zip(problem.designs, shifts, strict=True)):
            sides[i * problem.block : (i + 1) * problem.block, i] = design.T @ shift / self.scales.noise**2
        solved = cho_solve_banded((self.factor, True), sides, check_finite=False)
        found = np.empty((n * problem.expiries.size, problem.expiries.size))
        for i, own in enumerate(problem.maps):
            found[i * n : (i + 1) * n] = own @ solved[i * problem.block : (i + 1) * problem.block]
        return found


def _correlation(expiries: Vector, memory: float) -> tuple[Vector, Vector]:
    """Return diagonal and subdiagonal of the inverse of the correlation e^(-|ln T_i - ln T_j|/memory)."""
    step = np.exp(-np.diff(np.log(expiries)) / memory)
    own = step**2 / (1.0 - step**2)
    within = np.ones(expiries.size)
    within[:-1] += own
    within[1:] += own
    return within, -step / (1.0 - step**2)


def _tridiagonal(diagonal: Vector, beside: Vector) -> Matrix:
    matrix: Matrix = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    return matrix
