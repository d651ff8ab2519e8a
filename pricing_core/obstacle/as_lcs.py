"""The obstacle problem at nodes as a linear complementarity system (11.62)-(11.64): the chapter's road.

Three-point differences in place of the compact scheme, and the right angle at every node in place of its average: after
the method of lines V' = L V + e + u - w, 0 <= u _|_ V - lower >= 0, 0 <= w _|_ upper - V >= 0, in the time to the
horizon tau = T - t. One implicit step of it is an LCP (11.65), which any method of `pricing_core.lcp` solves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import Vector, as_number, as_whole_number, check_choice, check_list, check_type
from pricing_core.errors import InvalidInputError, MissingInputError, Told
from pricing_core.lcp import (
    LCP,
    MixedLCP,
    solve_brennan_schwartz,
    solve_lemke,
    solve_policy_iteration,
    solve_psor,
)
from pricing_core.lcp import solve as solve_lcp
from pricing_core.lcs import LCS
from pricing_core.lcs.time_stepping import LCSState
from pricing_core.linalg.tridiagonal import Tridiagonal
from pricing_core.obstacle.grid import Grid, GridMap
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.moment import Moment, Segment
from pricing_core.obstacle.problem import ObstacleProblem, just_before
from pricing_core.stepping import IMPLICIT_EULER, DiagonallyImplicit, OneStepMethod, RannacherStart, Tableau

NodalSolver: TypeAlias = Literal["policy", "psor", "lemke", "brennan-schwartz"]
SOLVERS: dict[str, Callable[[LCP], Vector]] = {
    "policy": lambda problem: solve_policy_iteration(problem).z,
    "psor": lambda problem: solve_psor(problem).z,
    "lemke": lambda problem: solve_lemke(problem).z,
    "brennan-schwartz": lambda problem: solve_brennan_schwartz(problem, contact="first").z,
}


@dataclass(frozen=True, slots=True, eq=False)
class AsLCS:
    """The system of the nodal discretisation at one time.

    Parameters
    ----------
    system : LCS
        The state is (V_1, ..., V_n, 1) as in (11.64); with a lower obstacle u and V - lower are the first pairs, with
        an upper one w and upper - V the last.
    x : Vector, shape (n,)
        The inner nodes.
    x0 : Vector, shape (n + 1,)
        The state at the horizon: the payoff and 1.
    """

    system: LCS
    x: Vector
    x0: Vector


@dataclass(frozen=True, slots=True, eq=False)
class NodalStage:
    """Solves V = base + h (L V + e + u - w) at the inner nodes, with the coefficients of the stage's own moment.

    It solves the principal pivot transform of (11.65) that exchanges u and V - lower: its matrix, I - h L, is
    tridiagonal.

    Parameters
    ----------
    segment : Segment
        Time runs back from its end.
    lcp_method : {"policy", "psor", "lemke", "brennan-schwartz"}
        For one obstacle; with both it is `pricing_core.lcp.solve` for the mixed problem. The last is exact where the
        contact set is one run of nodes from the left end on, and refuses a problem in which it is not: such as that of
        a put whose obstacle is 0, and touched, at the far end.
    """

    segment: Segment
    lcp_method: NodalSolver = "policy"

    def __post_init__(self) -> None:
        check_choice("lcp_method", self.lcp_method, tuple(SOLVERS))

    def solve(self, t: float, base: Vector, h: float, near: LCSState) -> LCSState:
        """Return V as the state, with u or w and V - lower or upper - V, at the time `t` before the segment's end."""
        L, e, moment = _nodal(self.segment, self._time(t))
        M = L.plus_identity(1.0, -h)
        forced = base + h * e
        has_lower, has_upper = (obstacle is not None for obstacle in self.segment.acting)
        lower, upper = moment.contact.lower, moment.contact.upper
        if has_lower and has_upper:
            V = solve_lcp(MixedLCP(M, -forced, lower, upper)).z
            net = (M @ V - forced) / h
            return LCSState(
                V,
                np.concatenate([np.maximum(net, 0.0), np.maximum(-net, 0.0)]),
                np.concatenate([V - lower, upper - V]),
            )
        if not (has_lower or has_upper):
            return LCSState(M.solve(forced), np.zeros(0), np.zeros(0))
        sign, obstacle = (1.0, lower) if has_lower else (-1.0, upper)
        slack = SOLVERS[self.lcp_method](LCP(M, sign * (M @ obstacle - forced)))
        V = obstacle + sign * slack
        return LCSState(V, np.maximum(sign * (M @ V - forced) / h, 0.0), slack)

    def _time(self, t: float) -> float:
        """Return years from now; at the segment's end those just before it, where coefficients may jump."""
        return min(max(self.segment.end - t, self.segment.start), just_before(self.segment.end))

    def rate(self, t: float, state: LCSState) -> Vector:
        """Return L V + e + u - w."""
        L, e, _ = _nodal(self.segment, self._time(t))
        n, pushed = state.value.size, L @ state.value + e
        has_lower, has_upper = (obstacle is not None for obstacle in self.segment.acting)
        if has_lower:
            pushed = pushed + state.multiplier[:n]
        return pushed - state.multiplier[-n:] if has_upper else pushed


def as_lcs(
    problem: ObstacleProblem, nodes: int, interval: tuple[float, float] | None = None, time: float = 0.0
) -> AsLCS:
    """Return the linear complementarity system of the nodal discretisation between two events.

    Parameters
    ----------
    problem : ObstacleProblem
    nodes : int
        At least 3, the two ends not counted.
    interval : (float, float), optional
        The ends; that of the problem where it is left out, or one around the payoff's kinks.
    time : float
        Where coefficients depend on it, the system is that of this moment; the obstacles are those that act there.

    Raises
    ------
    MissingInputError
        There is no interval, nor a kink to put one around.
    """
    time = as_number("time", time)
    check_type("problem", problem, ObstacleProblem)
    if not 0.0 <= time <= problem.horizon:
        raise InvalidInputError("time", time, f"from 0 to the horizon, {problem.horizon:g}")
    segment = _segment(problem, nodes, interval, time)
    L, e, moment = _nodal(segment, time)
    n = L.diagonal.size
    A, top = np.zeros((n + 1, n + 1)), np.eye(n + 1, n)
    A[:n, :n], A[:n, n] = L.dense(), e
    B, C = [], []
    for obstacle, values, sign in zip(
        segment.acting, (moment.contact.lower, moment.contact.upper), (1.0, -1.0), strict=True
    ):
        if obstacle is not None:
            B.append(sign * top)
            C.append(sign * np.column_stack([np.eye(n), -values]))
    system = LCS(A, np.hstack([*B, np.zeros((n + 1, 0))]), np.vstack([*C, np.zeros((0, n + 1))]))
    x = segment.grid.x[1:-1]
    return AsLCS(system, x, np.append(problem.payoff(x, problem.horizon), 1.0))


def nodal_method(
    problem: ObstacleProblem,
    nodes: int,
    interval: tuple[float, float] | None = None,
    *,
    tableau: Tableau = IMPLICIT_EULER,
    damped_until: float = 0.0,
    lcp_method: NodalSolver = "policy",
) -> tuple[OneStepMethod[LCSState], LCSState, Vector]:
    """Return the one-step method of the nodal discretisation from the horizon back, its first state and the nodes.

    `pricing_core.stepping.integrate` steps it, whether coefficients depend on time or not.

    Parameters
    ----------
    problem : ObstacleProblem
        Without events, dates and windows that begin or end on the way.
    nodes, interval
        As for `as_lcs`.
    tableau : Tableau
    damped_until : float
        Steps that begin earlier, in years before the horizon, are two half steps of implicit Euler (Rannacher).
    lcp_method : {"policy", "psor", "lemke", "brennan-schwartz"}
        See `NodalStage`.
    """
    check_type("problem", problem, ObstacleProblem)
    check_type("tableau", tableau, Tableau)
    if problem.events or len(problem.segments) > 1:
        raise InvalidInputError(
            "problem", Told("one with events, dates or a window"), "without what happens on the way"
        )
    damped_until = as_number("damped_until", damped_until)
    segment = _segment(problem, nodes, interval, 0.0)
    stage = NodalStage(segment, lcp_method)
    method: OneStepMethod[LCSState] = DiagonallyImplicit(stage, tableau)
    if damped_until > 0.0:
        method = RannacherStart(method, DiagonallyImplicit(stage, IMPLICIT_EULER), damped_until)
    x = segment.grid.x[1:-1]
    payoff = problem.payoff(x, problem.horizon)
    contact = segment.at(just_before(segment.end)).contact
    slacks = [
        sign * (payoff - values)
        for obstacle, values, sign in zip(
            segment.acting, (contact.lower, contact.upper), (1.0, -1.0), strict=True
        )
        if obstacle is not None
    ]
    slack = np.concatenate([*slacks, np.zeros(0)])
    return method, LCSState(payoff, np.zeros(slack.size), slack), x


def _segment(
    problem: ObstacleProblem, nodes: int, interval: tuple[float, float] | None, time: float
) -> Segment:
    check_type("problem", problem, ObstacleProblem)
    count = as_whole_number("nodes", nodes, 3)
    if interval is None:
        left, right = problem.interval
        if left is None or right is None:
            kinks = problem.payoff.kinks_at(problem.horizon)
            if kinks.size == 0:
                raise MissingInputError("interval", "give it: the payoff has no kink to put one around")
            chosen = choose_map(problem, kinks)
            left, right = chosen.left, chosen.right
    else:
        check_list("interval", interval)
        if len(interval) != 2:
            raise InvalidInputError("interval", interval, "a pair: the left end, the right end")
        left, right = (as_number("interval", end) for end in interval)
        if not left < right:
            raise InvalidInputError("interval", interval, "a pair with left < right")
    grid = Grid.of(GridMap(left, right, count + 1), 1)
    start, end = next((pair for pair in problem.segments if pair[0] <= time), problem.segments[-1])
    return Segment(problem, grid, start, end)


def _nodal(segment: Segment, t: float) -> tuple[Tridiagonal, Vector, Moment]:
    """Return L and e at the inner nodes, the ends eliminated, at one time."""
    moment = segment.at(t)
    D, peclet = moment.scheme.diffusion, moment.scheme.peclet
    m = peclet * D  # in cells
    steep = np.abs(peclet) > 2.0
    if steep.any():  # exponential fitting (Il'in 1969) keeps the signs of an M-matrix
        half = 0.5 * np.abs(np.where(steep, peclet, 2.0))
        D = np.where(steep, D * half / np.tanh(half), D)
    bands = np.array([D - m / 2.0, -2.0 * D - moment.rate, D + m / 2.0])
    lower, diagonal, upper, left, right = moment.without_ends(bands)
    e = moment.source[1:-1].copy()
    e[0] += left * moment.left.value
    e[-1] += right * moment.right.value
    return Tridiagonal(lower, diagonal, upper), e, moment
