"""One implicit step of a linear complementarity system as a linear complementarity problem (11.65)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import StepSizeError
from pricing_core.lcp import LCP
from pricing_core.lcs.system import LCS


@dataclass(frozen=True, slots=True, eq=False)
class OneStepProblem:
    """The part of (11.65) that depends on h alone: x+ = R (base + h f) + h R B u with R = (I - hA)^-1.

    Then y = M u + q with M = D + h C R B = G(1/h), the transfer matrix, and q = C R (base + h f) + g.
    """

    system: LCS
    h: float
    M: Matrix  # (k, k)
    response: Matrix  # (n, k): h R B
    factors: tuple[Matrix, NDArray[np.int32]]  # the LU factors of I - hA

    def free_state(self, base: Vector, t: float) -> Vector:
        """Return R (base + h f), the state without multipliers; f is the input just before t."""
        return np.asarray(lu_solve(self.factors, base + self.h * self.system.f.before(t)))

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
