"""Initial solutions: impulsive-smooth distributions that start from any state (11.79)-(11.83)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, Matrix, Vector, check_type
from pricing_core.errors import InfeasibleError, InvalidInputError
from pricing_core.lcs.modes import as_mode
from pricing_core.lcs.polynomial_problem import (
    ModeSolution,
    PolynomialProblem,
    has_other_inputs,
    has_other_states,
    mode_solution,
    polynomial_problem,
)
from pricing_core.lcs.rational_complementarity import all_solutions, has_unique_input, has_unique_state
from pricing_core.lcs.system import LCS
from pricing_core.linalg.polynomials import RationalVector


@dataclass(frozen=True, slots=True, eq=False)
class InitialSolution:
    """(u, x, y) of Definition 11.2: u = impulses[0] delta + impulses[1] delta' + ... + a smooth function.

    Parameters
    ----------
    mode : tuple of int
        I, with y_i = 0 for i in I and u_i = 0 outside.
    x_before, x_after : Vector, shape (n,)
        x0, and x(0+), which is P_I x0 where P_I is defined and f, g are zero.
    impulses : Matrix, shape (order, k)
        Coefficients of delta, delta', ... in u; order 0 where u is smooth.
    unique_input : bool
        Whether u is the only one from x0, or in the mode that was asked for.
    input_transform, state_transform : RationalVector
        The Laplace transforms (11.82) and (11.81), in lowest terms.
    """

    mode: IndexSet
    x_before: Vector
    x_after: Vector
    impulses: Matrix
    unique_input: bool
    input_transform: RationalVector
    state_transform: RationalVector

    def smooth_input(self, t: float) -> Vector:
        """Return the smooth part of u at t >= 0, shape (k,), as long as the mode lasts."""
        return self.input_transform.smooth_part(t)

    def smooth_state(self, t: float) -> Vector:
        """Return the smooth part of x at t >= 0, shape (n,), as long as the mode lasts."""
        return self.state_transform.smooth_part(t)


def initial_solution(
    system: LCS, x0: ArrayLike, mode: Iterable[int] | None = None, *, t: float = 0.0
) -> InitialSolution:
    """Return the initial solution from x0: the jump, its impulses, and the smooth motion after it.

    Parameters
    ----------
    system : LCS
        The offsets f, g are taken as constant from t on.
    x0 : array_like, shape (n,)
    mode : iterable of int, optional
        An element of S(x0). Without it the first one is taken where all have the same state, k <= 12.
    t : float
        The time at which f(t+), g(t+) are taken.

    Raises
    ------
    InvalidInputError
        `mode` does not belong to S(x0), or is missing where the states differ; k > 12 without `mode`.
    InfeasibleError
        S(x0) is empty: proved, there is no admissible jump from x0.

    Notes
    -----
    Cost: with a mode one linear system over the rational functions, without it all of
    `rational_complementarity`. Source: (11.79)-(11.83), Definitions 11.1 and 11.2; Hautus and Silverman 1983.

    Examples
    --------
    The triple integrator y = x1 from (0, -1, 0) is stopped by u = delta':

    >>> system = LCS([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [0], [1]], [[1, 0, 0]])
    >>> start = initial_solution(system, [0, -1, 0])
    >>> start.mode, start.x_after, start.impulses.tolist()
    ((0,), array([0., 0., 0.]), [[0.0], [1.0]])
    """
    check_type("system", system, LCS)
    problem = polynomial_problem(system, x0, t)
    k = system.shape[1]
    solution, unique = _chosen(problem) if mode is None else _in_mode(problem, as_mode(mode, k))
    state, inputs = solution.state(problem).reduced(), solution.multiplier(problem).reduced()
    return InitialSolution(
        mode=solution.mode,
        x_before=problem.x0.astype(float),
        x_after=state.initial_value(),
        impulses=inputs.polynomial_part(),
        unique_input=unique,
        input_transform=inputs,
        state_transform=state,
    )


def _chosen(problem: PolynomialProblem) -> tuple[ModeSolution, bool]:
    solutions = all_solutions(problem)
    modes = tuple(solution.mode for solution in solutions)
    if not solutions:
        raise InfeasibleError("no mode has an initial solution from this state: S(x0) is empty")
    if not has_unique_state(problem, solutions):
        raise InvalidInputError("mode", None, f"one of S(x0) = {modes}: their states differ")
    return solutions[0], has_unique_input(solutions)


def _in_mode(problem: PolynomialProblem, mode: IndexSet) -> tuple[ModeSolution, bool]:
    solution = mode_solution(problem, mode)
    if solution is None:
        raise InvalidInputError("mode", mode, "an element of S(x0): see rational_complementarity(system, x0)")
    if has_other_states(solution, problem.system.B):
        raise InvalidInputError("mode", mode, "one in which the state is unique: G_II is singular here")
    return solution, not has_other_inputs(solution)
