"""The implicit stage of the semidiscrete option in O(N): the LCP of (11.65) after a full principal pivot.

The stage (I - hL) v = base + h e + h u, 0 <= u _|_ v - g >= 0 is an LCP for u with the dense matrix h (I -
hL)^-1. Exchanging u and z = v - g gives M z + q = h u with the tridiagonal M = I - hL and q = M g - base - h
e: an M-matrix, so elimination solves it exactly.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from pricing_core.american.flat.operators import ThreePointOperator
from pricing_core.american.flat.semidiscrete import ComplementarityForm, SemidiscreteForm
from pricing_core.american.flat.tangents import parameter_source, solve_tangents
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.kernel import brennan_schwartz, policy_iteration
from pricing_core.linalg import solve_tridiagonal

LCPMethod: TypeAlias = Literal["tridiagonal", "policy", "psor", "lemke"]
NEGLIGIBLE = 1e-13  # residual of an exact elimination, relative to the largest diagonal entry times v
LIFT = 1e-14  # of q, relative to its largest entry
ROUNDING = 1e-14  # a wrong sign in a row, relative to the row's terms
PSOR_TOLERANCE = 1e-13  # change in the last sweep, relative to the largest entry of q


@dataclass(frozen=True, slots=True, eq=False)
class OptionState:
    """One instant of the semidiscrete option at the N interior nodes.

    Parameters
    ----------
    value : Matrix, shape (m, N)
        Row 0: v or p; rows 1-3, where present: derivatives by volatility, rate and yield.
    slack : Vector, shape (N,)
        z = v - g >= 0.
    contact : BoolVector, shape (N,)
        The nodes in the exercise region: z = 0 where the payoff is positive. (Far out of the money z
        underflows to 0 as well.)
    multiplier : Vector, shape (N,)
        u >= 0.
    residual : float
        Natural residual of the LCP of the last stage.
    """

    value: Matrix
    slack: Vector
    contact: BoolVector
    multiplier: Vector
    residual: float


def start_state(form: SemidiscreteForm, *, tangents: bool = False) -> OptionState:
    """Return the state at expiry."""
    value = form.start(4 if tangents else 1)
    nothing = np.zeros(value.shape[1])
    return OptionState(value, nothing, nothing > 0.0, nothing, 0.0)


class OptionStage(Protocol):
    """An implicit stage of a semidiscrete option."""

    @property
    def form(self) -> ComplementarityForm:
        """The system it belongs to."""
        ...

    def solve(self, t: float, base: Matrix, h: float, near: OptionState) -> OptionState:
        """Return the state at time to expiry t, at the end of an implicit stage of size h from `base`."""
        ...


@dataclass(frozen=True, slots=True)
class UnconstrainedStage:
    """The stage of an option that may not be exercised: (I - hL) v = base + h e, one linear system."""

    form: ComplementarityForm

    def solve(self, t: float, base: Matrix, h: float, near: OptionState) -> OptionState:
        """Return the state at time to expiry t; it has no contact, and carries no tangents."""
        operator = self.form.operators.operator
        rhs = base[0] + h * end_forcing(operator, self.form.constraint(t, 1).ends[0])
        value = solve_tridiagonal(
            -h * operator.lower[1:], 1.0 - h * operator.diagonal, -h * operator.upper[:-1], rhs
        )
        nothing = np.zeros(value.size)
        return OptionState(value[None, :], near.slack, nothing > 0.0, nothing, 0.0)


@dataclass(frozen=True, slots=True)
class TridiagonalStage:
    """Solves the stage by one tridiagonal LCP; the tangents by linear solves with its contact set frozen.

    Parameters
    ----------
    form : ComplementarityForm
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        One elimination where that is exact, else policy iteration; policy iteration; or one of the methods
        of `pricing_core.lcp`.
    """

    form: ComplementarityForm
    lcp_method: LCPMethod = "tridiagonal"

    def solve(self, t: float, base: Matrix, h: float, near: OptionState) -> OptionState:
        """Return the state at time to expiry t, at the end of an implicit stage of size h from `base`."""
        constraint = self.form.constraint(t, base.shape[0])
        operator = self.form.operators.operator
        M = ThreePointOperator(-h * operator.lower, 1.0 - h * operator.diagonal, -h * operator.upper)
        obstacle = constraint.obstacle[0, 1:-1]
        q = M.times(obstacle) - base[0] - h * end_forcing(operator, constraint.ends[0])
        solve = self._solve_by_library if self.lcp_method in ("psor", "lemke") else self._solve_directly
        z, w = solve(M, q, near)
        value = obstacle + z
        contact = (z == 0.0) & (self.form.payoff[1:-1] > 0.0)
        if base.shape[0] > 1:
            everywhere = np.concatenate([constraint.ends[0, :1], value, constraint.ends[0, 1:]])
            source = parameter_source(self.form.operators, everywhere)
            forcing = np.stack([end_forcing(operator, ends) for ends in constraint.ends[1:]])
            rhs = base[1:] + h * (source + forcing)
            value = np.vstack([value, solve_tangents(M, rhs, constraint.obstacle[1:, 1:-1], z, contact)])
        residual = natural_residual(z, w, self.form.scale)
        return OptionState(np.atleast_2d(value), z, contact, np.maximum(w, 0.0) / h, residual)

    def _solve_directly(self, M: ThreePointOperator, q: Vector, near: OptionState) -> tuple[Vector, Vector]:
        """Return (z, w) from one elimination, exact for a region at one end, or from policy iteration.

        Where M is no M-matrix, because 1 + h rate < 0, both may miss: the residual tells, and counts as error.
        """
        domain = self.form.domain
        bands = M.lower[1:], M.diagonal, M.upper[:-1], q
        try:
            if self.lcp_method == "tridiagonal" and domain.contact_at_left != domain.contact_at_right:
                z = brennan_schwartz(*bands, domain.contact_at_left)
                w = M.times(z) + q
                if natural_residual(z, w) <= NEGLIGIBLE * float(np.max(M.diagonal)) * (
                    float(np.max(z)) + 1.0
                ):
                    return z, w
            z, _ = policy_iteration(*bands, ~near.contact, ROUNDING, q.size + 2)
        except ZeroDivisionError:
            raise NumericalError("a pivot is zero: take more time steps") from None
        return z, M.times(z) + q

    def _solve_by_library(self, M: ThreePointOperator, q: Vector, near: OptionState) -> tuple[Vector, Vector]:
        """Return (z, w) from a method of `pricing_core.lcp` for matrices of any kind."""
        from pricing_core.lcp import LCP, solve, solve_psor  # noqa: PLC0415  # slow to import

        # Far out z and w fade away together, rounding decides which of them is zero, and the library judges
        # every row on its own scale: q is lifted a little, which puts those rows in contact.
        problem = LCP(M.matrix, q + LIFT * np.max(np.abs(q)))
        if self.lcp_method == "psor":
            z = solve_psor(problem, tolerance=PSOR_TOLERANCE, start=near.slack).z
        else:
            z = solve(problem, method="lemke").z
        return z, M.times(z) + q


def end_forcing(operator: ThreePointOperator, ends: Vector) -> Vector:
    """Return e, what the values at the two ends contribute to L v at the unknowns, shape (N,)."""
    forcing = np.zeros(operator.diagonal.size)
    forcing[0] += operator.lower[0] * ends[0]
    forcing[-1] += operator.upper[-1] * ends[1]
    return forcing


def natural_residual(z: Vector, w: Vector, scale: Vector | float = 1.0) -> float:
    """Return max |min(z, w)|/scale: 0 where z solves the complementarity problem."""
    return float(np.max(np.abs(np.minimum(z, w)) / scale))
