"""The implicit stage of the semidiscrete option in O(N): the LCP of (11.65) after a full principal pivot.

The stage (I - hL) v = base + h e + h u, 0 <= u _|_ v - g >= 0, e what the ends of the grid contribute, is an LCP for u
with the dense matrix h (I - hL)^-1. Exchanging u and z = v - g gives M z + q = h u with the tridiagonal M = I - hL and
q = M g - base - h e: an M-matrix, so elimination solves it exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from pricing_core.american.engines.method_of_lines.operators import ThreePointOperator
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError
from pricing_core.kernel import brennan_schwartz, policy_iteration
from pricing_core.linalg import solve_tridiagonal

LCPMethod: TypeAlias = Literal["tridiagonal", "policy", "psor", "lemke"]
# Residual of an exact elimination, relative to v and the scale; measured.
NEGLIGIBLE = 1e-11
LIFT = 1e-14  # Lift of q for general solvers, relative to its largest entry; chosen just above rounding.
ROUNDING = 1e-14  # Wrong sign of a row that is rounding, relative to the row's terms; chosen.
PSOR_TOLERANCE = 1e-13  # Change in PSOR's last sweep, relative to the largest entry of q; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class OptionState:
    """One instant of the semidiscrete option at the N interior nodes, in units of the strike.

    Parameters
    ----------
    value : Vector, shape (N,)
    slack : Vector, shape (N,)
        z = v - g >= 0.
    contact : BoolVector, shape (N,)
        The nodes in the exercise region.
    multiplier : Vector, shape (N,)
        u >= 0.
    residual : float
        Natural residual of the LCP of the last stage, as an error of v (`StageProblem.measured`).
    continued : Vector, shape (N,), or None
        What L v gains next to an exercise boundary that lies inside a cell (`boundary_cell`), per year.
    """

    value: Vector
    slack: Vector
    contact: BoolVector
    multiplier: Vector
    residual: float
    continued: Vector | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StageProblem:
    """The complementarity problem of one stage: 0 <= z _|_ M z + q >= 0, v = obstacle + z."""

    M: ThreePointOperator
    q: Vector
    obstacle: Vector

    @classmethod
    def of(cls, form: SegmentForm, t: float, base: Vector, h: float) -> StageProblem:
        """Return the problem at time t, at the end of an implicit stage of size h from `base`."""
        operator, obstacle = form.operator, form.obstacle(t, form.grid.interior)
        M = implicit_matrix(operator, h)
        q = M.times(obstacle) - base - h * end_forcing(operator, form.ends(t))
        return cls(M, q, obstacle)

    def measured(self, z: Vector, w: Vector, scale: Vector) -> tuple[float, float]:
        """Return the natural residual of z and w over their rows' diagonal entries, by `scale`, and its rounding."""
        residual = natural_residual(z, w / self.M.diagonal, scale)
        return residual, NEGLIGIBLE * (float(np.max(z / scale)) + 1.0)


class OptionStage(Protocol):
    """An implicit stage of a semidiscrete option."""

    @property
    def form(self) -> SegmentForm:
        """The system it belongs to."""
        ...

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state t years before the segment's end, at the end of an implicit stage of size h from `base`."""
        ...


@dataclass(frozen=True, slots=True)
class UnconstrainedStage:
    """The stage of an option that may not be exercised: (I - hL) v = base + h e, one linear system."""

    form: SegmentForm

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state t years before the segment's end; it has no contact."""
        operator = self.form.at(t).operator
        M = implicit_matrix(operator, h)
        rhs = base + h * end_forcing(operator, self.form.ends(t))
        value = solve_tridiagonal(M.lower[1:], M.diagonal, M.upper[:-1], rhs)
        nothing = np.zeros(value.size)
        return OptionState(value, near.slack, nothing > 0.0, nothing, 0.0)


@dataclass(frozen=True, slots=True)
class TridiagonalStage:
    """Solves the stage by one tridiagonal LCP.

    Parameters
    ----------
    form : SegmentForm
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        One elimination where that is exact, else policy iteration; policy iteration; or one of the methods
        of `pricing_core.lcp`.
    """

    form: SegmentForm
    lcp_method: LCPMethod = "tridiagonal"

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state t years before the segment's end, at the end of an implicit stage of size h from `base`."""
        problem = StageProblem.of(self.form.at(t), t, base, h)
        solve = self._solve_by_library if self.lcp_method in ("psor", "lemke") else self._solve_directly
        z, w = solve(problem, near)
        residual, _ = problem.measured(z, w, self.form.scale)
        return OptionState(problem.obstacle + z, z, z == 0.0, np.maximum(w, 0.0) / h, residual)

    def _solve_directly(self, problem: StageProblem, near: OptionState) -> tuple[Vector, Vector]:
        """Return (z, w) from one elimination, exact for a region at one end, or from policy iteration.

        Where M is no M-matrix, because 1 + h rate < 0, both may miss: the residual tells, and counts as error.
        """
        M, q = problem.M, problem.q
        bands = M.lower[1:], M.diagonal, M.upper[:-1], q
        at_left, at_right = self.form.contact_at_ends().tolist()
        try:
            if self.lcp_method == "tridiagonal" and at_left != at_right:
                z = brennan_schwartz(*bands, at_left)
                w = M.times(z) + q
                residual, rounding = problem.measured(z, w, self.form.scale)
                if residual <= rounding:
                    return z, w
            z, _ = policy_iteration(*bands, ~near.contact, ROUNDING, q.size + 2)
        except ZeroDivisionError:
            raise NumericalError("a pivot is zero: take more time steps") from None
        return z, M.times(z) + q

    def _solve_by_library(self, problem: StageProblem, near: OptionState) -> tuple[Vector, Vector]:
        """Return (z, w) from a method of `pricing_core.lcp` for matrices of any kind."""
        from pricing_core.lcp import LCP, solve, solve_psor  # noqa: PLC0415  # slow to import

        # Far out z and w vanish together, rounding decides which of them is zero, and the library measures
        # every row on its own scale: q is lifted a little, which puts those rows in contact.
        M, q = problem.M, problem.q
        lifted = LCP(M.matrix, q + LIFT * np.max(np.abs(q)))
        if self.lcp_method == "psor":
            z = solve_psor(lifted, tolerance=PSOR_TOLERANCE, start=near.slack).z
        else:
            z = solve(lifted, method="lemke").z
        return z, M.times(z) + q


def start_state(form: SegmentForm, values: Vector) -> OptionState:
    """Return the state at the segment's end from the values at all nodes, shape (N + 2,)."""
    slack = values[1:-1] - form.obstacle(0.0, form.grid.interior)
    contact = (slack <= 0.0) & form.segment.exercisable
    return OptionState(values[1:-1], np.maximum(slack, 0.0), contact, np.zeros(slack.size), 0.0)


def implicit_matrix(operator: ThreePointOperator, h: float) -> ThreePointOperator:
    """Return I - hL."""
    return ThreePointOperator(-h * operator.lower, 1.0 - h * operator.diagonal, -h * operator.upper)


def end_forcing(operator: ThreePointOperator, ends: Vector) -> Vector:
    """Return e, what the values at the two ends contribute to L v at the unknowns, shape (N,)."""
    forcing = np.zeros(operator.diagonal.size)
    forcing[0] += operator.lower[0] * ends[0]
    forcing[-1] += operator.upper[-1] * ends[1]
    return forcing


def natural_residual(z: Vector, w: Vector, scale: Vector | float = 1.0) -> float:
    """Return max |min(z, w)|/scale: 0 where z solves the complementarity problem."""
    return float(np.max(np.abs(np.minimum(z, w)) / scale))
