"""The flow of (11.25) while a set of constraints is active."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.geometry import mode_geometry
from pricing_core.lcs.system import LCS


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """(x, lambda) = basis c + point, c' = rate (c, 1), eta_I = multiplier (c, 1): the mode I of the LCS (11.25).

    On a boundary arc of a constraint of order p the slack and its first 2p - 1 derivatives vanish, which is the
    consistent space V_I (11.73); the flow is kept in coordinates of it, and cannot drift off.
    """

    mode: IndexSet
    basis: Matrix  # (2n, d)
    point: Vector  # (2n,)
    rate: Matrix  # (d, d + 1)
    multiplier: Matrix  # (|I|, d + 1)

    @property
    def size(self) -> int:
        """The dimension d of V_I."""
        return int(self.basis.shape[1])

    @property
    def speed(self) -> float:
        """The norm of the homogeneous rate."""
        return float(np.linalg.norm(self.rate[:, :-1], 2)) if self.size else 0.0

    @property
    def growth(self) -> float:
        """The largest rate at which a solution grows or decays."""
        rates = np.linalg.eigvals(self.rate[:, :-1]) if self.size else np.zeros(1)
        return float(np.max(np.abs(rates.real)))

    def transition(self, h: float) -> Matrix:
        """Return the matrix that takes (c(t), 1) to (c(t + h), 1), shape (d + 1, d + 1)."""
        return np.asarray(expm(h * np.vstack([self.rate, np.zeros(self.size + 1)])))

    def state(self, extended: Matrix) -> Matrix:
        """Return (x, lambda) from rows (c, 1), shape (..., 2n)."""
        return np.asarray(extended[..., :-1] @ self.basis.T + self.point)


def arc(system: LCS, mode: IndexSet) -> Arc | None:
    """Return the flow in a mode of (11.25), None where the mode does not determine its multiplier.

    Examples
    --------
    x' = -x + u, x >= 1, Q = 1: on the boundary x = lambda = 1 and eta = 2.

    >>> on = arc(LCS([[-1, 1], [1, 1]], [[0], [-1]], [[1, 0]], [[0]], g=[-1]), (0,))
    >>> on.size, on.point, on.multiplier
    (0, array([1., 1.]), array([[2.]]))
    """
    geometry = mode_geometry(system, mode, exact=False)
    if geometry.projection is None or geometry.feedback is None:
        return None
    point, held = geometry.particular, geometry.particular_input
    if point is None or held is None:
        return None
    V, F = geometry.consistent_space, geometry.feedback
    inputs = system.B[:, list(mode)]
    rate = V.T @ np.column_stack([(system.A + inputs @ F) @ V, system.A @ point + inputs @ held])
    return Arc(tuple(mode), V, point, rate, np.column_stack([F @ V, held]))
