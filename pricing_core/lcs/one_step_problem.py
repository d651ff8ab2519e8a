"""One implicit step of a linear complementarity system as a linear complementarity problem (11.65)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor
from scipy.linalg.lapack import dgetrs

from pricing_core.arrays import Matrix, Vector, as_number, check_type
from pricing_core.errors import StepSizeError
from pricing_core.lcp import LCP
from pricing_core.lcs.system import LCS

MOST_ENTRIES, MOST_MODES = 128, 64  # of (x, u), and of modes, for which matrices are kept
PRODUCTS = 4  # by which a spectral radius is bounded
WELL_CONDITIONED = 1e4  # condition up to which an inverse stands for factors


@dataclass(frozen=True, eq=False)
class OneStepProblem:
    """The part of (11.65) that depends on h alone: x+ = R (base + h f) + h R B u with R = (I - hA)^-1.

    Then y = M u + q with M = D + h C R B = G(1/h), the transfer matrix, and q = C R (base + h f) + g.

    Parameters
    ----------
    system : LCS
    h : float
        Step size, in the unit of time of the system.
    M : Matrix, shape (k, k)
    response : Matrix, shape (n, k)
        h R B.
    factors : tuple
        The LU factors of I - hA, with their pivots, as `scipy.linalg.lu_factor` returns them.
    """

    system: LCS
    h: float
    M: Matrix  # (k, k)
    response: Matrix  # (n, k): h R B
    factors: tuple[Matrix, NDArray[np.int32]]  # the LU factors of I - hA
    _maps: dict[bytes, Matrix | None] = field(default_factory=dict, init=False, repr=False)

    def free_state(self, base: Vector, t: float) -> Vector:
        """Return R (base + h f), the state without multipliers; f is the input just before t."""
        lu, pivots = self.factors
        return np.asarray(dgetrs(lu, pivots, base + self.h * self.system.f.before(t))[0])

    def solved_in(
        self, mode: NDArray[np.bool_], base: Vector, t: float
    ) -> tuple[Vector, Vector, Vector] | None:
        """Return x, u and y at t where y vanishes in this mode and u elsewhere, None unless both are nonnegative then.

        Once the mode has been met that is one product: they are linear in base + h f and g. None as well where it
        would be less exact than the problem's own solution.
        """
        n, k = self.system.shape
        if n + k > MOST_ENTRIES:
            return None
        key = mode.tobytes()
        if key not in self._maps:
            if len(self._maps) == MOST_MODES:
                self._maps.clear()
            self._maps[key] = self._map(mode)
        known = self._maps[key]
        if known is None:
            return None
        found = known @ np.concatenate([base + self.h * self.system.f.before(t), self.system.g.before(t)])
        if k and found[n:].min() < 0.0:
            return None
        return found[:n], found[n : n + k], found[n + k :]

    @cached_property
    def _resolvent(self) -> Matrix | None:
        """R, shape (n, n), None where rounding would be felt in it."""
        matrix = np.eye(self.system.shape[0]) - self.h * self.system.A
        found = np.asarray(dgetrs(*self.factors, np.eye(len(matrix)))[0], dtype=np.float64)
        return found if _is_well_conditioned(matrix, found) else None

    def _map(self, mode: NDArray[np.bool_]) -> Matrix | None:
        """Return the matrix from (base + h f, g) to (x, u, y), None where rounding would be felt in it."""
        (n, k), index = self.system.shape, np.flatnonzero(mode)
        block = self.M[np.ix_(index, index)]
        resolvent = self._resolvent
        if resolvent is None:
            return None
        to_u = np.zeros((k, n + k))
        slack = np.hstack([self.system.C @ resolvent, np.eye(k)])
        if index.size:
            try:
                inverse = np.asarray(np.linalg.inv(block), dtype=np.float64)
            except np.linalg.LinAlgError:
                return None
            if not _is_well_conditioned(block, inverse):
                return None
            to_u[index] = -inverse @ slack[index]
        to_y = slack + self.M @ to_u
        to_y[index] = 0.0
        to_x = np.hstack([resolvent, np.zeros((n, k))]) + self.response @ to_u
        return np.vstack([to_x, to_u, to_y])

    def lcp(self, free_state: Vector, t: float) -> LCP:
        """Return the problem 0 <= y = M u + q _|_ u >= 0 at the step's end t.

        The vector `free_state` is the state without multipliers, shape (n,).
        """
        return LCP(self.M, self.slack_without_multipliers(free_state, t))

    def slack_without_multipliers(self, free_state: Vector, t: float) -> Vector:
        """Return q = C x + g(t), shape (k,), with x = R (base + h f), the state `free_state`."""
        return np.asarray(self.system.C @ free_state + self.system.g.before(t))


def one_step_problem(system: LCS, h: float) -> OneStepProblem:
    """Factor (I - hA) and form M = D + h C (I - hA)^-1 B.

    Parameters
    ----------
    system : LCS, with n states and k pairs
    h : float
        Step size, in the unit of time of the system.

    Raises
    ------
    StepSizeError
        1/h is an eigenvalue of A.

    Examples
    --------
    For x' = u, y = x the matrix is h itself, as G(s) = 1/s:

    >>> one_step_problem(LCS([[0.0]], [[1.0]], [[1.0]]), 0.25).M
    array([[0.25]])
    """
    check_type("system", system, LCS)
    h = as_number("h", h)
    matrix = np.eye(system.shape[0]) - h * system.A
    # lu_solve with several right-hand sides wakes BLAS threads even for 2 x 2: a millisecond on a busy machine.
    try:
        response = np.asarray(h * np.linalg.solve(matrix, system.B), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise StepSizeError(
            f"I - h A is singular for h = {h:g}: 1/h is an eigenvalue of A; take another step"
        ) from None
    factors = lu_factor(matrix)
    return OneStepProblem(system, h, system.D + system.C @ response, response, factors)


def _is_well_conditioned(matrix: Matrix, inverse: Matrix) -> bool:
    """Tell whether the spectral radius of |M^-1| |M| is moderate: it is the same in all units of rows and columns.

    For positive v it is at most the largest (P v)_i / v_i (Collatz), and close to that after a few products.
    """
    growth = np.abs(inverse) @ np.abs(matrix)
    v = np.ones(len(matrix))
    for _ in range(PRODUCTS):
        before, v = v, growth @ v
    return bool((v < WELL_CONDITIONED * before).all())
