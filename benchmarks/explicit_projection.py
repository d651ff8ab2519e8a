"""Explicit projection: a linear step, and then max(V, payoff), which is not the complementarity problem's solution.

Common in finite difference codes. What is exercised inside a step is noticed at its end only: a splitting of
first order in the step, whatever the order of the linear step.
"""

from dataclasses import dataclass

import numpy as np

from pricing_core.american.flat.operators import ThreePointOperator
from pricing_core.american.flat.semidiscrete import ComplementarityForm
from pricing_core.american.flat.tridiagonal_step import OptionState, TridiagonalStage
from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP
from pricing_core.linalg import solve_tridiagonal


@dataclass(frozen=True, slots=True)
class ImplicitSystem:
    """One implicit stage as M v - rhs = h u, 0 <= u _|_ v - g >= 0, at the interior nodes."""

    M: ThreePointOperator  # I - h L
    rhs: Vector
    obstacle: Vector  # g

    @classmethod
    def of(cls, form: ComplementarityForm, tau: float, base: Vector, h: float) -> "ImplicitSystem":
        """Return the stage of size h that ends at time to expiry tau, from `base`."""
        constraint, L = form.constraint(tau, 1), form.operators.operator
        rhs = base.copy()
        rhs[0] += h * L.lower[0] * constraint.ends[0, 0]
        rhs[-1] += h * L.upper[-1] * constraint.ends[0, 1]
        M = ThreePointOperator(-h * L.lower, 1.0 - h * L.diagonal, -h * L.upper)
        return cls(M, rhs, constraint.obstacle[0, 1:-1])

    def complementarity_problem(self) -> LCP:
        """Return the problem for z = v - g: w = M z + (M g - rhs), 0 <= w _|_ z >= 0."""
        return LCP(self.M.matrix, self.M.times(self.obstacle) - self.rhs)

    def linear_solution(self) -> Vector:
        """Return v with M v = rhs, as if there were no payoff to exercise for."""
        return solve_tridiagonal(self.M.lower[1:], self.M.diagonal, self.M.upper[:-1], self.rhs)


@dataclass(frozen=True, slots=True, eq=False)
class ExplicitProjection(TridiagonalStage):
    """In place of each complementarity problem a linear system, its solution lifted onto the payoff."""

    def solve(self, t: float, base: Matrix, h: float, near: OptionState) -> OptionState:
        """Return the state at time to expiry t; its residual is that of the complementarity problem."""
        system = ImplicitSystem.of(self.form, t, base[0], h)
        value = np.maximum(system.linear_solution(), system.obstacle)
        slack = value - system.obstacle
        excess = system.M.times(value) - system.rhs  # h u, were it not for the splitting
        contact = (slack == 0.0) & (self.form.payoff[1:-1] > 0.0)
        residual = float(np.max(np.abs(np.minimum(slack, excess))))
        return OptionState(value[None, :], slack, contact, np.maximum(excess, 0.0) / h, residual)
