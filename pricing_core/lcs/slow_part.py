"""Stiff modes: what is left of the flow once its fast part has died out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur, solve_sylvester

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.mode_dynamics import ModeDynamics, longest_step

GAP = 30.0  # between the sizes of fast and slow eigenvalues
DAMPED = 1e-6  # damping of the fast ones, at the least
DEAD = 1e-15  # share of the coordinates
NOTHING = 1e-140  # in the form's units: a state so small has died out, and squares of it would underflow


@dataclass(frozen=True, slots=True, eq=False)
class SlowPart:
    """The invariant subspace of the eigenvalues that are not fast, and the dynamics on it.

    Parameters
    ----------
    dynamics : ModeDynamics
        The dynamics of the slow coordinates.
    take : Matrix, shape (d_slow, d)
        Coordinates to slow coordinates, along the fast subspace.
    back : Matrix, shape (d, d_slow)
    """

    dynamics: ModeDynamics
    take: Matrix
    back: Matrix

    def is_all_of(self, c: Vector) -> bool:
        """Tell whether the fast part of these coordinates is no more than rounding."""
        fast = c - self.back @ (self.take @ c)
        return float(np.linalg.norm(fast)) <= max(DEAD * float(np.linalg.norm(c)), NOTHING)


def slow_part(dynamics: ModeDynamics) -> SlowPart | None:
    """Split off the largest eigenvalues, in the left half plane, beyond the first gap of at least a factor 30.

    Where there is no such gap, but all are in the left half plane, nothing is left. Elsewhere None is returned: all
    eigenvalues set the step. Cost: one Schur form.

    Examples
    --------
    A fast and a slow decay, of which the slow one is left:

    >>> W, none = np.eye(2), np.zeros((0, 0, 2))
    >>> both = ModeDynamics((), np.eye(2), W, np.diag([-1e6, -1.0]), np.zeros((0, 2)), none, 2e-6)
    >>> slow_part(both).dynamics.rate, slow_part(both).dynamics.step
    (array([[-1.]]), 2.0)
    """
    threshold = _threshold(np.linalg.eigvals(dynamics.rate).astype(np.complex128))
    if threshold is None:
        return None
    triangular, Q, fast = schur(
        dynamics.rate, output="real", sort=lambda re, im: np.hypot(re, im) > threshold
    )
    slow_block = triangular[fast:, fast:]
    # Q [I, X; 0, I] takes the rate to diag(fast, slow).
    X = solve_sylvester(triangular[:fast, :fast], -slow_block, -triangular[:fast, fast:])
    back = Q @ np.vstack([X, np.eye(slow_block.shape[0])])
    orthonormal, R = np.linalg.qr(back)
    take = R @ Q[:, fast:].T
    rate = take @ dynamics.rate @ orthonormal
    slow = replace(
        dynamics,
        basis=dynamics.basis @ orthonormal,
        coordinates=take @ dynamics.coordinates,
        rate=rate,
        outputs=dynamics.outputs @ orthonormal,
        step=longest_step(rate),
    )
    return SlowPart(slow, take, orthonormal)


def _threshold(eigenvalues: NDArray[np.complex128]) -> float | None:
    """Return a size between the fast eigenvalues and the others, at the first gap from above; None without one."""
    order = np.argsort(-np.abs(eigenvalues))
    sizes = np.maximum(np.abs(eigenvalues[order]), np.finfo(float).tiny)
    for i in range(1, sizes.size + 1):
        following = sizes[i] if i < sizes.size else 0.0
        if sizes[i - 1] > GAP * following:
            fast = eigenvalues[order[:i]]
            decays = np.all(fast.real < -DAMPED * np.abs(fast))
            return float(np.sqrt(sizes[i - 1]) * np.sqrt(following)) if decays else None
    return None
