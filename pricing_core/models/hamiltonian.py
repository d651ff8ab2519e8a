"""Hamiltonian systems with unilateral constraints (11.7)-(11.8), stepped at velocity level."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import BoolVector, Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp import LCP, solve

Function: TypeAlias = Callable[[Vector], ArrayLike]
Energy: TypeAlias = Callable[[Vector, Vector], float]
Gradient: TypeAlias = Callable[[Vector, Vector], tuple[ArrayLike, ArrayLike]]

MOST_ITERATIONS = 50
SETTLED = 1e-13  # of the state
DIFFERENCE = 1e-7  # of the state, for derivatives by differences


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianTrajectory:
    """What `HamiltonianSystem.simulate` returns.

    Parameters
    ----------
    t : Vector, shape (m,)
    q, p : Matrix, shape (m, n)
    impulses : Matrix, shape (m, k)
        Of the step that ends there: h u where a contact lasts.
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
        if not 0.0 <= self.restitution <= 1.0:
            raise InvalidInputError("restitution", self.restitution, "a number from 0 to 1")

    def simulate(
        self, q0: ArrayLike, p0: ArrayLike, t_span: tuple[float, float], *, steps: int
    ) -> HamiltonianTrajectory:
        """Simulate over t_span in so many equal steps: order 2 while nothing touches, 1 with impacts.

        Raises
        ------
        InvalidInputError
            Shapes that do not fit, q0 violates a constraint, no step.
        IterationLimitError
            Newton's method does not converge: take more steps.
        """
        q = as_vector("q0", q0)
        p = as_vector("p0", p0, q.size)
        if steps < 1:
            raise InvalidInputError("steps", steps, "at least 1")
        t = np.linspace(*t_span, steps + 1)
        gaps = np.atleast_1d(np.asarray(self.constraints(q), dtype=np.float64))
        if np.any(gaps < 0.0):
            i = int(np.flatnonzero(gaps < 0.0)[0])
            raise InvalidInputError("q0", q0, f"such that constraint {i} holds: it is {gaps[i]:.6g} there")
        z = np.concatenate([q, p])
        states, impulses = [z], [np.zeros(gaps.size)]
        for start, end in itertools.pairwise(t):
            z, impulse = self._step(z, float(end - start), float(end))
            states.append(z)
            impulses.append(impulse)
        table = np.array(states)
        positions, momenta = table[:, : q.size], table[:, q.size :]
        return HamiltonianTrajectory(
            t,
            positions,
            momenta,
            np.array(impulses),
            np.array([np.atleast_1d(self.constraints(position)) for position in positions]),
            np.array([self.energy(*pair) for pair in zip(positions, momenta, strict=True)]),
        )

    def _step(self, z: Vector, h: float, t: float) -> tuple[Vector, Vector]:
        """Return the state after a step and the impulses in it, by Newton's method with an LCP in each iteration."""
        n = z.size // 2
        velocity = self._slope(z)[n:]
        ahead = z[:n] + 0.5 * h * velocity
        normals = np.atleast_2d(np.asarray(self.constraint_jacobian(ahead), dtype=np.float64))
        closing: BoolVector = np.atleast_1d(np.asarray(self.constraints(ahead))) <= 0.0
        active = normals[closing]
        push = np.vstack([np.zeros((n, active.shape[0])), active.T])
        after, impulse = z + h * _rotated(self._slope(z)), np.zeros(active.shape[0])
        for _ in range(MOST_ITERATIONS):
            residual = after - z - h * _rotated(self._discrete_gradient(z, after)) - push @ impulse
            jacobian = self._derivative(
                lambda end: end - h * _rotated(self._discrete_gradient(z, end)), after
            )
            by_velocity = self._derivative(lambda end: self._slope(end)[n:], after)
            solved = np.linalg.solve(jacobian, np.column_stack([-residual, push]))
            free, response = solved[:, 0], solved[:, 1:]
            rebound = active @ (self._slope(after)[n:] + by_velocity @ free + self.restitution * velocity)
            change = active @ by_velocity @ response
            found = solve(LCP(change, rebound - change @ impulse)).z if impulse.size else impulse
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

    def _slope(self, z: Vector) -> Vector:
        """Return (H_q, H_p)."""
        n = z.size // 2
        return np.concatenate([np.atleast_1d(part) for part in self.gradient(z[:n], z[n:])]).astype(
            np.float64
        )

    def _discrete_gradient(self, start: Vector, end: Vector) -> Vector:
        """Return g with g^T (end - start) = H(end) - H(start), the gradient in the middle to second order."""
        n = start.size // 2
        middle, change = self._slope(0.5 * (start + end)), end - start
        length = float(change @ change)
        if length == 0.0:
            return middle
        difference = self.energy(end[:n], end[n:]) - self.energy(start[:n], start[n:])
        return np.asarray(middle + (difference - middle @ change) / length * change)

    def _derivative(self, function: Callable[[Vector], Vector], z: Vector) -> Matrix:
        """Return the Jacobian by central differences."""
        columns = []
        for i, size in enumerate(np.maximum(np.abs(z), 1.0)):
            step = np.zeros(z.size)
            step[i] = DIFFERENCE * size
            columns.append((function(z + step) - function(z - step)) / (2.0 * step[i]))
        return np.array(columns).T


def _rotated(slope: Vector) -> Vector:
    """Return (H_p, -H_q)."""
    n = slope.size // 2
    return np.concatenate([slope[n:], -slope[:n]])
