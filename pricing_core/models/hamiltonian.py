"""Hamiltonian systems with unilateral constraints (11.7)-(11.8), stepped at velocity level."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import (
    BoolVector,
    Matrix,
    Vector,
    as_array,
    as_pair,
    as_share,
    as_values,
    as_vector,
    as_whole_number,
    check_callable,
)
from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcp import LCP, solve
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.simulation_times import checked_span

Function: TypeAlias = Callable[[Vector], ArrayLike]
Energy: TypeAlias = Callable[[Vector, Vector], float]
Gradient: TypeAlias = Callable[[Vector, Vector], tuple[ArrayLike, ArrayLike]]

MOST_STEPS = 1_000_000
MOST_ITERATIONS = 50
SETTLED = 1e-13  # last change of Newton's method, as a share of the state
DIFFERENCE = 1e-7  # step of derivatives by differences, as a share of the state


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianTrajectory:
    """What `HamiltonianSystem.simulate` returns.

    Parameters
    ----------
    t : Vector, shape (m,)
    q, p : Matrix, shape (m, n)
    impulses : Matrix, shape (m, k)
        Impulses of the step that ends there: h u where a contact lasts.
    gaps : Matrix, shape (m, k)
        C(q).
    energy : Vector, shape (m,)
        H(q, p).
    """

    t: Vector
    q: Matrix
    p: Matrix
    impulses: Matrix
    gaps: Matrix
    energy: Vector


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianSystem:
    """q' = H_p, p' = -H_q + C_q^T u, 0 <= C(q) _|_ u >= 0 (11.7)-(11.8), with impacts.

    Every step solves the discrete gradient equations (Gonzalez 1996), which keep H exactly while nothing touches, with
    the law of impact as an LCP for the contacts that the step would close: C_q v+ >= -e C_q v-, with equality where
    there is an impulse (Moreau 1988). With e <= 1 impacts and contacts add no energy for a constant mass; otherwise no
    more than the square of the step. The constraints hold to the order of the step.

    Parameters
    ----------
    energy : callable (q, p) -> float
        H.
    gradient : callable (q, p) -> (H_q, H_p), shapes (n,) and (n,)
    constraints : callable q -> C(q), shape (k,)
    constraint_jacobian : callable q -> C_q, shape (k, n)
    restitution : float
        e, from 0 to 1.

    Examples
    --------
    A ball of mass 1 falls on the floor and stays there; before, its energy does not change:

    >>> ball = HamiltonianSystem(
    ...     energy=lambda q, p: 0.5 * p @ p + 9.81 * q[0],
    ...     gradient=lambda q, p: (np.array([9.81]), p),
    ...     constraints=lambda q: q,
    ...     constraint_jacobian=lambda q: np.eye(1),
    ... )
    >>> fall = ball.simulate([1.0], [0.0], (0.0, 1.0), steps=1000)
    >>> bool(np.ptp(fall.energy[:450]) < 1e-12), bool(abs(fall.q[-1, 0]) < 5e-3), fall.p[-1].round(12) + 0.0
    (True, True, array([0.]))
    """

    energy: Energy
    gradient: Gradient
    constraints: Function
    constraint_jacobian: Function
    restitution: float = 0.0

    def __post_init__(self) -> None:
        check_callable("energy", self.energy, "(q, p)")
        check_callable("gradient", self.gradient, "(q, p)")
        check_callable("constraints", self.constraints, "q")
        check_callable("constraint_jacobian", self.constraint_jacobian, "q")
        object.__setattr__(self, "restitution", as_share("restitution", self.restitution))

    def simulate(
        self, q0: ArrayLike, p0: ArrayLike, t_span: tuple[float, float], *, steps: int
    ) -> HamiltonianTrajectory:
        """Simulate over t_span in so many equal steps: order 2 while nothing touches, 1 with impacts.

        Raises
        ------
        InvalidInputError
            Shapes that do not fit, q0 violates a constraint, a number of steps that is not from 1 to 1 000 000.
        IterationLimitError
            Newton's method does not converge: take more steps.
        NumericalError
            A function has no finite value where the motion goes, the state overflows, or a step is too long for the law
            of impact.
        """
        q = as_vector("q0", q0)
        if q.size == 0:
            raise InvalidInputError("q0", q0, "one coordinate or more")
        p = as_vector("p0", p0, q.size)
        span = checked_span(t_span)
        t = np.linspace(*span, as_whole_number("steps", steps, 1, MOST_STEPS) + 1)
        gaps = as_vector("constraints", np.atleast_1d(as_array("constraints", self.constraints(q))))
        if np.any(gaps < 0.0):
            i = int(np.flatnonzero(gaps < 0.0)[0])
            raise InvalidInputError("q0", q0, f"such that constraint {i} holds: it is {gaps[i]:.6g} there")
        z = np.concatenate([q, p])
        states, impulses = [z], [np.zeros(gaps.size)]
        with np.errstate(over="ignore", invalid="ignore"):  # told by `as_values` and `check_size`
            for start, end in itertools.pairwise(t):
                check_size(z, float(start))
                z, impulse = self._step(z, gaps.size, float(end - start), float(end))
                states.append(z)
                impulses.append(impulse)
        table = np.array(states)
        positions, momenta = table[:, : q.size], table[:, q.size :]
        return HamiltonianTrajectory(
            t,
            positions,
            momenta,
            np.array(impulses),
            np.array([self._gaps(position, gaps.size) for position in positions]),
            np.array([self._energy(state) for state in states]),
        )

    def _step(self, z: Vector, k: int, h: float, t: float) -> tuple[Vector, Vector]:
        """Return the state after a step and the impulses in it, by Newton's method with an LCP in each iteration."""
        n = z.size // 2
        velocity = self._slope(z)[n:]
        ahead = z[:n] + 0.5 * h * velocity
        given = np.atleast_2d(as_array("constraint_jacobian", self.constraint_jacobian(ahead)))
        normals = as_values("constraint_jacobian", given, (k, n))
        closing: BoolVector = self._gaps(ahead, k) <= 0.0
        active = normals[closing]
        push = np.vstack([np.zeros((n, active.shape[0])), active.T])
        after, impulse = z + h * _rotated(self._slope(z)), np.zeros(active.shape[0])
        for _ in range(MOST_ITERATIONS):
            residual = after - z - h * _rotated(self._discrete_gradient(z, after)) - push @ impulse
            jacobian = self._derivative(
                lambda end: end - h * _rotated(self._discrete_gradient(z, end)), after
            )
            by_velocity = self._derivative(lambda end: self._slope(end)[n:], after)
            solved = _solved(jacobian, np.column_stack([-residual, push]), t)
            free, response = solved[:, 0], solved[:, 1:]
            rebound = active @ (self._slope(after)[n:] + by_velocity @ free + self.restitution * velocity)
            change = active @ by_velocity @ response
            found = _impulse(change, rebound - change @ impulse, t) if impulse.size else impulse
            step = free + response @ (found - impulse)
            after, impulse = after + step, found
            if float(np.max(np.abs(step))) <= SETTLED * max(float(np.max(np.abs(after))), 1.0):
                break
        else:
            raise IterationLimitError(
                f"Newton's method does not converge in the step to t = {t:.9g}: take more steps"
            )
        every = np.zeros(closing.size)
        every[closing] = impulse
        return after, every

    def _gaps(self, q: Vector, k: int) -> Vector:
        """Return C(q), shape (k,)."""
        return as_values("constraints", np.atleast_1d(as_array("constraints", self.constraints(q))), (k,))

    def _energy(self, z: Vector) -> float:
        """Return H."""
        n = z.size // 2
        return float(as_values("energy", self.energy(z[:n], z[n:]), ()))

    def _slope(self, z: Vector) -> Vector:
        """Return (H_q, H_p)."""
        n = z.size // 2
        parts = as_pair("gradient", self.gradient(z[:n], z[n:]))
        return np.concatenate(
            [as_values("gradient", np.atleast_1d(as_array("gradient", part)), (n,)) for part in parts]
        )

    def _discrete_gradient(self, start: Vector, end: Vector) -> Vector:
        """Return g with g^T (end - start) = H(end) - H(start), the gradient in the middle to second order."""
        middle, change = self._slope(0.5 * (start + end)), end - start
        length = float(change @ change)
        if length == 0.0:
            return middle
        difference = self._energy(end) - self._energy(start)
        return np.asarray(middle + (difference - middle @ change) / length * change)

    def _derivative(self, function: Callable[[Vector], Vector], z: Vector) -> Matrix:
        """Return the Jacobian by central differences."""
        columns = []
        for i, size in enumerate(np.maximum(np.abs(z), 1.0)):
            step = np.zeros(z.size)
            step[i] = DIFFERENCE * size
            columns.append((function(z + step) - function(z - step)) / (2.0 * step[i]))
        return np.array(columns).T


def _solved(jacobian: Matrix, right: Matrix, t: float) -> Matrix:
    """Return the solution of a linearised step."""
    try:
        solved = np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        solved = np.full(right.shape, np.nan)
    if not np.isfinite(solved).all():
        raise NumericalError(f"the equations of the step to t = {t:.9g} are singular: take more steps")
    return solved


def _impulse(change: Matrix, offset: Vector, t: float) -> Vector:
    """Return the impulse that the law of impact asks for in a linearised step."""
    if not (np.isfinite(change).all() and np.isfinite(offset).all()):
        raise NumericalError(f"the state overflows in the step to t = {t:.9g}: take more steps")
    try:
        return solve(LCP(change, offset)).z
    except NumericalError as error:
        raise NumericalError(
            f"no impulse was found for the step to t = {t:.9g}: take more steps ({error})"
        ) from error


def _rotated(slope: Vector) -> Vector:
    """Return (H_p, -H_q)."""
    n = slope.size // 2
    return np.concatenate([slope[n:], -slope[:n]])
