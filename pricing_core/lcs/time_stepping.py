"""The implicit stage of a linear complementarity system, and its way onto the constraints at the start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InfeasibleError, NotFoundError, NumericalError
from pricing_core.lcp import LCP, LCPSolution, Method, least_norm_solution, solve
from pricing_core.lcs.one_step_problem import OneStepProblem, one_step_problem
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.system import LCS
from pricing_core.stepping import OneStepMethod, Step

Scheme: TypeAlias = Literal["implicit-euler", "sdirk2", "theta"]
ImpulseScheme: TypeAlias = Literal["moreau", "stewart-trinkle"]  # of mechanical systems
Multipliers: TypeAlias = Literal["any", "least-norm"]
REMEMBERED_STEP_SIZES = 16


@dataclass(frozen=True, slots=True, eq=False)
class LCSState:
    """State x, multiplier u and slack y at one instant.

    Parameters
    ----------
    value : Vector, shape (n,)
        x.
    multiplier, slack : Vector, shape (k,)
        u and y.
    """

    value: Vector  # x, (n,)
    multiplier: Vector  # (k,)
    slack: Vector  # (k,)


@dataclass(frozen=True, slots=True, eq=False)
class LCSStage:
    """Solves x = base + h (Ax + Bu + f), 0 <= y = Cx + Du + g _|_ u >= 0: the step (11.65).

    Factorisations of I - hA are kept for the last few step sizes.

    Parameters
    ----------
    system : LCS
    lcp_method : str
        Method of `pricing_core.lcp.solve` for the problem of each step.
    multipliers : {"any", "least-norm"}
        Which multiplier is taken where there are several.
    """

    system: LCS
    lcp_method: Method = "auto"
    multipliers: Multipliers = "any"
    _problems: dict[float, OneStepProblem] = field(default_factory=dict, init=False, repr=False)

    def solve(self, t: float, base: Vector, h: float, near: LCSState) -> LCSState:
        """Return the state at `t`; the mode of the state `near` is tried first.

        Raises
        ------
        NotFoundError, RayTerminationError, IterationLimitError
            The LCP of the step has no solution as it is rounded, or its solver found none.
        NumericalError
            The state overflows.
        """
        problem = self._problem(h)
        mode = near.multiplier > near.slack
        if self.lcp_method == "auto" and self.multipliers == "any":
            found = problem.solved_in(mode, base, t)
            if found is not None:
                check_size(found[0], t)
                return LCSState(*found)
        check_size(base, t)
        free = problem.free_state(base, t)
        check_size(free, t)
        posed = problem.lcp(free, t)
        solution = solved_at(t, posed, self.lcp_method, mode)
        u = solution.z
        if self.multipliers == "least-norm":
            u = least_norm_solution(posed, u)
        return LCSState(free + problem.response @ u, u, problem.M @ u + posed.q)

    def rate(self, t: float, state: LCSState) -> Vector:
        """Return x' = Ax + Bu + f just after t, with x and u of `state`."""
        system = self.system
        return np.asarray(system.A @ state.value + system.B @ state.multiplier + system.f.after(t))

    def _problem(self, h: float) -> OneStepProblem:
        if h not in self._problems:
            if len(self._problems) == REMEMBERED_STEP_SIZES:
                del self._problems[next(iter(self._problems))]
            self._problems[h] = one_step_problem(self.system, h)
        return self._problems[h]


def solved_at(
    t: float, problem: LCP, method: Method = "auto", start: BoolVector | None = None
) -> LCPSolution:
    """Return a solution of the problem of the step to t.

    Raises
    ------
    NotFoundError
        The problem has none: that is proved of its rounded numbers, not of the system.
    """
    try:
        return solve(problem, method=method, start=start)
    except InfeasibleError as error:
        raise NotFoundError(
            f"the step to t = {t:.12g} has no solution, as its numbers are rounded: {error}"
        ) from error


@dataclass(frozen=True, slots=True)
class SwitchControl:
    """Adds to a method's error estimate what a switch of mode at an unknown time inside the step may cost.

    Where {i: u_i > y_i} differs between the ends of a step, the rate changed with u, for x' = Ax + Bu + f by
    B (u_end - u_start), at some time in it. The time is unknown by up to h, and x by h times that change. Step
    doubling does not see that: the whole step and its two halves may all end on y = 0 exactly.

    A switch is located to within `resolution` and no closer, so that h falls no lower on its account.
    """

    method: OneStepMethod[LCSState]
    change_of_rate: Callable[[LCSState, LCSState], Vector]  # due to u, from the first state to the second
    resolution: float  # in the units of t

    @property
    def order(self) -> int:
        """The order of the underlying method."""
        return self.method.order

    def step(self, t: float, state: LCSState, h: float) -> Step[LCSState]:
        """Go from t to t + h."""
        step = self.method.step(t, state, h)
        before, after = state.multiplier > state.slack, step.state.multiplier > step.state.slack
        if step.error is None or h <= self.resolution or np.array_equal(before, after):
            return step
        change = self.change_of_rate(state, step.state)
        return Step(step.state, step.value, np.abs(step.error) + h * np.abs(change))


def continue_from(system: LCS, x: Vector, t: float, tolerance: float) -> LCSState | None:
    """Return the state at t+ with x unchanged where 0 <= y = Cx + Du + g _|_ u >= 0 has a solution, else None.

    None means that x must jump. Slacks down to -tolerance count as zero.
    """
    q = system.C @ x + system.g.after(t)
    q = np.where(np.abs(q) <= tolerance, 0.0, q)
    try:
        solution = solve(LCP(system.D, q))
    except NumericalError:
        return None
    return LCSState(x, solution.z, solution.w)


def jump(system: LCS, x: Vector, t: float, h: float) -> LCSState:
    """Return the state after the jump at t, one implicit Euler step of a very small h: u is impulse / h.

    Raises
    ------
    NotFoundError
        The step has no solution, as its numbers are rounded.
    """
    problem = one_step_problem(system, h)
    base = x + h * (system.f.after(t) - system.f.before(t))
    free = problem.free_state(base, t)
    q = system.C @ free + system.g.after(t)
    solution = solved_at(t, LCP(problem.M, q))
    return LCSState(free + problem.response @ solution.z, solution.z, solution.w)
