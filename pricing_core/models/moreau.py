"""Moreau's time stepping of mechanical systems: velocities and impulses, whatever happens inside a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, lu_factor, lu_solve

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP, Method, least_norm_solution, solve
from pricing_core.lcs.simulation_method import TimeStepping
from pricing_core.lcs.stepping_scheme import SMALLEST_STEP, THETA, stepped_trajectory
from pricing_core.lcs.time_stepping import LCSState, Multipliers
from pricing_core.lcs.trajectory import Trajectory
from pricing_core.stepping import StepDoubling, integrate
from pricing_core.stepping.method import Step

if TYPE_CHECKING:
    from pricing_core.models.mechanics import MechanicalSystem

REMEMBERED_STEP_SIZES = 16


class _Response(NamedTuple):
    """What a step of one size needs of the matrices."""

    factors: tuple[Matrix, NDArray[np.int32]]  # LU of M + theta h D + (theta h)^2 K
    by_impulse: Matrix  # velocities per impulse, (n, k)
    delassus: Matrix  # F by_impulse, (k, k)


@dataclass(frozen=True, slots=True)
class MoreauStep:
    """One step in terms of velocities and impulses (Moreau 1988; Jean 1999), of order 1, 2 where nothing touches.

    With v_theta = (1 - theta) v + theta v+ and q_theta, f_theta likewise,

        M (v+ - v) = h (f_theta - D v_theta - K q_theta) + F^T p,    q+ = q + h v_theta,
        0 <= F v+ + e min(F v, 0) _|_ p >= 0    for the constraints that the step would violate without p,

    so that an impact, and a whole sequence of them, may lie anywhere in the step. The positions are then projected, in
    the metric of M, on what the constraints allow; that may raise the energy by what vanishes with h.

    Parameters
    ----------
    motion : MechanicalSystem
    theta : float
        From 1/2 to 1.
    lcp_method, multipliers
        As in `TimeStepping`.
    """

    motion: MechanicalSystem
    theta: float
    lcp_method: Method
    multipliers: Multipliers
    _response: Callable[[float], _Response] = field(init=False, repr=False)
    _projector: tuple[Matrix, Matrix] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        remembered = lru_cache(REMEMBERED_STEP_SIZES)(partial(_response, self.motion, self.theta))
        object.__setattr__(self, "_response", remembered)
        by_force = cho_solve(cho_factor(self.motion.mass), self.motion.F.T)
        object.__setattr__(self, "_projector", (by_force, self.motion.F @ by_force))

    @property
    def order(self) -> int:
        """1: an impact lies anywhere in its step."""
        return 1

    def start(self, x: Vector) -> LCSState:
        """Return the state x = (q, v) without forces of contact, which the first step tells."""
        motion = self.motion
        q = x[: motion.mass.shape[0]]
        return LCSState(x, np.zeros(motion.offset.size), np.maximum(motion.F @ q + motion.offset, 0.0))

    def step(self, t: float, state: LCSState, h: float) -> Step[LCSState]:
        """Go from t to t + h; the error of the positions is what counts, for velocities jump."""
        motion, theta = self.motion, self.theta
        n, k = motion.mass.shape[0], motion.offset.size
        q, v = state.value[:n], state.value[n:]
        response = self._response(h)
        force = (1.0 - theta) * motion.force.after(t) + theta * motion.force.before(t + h)
        impetus = force - motion.damping @ v - motion.stiffness @ (q + theta * h * v)
        free = v + h * lu_solve(response.factors, impetus)
        impulse = self._impulse(response, (q, v), free, h) if k else np.zeros(0)
        end = free + response.by_impulse @ impulse
        place = self._projected(q + h * ((1.0 - theta) * v + theta * end))
        gap = np.maximum(motion.F @ place + motion.offset, 0.0)
        return Step(LCSState(np.concatenate([place, end]), impulse / h, gap), place)

    def _impulse(self, response: _Response, start: tuple[Vector, Vector], free: Vector, h: float) -> Vector:
        """Return p, shape (k,); constraints that the others push into are taken in until none is violated."""
        motion, theta = self.motion, self.theta
        (q, v), normals = start, motion.F
        gap = normals @ q + motion.offset
        impulse = np.zeros(gap.size)
        active = np.zeros(gap.size, dtype=bool)
        while True:
            end = free + response.by_impulse @ impulse
            touching = gap + h * (normals @ ((1.0 - theta) * v + theta * end)) <= 0.0
            if not (touching & ~active).any():
                return impulse
            active |= touching
            rows = np.flatnonzero(active)
            wanted = normals[rows] @ free + motion.restitution * np.minimum(normals[rows] @ v, 0.0)
            problem = LCP(response.delassus[np.ix_(rows, rows)], wanted)
            found = solve(problem, method=self.lcp_method).z
            impulse = np.zeros(gap.size)
            impulse[rows] = least_norm_solution(problem, found) if self.multipliers == "least-norm" else found

    def _projected(self, q: Vector) -> Vector:
        """Return the nearest positions, in the metric of M, that violate no constraint."""
        gap = self.motion.F @ q + self.motion.offset
        if not (gap < 0.0).any():
            return q
        by_force, delassus = self._projector
        return np.asarray(q + by_force @ solve(LCP(delassus, gap)).z)


def _response(motion: MechanicalSystem, theta: float, h: float) -> _Response:
    matrix = motion.mass + theta * h * motion.damping + (theta * h) ** 2 * motion.stiffness
    # lu_solve with several right-hand sides wakes BLAS threads even for small ones.
    by_impulse = np.asarray(np.linalg.solve(matrix, motion.F.T))
    return _Response(lu_factor(matrix), by_impulse, motion.F @ by_impulse)


def simulate_by_impulses(
    motion: MechanicalSystem,
    x0: Vector,
    t_span: tuple[float, float],
    t_eval: Vector | None,
    method: TimeStepping,
    interrupt: Callable[[], bool] | None,
) -> Trajectory:
    """Simulate by Moreau's time stepping from x0 = (q, v), shape (2n,); see `MechanicalSystem.simulate`."""
    theta = THETA if method.theta is None else method.theta
    one_step = MoreauStep(motion, theta, method.lcp_method, method.multipliers)
    run = integrate(
        one_step if method.step is not None else StepDoubling(one_step),
        one_step.start(x0),
        t_span,
        controller=method.controller(motion.mass.shape[0]),
        stop_times=[*motion.force.jumps, *(() if t_eval is None else t_eval)],
        smallest_h=SMALLEST_STEP * (t_span[1] - t_span[0]),
        force_smallest=True,
        interrupt=interrupt,
    )
    return stepped_trajectory(
        run.t.tolist(),
        run.states,
        t_eval,
        events=(),
        status=run.status,
        scheme="moreau",
        counts=(run.accepted, run.rejected, run.forced),
    )
