"""The flow of a mode for any length of time, from its eigenvalues, and what its outputs cannot fall below."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector

RANK = 1e-12  # share of the largest singular value below which one is zero
NOTHING = 1e-15  # share of |R| that is rounding
LARGEST_CONDITION = 1e7  # of the eigenvectors
STEADY = 4e-15  # share of |R| below which a real part is rounding
MOST_GROWTH = 1.0  # exponent that a growing motion may reach
LONGEST_CHAIN = 4  # generalised eigenvectors of the eigenvalue 0: polynomials of time up to the third degree


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """c(t) = sum t**j N_j c + Re sum_i right_i exp(rates_i t) left_i c.

    Parameters
    ----------
    polynomial : array, shape (p, d, d)
        N_j, from the eigenvalue 0.
    rates : array of complex, shape (m,)
        The eigenvalues other than 0.
    right, left : array of complex, shape (d, m) and (m, d)
    """

    polynomial: NDArray[np.float64]
    rates: NDArray[np.complex128]
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]

    def states(self, c: Vector, times: Vector) -> Matrix:
        """Return c(t) at these times, shape (len(times), d)."""
        powers = times[:, None] ** np.arange(self.polynomial.shape[0])
        waves = np.exp(times[:, None] * self.rates) * (self.left @ c)
        return np.asarray(powers @ (self.polynomial @ c) + (waves @ self.right.T).real)

    def bounds(self, outputs: Matrix, c: Vector, length: float) -> tuple[Vector, Vector]:
        """Return bounds of outputs @ c(t) from below and above for 0 <= t <= length, shape (k,) each.

        A motion that grows is not bounded.
        """
        coefficients = (self.polynomial @ c) @ outputs.T
        low, high = _polynomial_bounds(coefficients * (length ** np.arange(len(coefficients)))[:, None])
        shares = np.abs(self.left @ c)
        if np.any(shares[self.rates.real * length > MOST_GROWTH] > 0.0):
            return np.full_like(low, -math.inf), np.full_like(high, math.inf)
        swing = np.abs(outputs @ self.right) @ (shares * np.exp(np.clip(self.rates.real * length, 0.0, 1.0)))
        return low - swing, high + swing


def closed_form(rate: Matrix) -> ClosedForm | None:
    """Return the closed form of exp(R t), None where the eigenvectors are too close to dependent.

    Cost: some singular value decompositions and one of eigenvalues.

    Examples
    --------
    Free fall, x'' = w with w' = 0:

    >>> closed_form(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])).states(
    ...     np.array([0.0, 1.0, -2.0]), np.array([3.0])
    ... )
    array([[-6., -5., -2.]])
    """
    d = rate.shape[0]
    size = float(np.linalg.norm(rate, 2)) if d else 0.0
    if size == 0.0:
        empty = np.zeros((0,), dtype=np.complex128)
        return ClosedForm(np.eye(d)[None], empty, np.zeros((d, 0), complex), np.zeros((0, d), complex))
    zero, rest, length = _parts(rate / size)
    both = np.hstack([zero, rest])
    if both.shape[1] != d or np.linalg.cond(both) > LARGEST_CONDITION:
        return None
    inverse = np.linalg.inv(both)
    to_zero, to_rest = inverse[: zero.shape[1]], inverse[zero.shape[1] :]
    terms, nilpotent = [zero], to_zero @ rate @ zero
    own = float(np.abs(nilpotent).max(initial=0.0))
    if own <= NOTHING * size:
        nilpotent[:] = 0.0
    elif np.abs(np.linalg.matrix_power(nilpotent / own, LONGEST_CHAIN)).max() > RANK:
        return None  # slow, not zero
    for j in range(1, length):
        terms.append(terms[-1] @ nilpotent / j)
    values, vectors = np.linalg.eig((to_rest @ rate @ rest).astype(np.complex128))
    if values.size and np.linalg.cond(vectors) > LARGEST_CONDITION:
        return None
    values = np.where(np.abs(values.real) <= STEADY * size, 1j * values.imag, values)
    left = np.linalg.solve(vectors, to_rest) if values.size else np.zeros((0, d), complex)
    return ClosedForm(np.array([term @ to_zero for term in terms]), values, rest @ vectors, left)


def _parts(rate: Matrix) -> tuple[Matrix, Matrix, int]:
    """Return bases of the kernel of R**p and of its range, and p, from which on they do not change."""
    d = rate.shape[0]
    zero, rest, power = np.zeros((d, 0)), np.eye(d), np.eye(d)
    for p in range(LONGEST_CHAIN + 1):
        following = power @ rate
        left, values, right = np.linalg.svd(following)
        rank = int(np.count_nonzero(values > RANK * max(float(values[0]), 1e-300)))
        if d - rank == zero.shape[1] or rank == rest.shape[1]:
            return zero, rest, p
        zero, rest, power = right[rank:].T, left[:, :rank], following
        if rank == 0:
            return zero, rest, p + 1
    return zero, rest, LONGEST_CHAIN + 1


def _polynomial_bounds(coefficients: Matrix) -> tuple[Vector, Vector]:
    """Return bounds on [0, 1] of polynomials with these coefficients, lowest power first, by Bernstein's form."""
    n = coefficients.shape[0] - 1
    if n < 0:
        none = np.zeros(coefficients.shape[1])
        return none, none
    change = [[math.comb(i, j) / math.comb(n, j) for j in range(n + 1)] for i in range(n + 1)]
    values = np.array(change) @ coefficients
    return values.min(axis=0), values.max(axis=0)
