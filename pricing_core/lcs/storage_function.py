"""The candidates Q of the passivity inequality (11.6): an affine family that shrinks as rows are forced to zero."""

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from pricing_core.lcs.rational_system import RationalSystem
from pricing_core.linalg.rational import (
    RationalMatrix,
    exact_image,
    exact_kernel,
    exact_solution,
)


@dataclass(frozen=True, slots=True, eq=False)
class StorageFamily:
    """Q = Q[0] + sum_i theta_i Q[i], and the matrix S(Q) = S[0] + sum_i theta_i S[i] that must be semidefinite.

    S is minus the matrix of (11.6), its second half restricted to a complement R of ker(D + D^T):

        S = [[-(A^T Q + Q A), (C^T - Q B) R], [R^T (C - B^T Q), R^T (D + D^T) R]]

    Every Q of the family satisfies Q B = C^T on that kernel, as (11.6) demands.
    """

    Q: RationalMatrix  # (1 + parameters, n, n)
    S: RationalMatrix  # (1 + parameters, n + r, n + r)

    @property
    def parameters(self) -> int:
        """The number of theta."""
        return len(self.Q) - 1

    def at(self, theta: RationalMatrix) -> tuple[RationalMatrix, RationalMatrix]:
        """Return Q and S."""
        weights = np.concatenate([[fmpq(1)], theta])
        return np.tensordot(weights, self.Q, axes=1), np.tensordot(weights, self.S, axes=1)

    def forced_zero(self) -> int | None:
        """Return a row of S whose diagonal entry is zero for all theta, but not the row: it must vanish."""
        for i in range(self.S.shape[1]):
            if not self.S[:, i, i].any() and self.S[:, i].any():
                return i
        return None

    def with_zero(self, V: RationalMatrix) -> "StorageFamily | None":
        """Return the members with S V = 0, V of shape (n + r, m), or None where there are none."""
        products = (self.S @ V).reshape(len(self.S), self.S.shape[1] * V.shape[1])
        start = exact_solution(products[1:].T, -products[:1].T)
        if start is None:
            return None
        weights = np.vstack([start.T, exact_kernel(products[1:].T).T])
        first = np.zeros((len(weights), 1), dtype=object)
        first[0] = 1
        weights = np.hstack([first, weights])
        return StorageFamily(np.tensordot(weights, self.Q, axes=1), np.tensordot(weights, self.S, axes=1))


def storage_family(system: RationalSystem) -> StorageFamily | None:
    """Return all symmetric Q with Q B = C^T on ker(D + D^T), or None where there are none.

    Cost: an elimination with n (n + 1) / 2 unknowns.
    """
    A, B, C, D = system
    n = system.shape[0]
    kernel = exact_kernel(D + D.T)
    R = exact_image(D + D.T)  # the range completes the kernel of a symmetric matrix
    units = _symmetric_units(n)
    conditions = (units @ (B @ kernel)).reshape(len(units), n * kernel.shape[1]).T
    values = (C.T @ kernel).reshape(-1, 1)
    start = exact_solution(conditions, values)
    if start is None:
        return None
    weights = np.vstack([start.T, exact_kernel(conditions).T])
    Q = np.tensordot(weights, units, axes=1)
    constant = np.full((len(Q), 1, 1), fmpq(0), dtype=object)
    constant[0] = fmpq(1)
    corner = constant * (C.T @ R) - Q @ (B @ R)
    resistance = constant * (R.T @ (D + D.T) @ R)
    AQ = np.swapaxes(Q @ A, 1, 2) + Q @ A
    top = np.concatenate([-AQ, corner], axis=2)
    bottom = np.concatenate([np.swapaxes(corner, 1, 2), resistance], axis=2)
    return StorageFamily(Q, np.concatenate([top, bottom], axis=1))


def _symmetric_units(n: int) -> RationalMatrix:
    units = np.full((n * (n + 1) // 2, n, n), fmpq(0), dtype=object)
    for number, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        units[number, i, j] = units[number, j, i] = fmpq(1)
    return units
