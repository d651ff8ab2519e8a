"""Explicit projection: a linear step, and then max(V, payoff), which is not the complementarity problem's solution.

Common in finite difference codes. What is exercised inside a step is noticed at its end only: a splitting of
first order in the step, whatever the order of the linear step.
"""

from dataclasses import dataclass

import numpy as np

from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import OptionState, StageProblem, natural_residual
from pricing_core.arrays import Vector
from pricing_core.linalg import solve_tridiagonal


@dataclass(frozen=True, slots=True)
class ExplicitProjection:
    """In place of each complementarity problem a linear system, its solution lifted onto the payoff."""

    form: SegmentForm

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state at time to expiry t; its residual is that of the complementarity problem."""
        problem = StageProblem.of(self.form, t, base, h)
        z = projected(problem)
        w = problem.M.times(z) + problem.q  # h u, were it not for the splitting
        residual = natural_residual(z, w, self.form.scale)
        return OptionState(problem.obstacle + z, z, z == 0.0, np.maximum(w, 0.0) / h, residual)


def projected(problem: StageProblem) -> Vector:
    """Return max(z, 0) with M z + q = 0, as if there were no payoff to exercise for, z = v - g."""
    M = problem.M
    return np.maximum(solve_tridiagonal(M.lower[1:], M.diagonal, M.upper[:-1], -problem.q), 0.0)
