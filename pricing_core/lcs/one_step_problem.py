"""One implicit step of a linear complementarity system as a linear complementarity problem (11.65)."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor
from scipy.linalg.lapack import dgetrs

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import StepSizeError
from pricing_core.lcp import LCP
from pricing_core.lcs.system import LCS

NOTHING = 1e-13  # share of its terms below which a slack is rounding
MOST_PAIRS, MOST_MODES = 64, 256  # for which inverses are kept
WELL_CONDITIONED = 1e8  # block of M whose inverse is kept


@dataclass(frozen=True, eq=False)
class OneStepProblem:
    """The part of (11.65) that depends on h alone: x+ = R (base + h f) + h R B u with R = (I - hA)^-1.

    Then y = M u + q with M = D + h C R B = G(1/h), the transfer matrix, and q = C R (base + h f) + g.
    """

    system: LCS
    h: float
    M: Matrix  # (k, k)
    response: Matrix  # (n, k): h R B
    factors: tuple[Matrix, NDArray[np.int32]]  # the LU factors of I - hA
    _gains: dict[bytes, Matrix | None] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def sizes(self) -> Matrix:
        """|M|, shape (k, k)."""
        return np.abs(self.M)

    def free_state(self, base: Vector, t: float) -> Vector:
        """Return R (base + h f), the state without multipliers; f is the input just before t."""
        lu, pivots = self.factors
        return np.asarray(dgetrs(lu, pivots, base + self.h * self.system.f.before(t))[0])

    def multipliers_in(self, mode: NDArray[np.bool_], q: Vector) -> tuple[Vector, Vector] | None:
        """Return u and y where y vanishes in this mode and u elsewhere, None unless both are nonnegative then.

        That solves the problem with q, at the cost of two small products once the mode has been met.
        """
        if mode.size > MOST_PAIRS:
            return None
        key = mode.tobytes()
        if key not in self._gains:
            if len(self._gains) == MOST_MODES:
                self._gains.clear()
            self._gains[key] = self._gain(mode)
        gain = self._gains[key]
        if gain is None:
            return None
        u = gain @ q
        if (u < 0.0).any():
            return None
        y = self.M @ u + q
        rounding = NOTHING * (self.sizes @ u + np.abs(q))
        if (np.abs(y) > rounding)[mode].any():
            return None
        y[mode] = 0.0
        return None if (y < 0.0).any() else (u, y)

    def _gain(self, mode: NDArray[np.bool_]) -> Matrix | None:
        """Return the matrix from q to u in a mode, None where M_II is near to singular."""
        k = self.M.shape[0]
        gain, index = np.zeros((k, k)), np.flatnonzero(mode)
        if index.size:
            block = self.M[np.ix_(index, index)]
            if not np.linalg.cond(block) < WELL_CONDITIONED:
                return None
            gain[np.ix_(index, index)] = -np.linalg.inv(block)
        return gain

    def lcp(self, free_state: Vector, t: float) -> LCP:
        """Return the problem 0 <= y = M u + q _|_ u >= 0 at the step's end t."""
        return LCP(self.M, self.slack_without_multipliers(free_state, t))

    def slack_without_multipliers(self, free_state: Vector, t: float) -> Vector:
        """Return q = C R (base + h f) + g, shape (k,)."""
        return np.asarray(self.system.C @ free_state + self.system.g.before(t))


def one_step_problem(system: LCS, h: float) -> OneStepProblem:
    """Factor (I - hA) and form M = D + h C (I - hA)^-1 B.

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
