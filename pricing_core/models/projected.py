"""Projected dynamical systems (section 11.2.6): the motion -F(x), kept inside a closed convex set."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, Matrix, Vector, as_square_matrix, as_values, as_vector
from pricing_core.errors import InvalidInputError, NotFoundError, Told
from pricing_core.lcs import LCS, TimeStepping, Trajectory, simulate
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.simulation_method import SimulationMethod, as_method, check_unused
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.models.convex_set import (
    ConvexSet,
    MatrixFunction,
    Polyhedron,
    SmoothSet,
    VectorFunction,
    active_set,
    check_inside,
)
from pricing_core.models.equilibrium import Equilibrium, solve_affine, solve_smooth
from pricing_core.models.projected_heun import ControlledHeun, ProjectedHeun
from pricing_core.models.tangent_cone import ProjectedVelocity, project_velocity
from pricing_core.models.trajectory import ModelTrajectory, Pieces, Switch, of_lcs
from pricing_core.stepping import StepDoubling, integrate

ROUNDING = 1e-12  # velocity, of 1, that is none

AffineMap: TypeAlias = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedSystem:
    """x' = pi(x, -F(x)): the projection of -F(x) on the tangent cone of K at x (11.39).

    Parameters
    ----------
    F : (matrix, vector), or callable
        F(x) = matrix x + vector, or a function from (n,) to (n,).
    H, h : array_like, shapes (k, n) and (k,)
        K = {x | H x >= h}.
    constraints : callable, optional
        Instead of H and h: from (n,) to (k,), concave and differentiable, K = {x | constraints(x) >= 0}.
    constraint_gradients : callable, optional
        Their gradients as rows, (k, n); central differences where missing.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit; both or neither of H, h and constraints.
    InfeasibleError
        {x | H x >= h} is empty, with the combination of rows that proves it.

    Examples
    --------
    F(x) = x - (-1, -2) on the positive quadrant: x1 arrives at ln 2, x2 at ln 1.5.

    >>> system = ProjectedSystem((np.eye(2), [1, 2]), np.eye(2), [0, 0])
    >>> run = system.simulate([1, 1], (0, 1))
    >>> [round(event.time, 12) for event in run.events], run.u[-1].round(12)
    ([0.405465108108, 0.69314718056], array([1., 2.]))
    >>> system.equilibrium().x
    array([0., 0.])
    """

    F: Callable[[Vector], Vector]
    K: ConvexSet
    affine: tuple[Matrix, Vector] | None

    def __init__(
        self,
        F: AffineMap | VectorFunction,
        H: ArrayLike | None = None,
        h: ArrayLike | None = None,
        *,
        constraints: VectorFunction | None = None,
        constraint_gradients: MatrixFunction | None = None,
    ) -> None:
        if (constraints is None) == (H is None) or (H is None) != (h is None):
            raise InvalidInputError("H", H, "given together with h, and only where there are no constraints=")
        if constraint_gradients is not None and constraints is None:
            raise InvalidInputError(
                "constraint_gradients",
                Told("a function"),
                "left out with H and h, whose rows are the gradients",
            )
        K: ConvexSet
        if constraints is not None:
            K = SmoothSet(constraints, constraint_gradients)
        else:
            assert H is not None
            assert h is not None
            K = Polyhedron(H, h)
        object.__setattr__(self, "K", K)
        affine = None if callable(F) else _affine(F)
        object.__setattr__(self, "affine", affine)
        if affine is not None and isinstance(K, Polyhedron) and K.H.shape[1] != affine[1].size:
            raise InvalidInputError("H", f"{K.H.shape[1]} columns", f"{affine[1].size} columns, as F has")
        object.__setattr__(self, "F", F if affine is None else lambda x: affine[0] @ x + affine[1])

    def velocity(self, x: ArrayLike) -> ProjectedVelocity:
        """Return pi(x, -F(x)) and the multipliers u of all constraints, by the LCP (11.43).

        Examples
        --------
        >>> ProjectedSystem((np.eye(2), [1, 2]), np.eye(2), [0, 0]).velocity([0, 1])
        ProjectedVelocity(v=array([ 0., -3.]), u=array([1., 0.]))
        """
        at = self._point("x", x)
        check_inside("x", self.K, at)
        active, H = active_set(self.K, at), self.K.gradients(at)
        v, u = project_velocity(H[active], -self._rate(at))
        multipliers = np.zeros(len(H))
        multipliers[active] = u
        return ProjectedVelocity(v, multipliers)

    def inward_normals(self, x: ArrayLike) -> Matrix:
        """Return the unit normals that generate the cone of inward normals at x (11.40), none inside K, as rows."""
        at = self._point("x", x)
        normals = self.K.gradients(at)[active_set(self.K, at)]
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        restricts = lengths[:, 0] > 0.0  # a row of zeros, 0 >= 0, has no normal
        return np.asarray(normals[restricts] / lengths[restricts])

    def projection(self, x: ArrayLike) -> Vector:
        """Return P(x), the point of K that is nearest to x (11.37)."""
        return self.K.project(self._point("x", x))

    def to_lcs(self) -> LCS:
        """Return (11.44): x' = -F(x) + H^T u, y = H x - h, 0 <= y _|_ u >= 0, for affine F and a polyhedron.

        Raises
        ------
        InvalidInputError
            F or the constraints are functions.
        """
        if self.affine is None or not isinstance(self.K, Polyhedron):
            raise InvalidInputError("F", self.F, "(matrix, vector), with H and h, where an LCS is asked for")
        matrix, vector = self.affine
        return LCS(-matrix, self.K.H.T, self.K.H, f=-vector, g=-self.K.h)

    def simulate(
        self,
        x0: ArrayLike,
        t_span: tuple[float, float],
        *,
        method: SimulationMethod | Literal["auto"] = "auto",
        t_eval: ArrayLike | None = None,
    ) -> ModelTrajectory:
        """Simulate from x0 in K over t_span.

        Parameters
        ----------
        x0 : array_like, shape (n,)
        t_span : (float, float)
        method : {"auto", "event-driven", "time-stepping"}, EventDriven or TimeStepping
            "event-driven" simulates (11.44) exactly, for affine F and polyhedra, and is what "auto" takes for these;
            the state is unique and does not jump, so that max_events alone may be given. "time-stepping" takes steps of
            `ProjectedHeun`, of a constant size or to a tolerance on the error at the end, in which the errors of all
            steps count together; motions that F drives apart multiply it. The other fields of `TimeStepping` are left
            out.
        t_eval : array_like, optional
            Times to report, increasing.

        Returns
        -------
        ModelTrajectory
            u are the multipliers, y the slacks h(x); a constraint is on piece 1 while it is active, else on piece 0.

        Raises
        ------
        InvalidInputError
            x0 is outside K, with the constraint that says so; a method, or a field of it, that does not fit.
        StepSizeError
            The tolerance could not be met.
        """
        start = self._point("x0", x0)
        check_inside("x0", self.K, start)
        exact = self.affine is not None and isinstance(self.K, Polyhedron)
        if isinstance(method, str) and method == "auto":
            method = "event-driven" if exact else "time-stepping"
        chosen = as_method(method)
        if isinstance(chosen, TimeStepping):
            check_unused(chosen, ("scheme", "lcp_method", "multipliers"), "a projected system")
            return self._simulate_by_steps(start, t_span, t_eval, chosen)
        check_unused(chosen, ("on_nonunique", "rebound"), "a projected system")
        # The state is unique (11.39), whatever the multipliers.
        chosen = replace(chosen, on_nonunique="first")
        try:
            run = simulate(self.to_lcs(), start, t_span, method=chosen, t_eval=t_eval)
        except NotFoundError:
            if not self._is_a_point(start):
                raise
            whole = TimeStepping(step=float(np.subtract(*checked_span(t_span)[::-1])))
            return replace(self._simulate_by_steps(start, t_span, t_eval, whole), unique=True)
        return of_lcs(run, ActiveConstraints(run.y.shape[1]), True)

    def equilibrium(self, start: ArrayLike | None = None) -> Equilibrium:
        """Return a stationary point: a solution of the variational inequality (11.36), checked.

        Parameters
        ----------
        start : array_like, shape (n,), optional
            Where Newton's method starts, for functions F or constraints; needed there.

        Raises
        ------
        InvalidInputError
            No start where one is needed.
        InfeasibleError, RayTerminationError, IterationLimitError, NumericalError
            There is no equilibrium, or none was found.
        """
        if self.affine is not None and isinstance(self.K, Polyhedron):
            return solve_affine(*self.affine, self.K)
        if start is None:
            raise InvalidInputError(
                "start", start, "a point near the equilibrium, where F or K is a function"
            )
        return solve_smooth(self._rate, self.K, self._point("start", start))

    def _point(self, field: str, x: ArrayLike) -> Vector:
        """Return x as a vector of as many numbers as F or H takes."""
        if self.affine is not None:
            return as_vector(field, x, self.affine[1].size)
        if isinstance(self.K, Polyhedron):
            return as_vector(field, x, self.K.H.shape[1])
        point = as_vector(field, x)
        if point.size == 0:
            raise InvalidInputError(field, x, "one number or more")
        return point

    def _rate(self, x: Vector) -> Vector:
        return as_values("F(x)", self.F(x), (x.size,))

    def _is_a_point(self, x: Vector) -> bool:
        """Tell whether K is x alone: no direction, of those along the axes and against, has a part inside K."""
        H = self.K.gradients(x)[active_set(self.K, x)]
        axes = np.eye(x.size)
        return all(float(np.abs(project_velocity(H, way).v).max()) <= ROUNDING for way in (*axes, *-axes))

    def _simulate_by_steps(
        self, x0: Vector, t_span: tuple[float, float], t_eval: ArrayLike | None, method: TimeStepping
    ) -> ModelTrajectory:
        span = checked_span(t_span)
        wanted = None if t_eval is None else checked_times(t_eval, span)
        heun = ProjectedHeun(self._rate, self.K)
        with np.errstate(over="ignore", invalid="ignore"):  # told by `as_values` and `check_size`
            run = integrate(
                ControlledHeun(StepDoubling(heun), span[1] - span[0]) if method.step is None else heun,
                self.K.project(x0),
                span,
                controller=method.controller(x0.size),
                stop_times=[] if wanted is None else wanted.tolist(),
            )
        x = np.array(run.states)
        u = np.array([self.velocity(state).u for state in run.states])
        y = np.array([self.K.slack(state) for state in run.states])
        active = ActiveConstraints(u.shape[1])
        pieces = [active.of_mode(tuple(active_set(self.K, state))) for state in run.states]
        switches = tuple(
            Switch(float(run.t[i + 1]), before, after)
            for i, (before, after) in enumerate(itertools.pairwise(pieces))
            if before != after
        )
        rows = slice(None) if wanted is None else np.searchsorted(run.t, wanted)
        steps = Trajectory(
            t=run.t,
            x=x,
            u=u,
            y=y,
            events=(),
            status=run.status,
            scheme="projected-heun",
            accepted=run.accepted,
            rejected=run.rejected,
            forced=run.forced,
        )
        return ModelTrajectory(
            run.t[rows], x[rows], u[rows], y[rows], switches, steps, (), None, active.external
        )


@dataclass(frozen=True, slots=True)
class ActiveConstraints:
    """The run of a complementarity system whose inputs and outputs are those of the model."""

    count: int  # of constraints

    def external(self, _x: Matrix, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
        """Return u and y as they are."""
        return u, y

    def pieces(self, flows: tuple[Flow, ...]) -> list[Pieces]:
        """Return 1 for the active constraints of each flow, and 0 for the others."""
        return [self.of_mode(flow.mode) for flow in flows]

    def of_mode(self, mode: IndexSet) -> Pieces:
        """Return 1 for the members of a mode, and 0 for the others."""
        return tuple(int(i in mode) for i in range(self.count))


def _affine(F: object) -> tuple[Matrix, Vector]:
    if not isinstance(F, tuple | list) or len(F) != 2:
        raise InvalidInputError("F", F, "a pair (matrix, vector), or a function")
    matrix = as_square_matrix("F[0]", F[0])
    return matrix, as_vector("F[1]", F[1], len(matrix))
