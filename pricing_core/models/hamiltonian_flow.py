"""Smooth motion of a Hamiltonian system with contacts that last, by the discrete gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import BoolVector, Matrix, Vector, as_array, as_pair, as_values
from pricing_core.errors import IterationLimitError, NumericalError
from pricing_core.lcp import LCP, solve

Function: TypeAlias = Callable[[Vector], ArrayLike]
Energy: TypeAlias = Callable[[Vector, Vector], float]
Gradient: TypeAlias = Callable[[Vector, Vector], tuple[ArrayLike, ArrayLike]]

MOST_ITERATIONS = 50
SETTLED = 1e-13  # last change of Newton's method, as a share of the state
DIFFERENCE = 1e-7  # step of derivatives by differences, as a share of the state
ROUNDING = 8.0 * float(np.finfo(np.float64).eps)  # of the energy


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianFlow:
    """q' = H_p, p' = -H_q + C_q^T u in states z = (q, p), with k constraints."""

    energy_function: Energy
    gradient: Gradient
    constraints: Function
    constraint_jacobian: Function
    k: int

    def step(self, z: Vector, h: float, contacts: BoolVector, t: float) -> tuple[Vector, Vector]:
        """Return the state after h, at time t, and the impulses (k,) of the contacts, at rest at its start.

        Gonzalez's discrete gradient equations (1996) keep H where no contact works. The contacts may open, C_q v+ >= 0,
        and push where they do not: Newton's method, with an LCP in each iteration. Those that pushed are put on their
        constraints again.
        """
        n = z.size // 2
        active = self.normals(z[:n] + 0.5 * h * self.velocity(z))[contacts]
        push = np.vstack([np.zeros((n, len(active))), active.T])

        def improve(after: Vector, impulse: Vector) -> tuple[Vector, Vector]:
            residual = after - z - h * _rotated(self._discrete_gradient(z, after)) - push @ impulse
            jacobian = self._derivative(
                lambda end: end - h * _rotated(self._discrete_gradient(z, end)), after
            )
            solved = _solved(jacobian, np.column_stack([-residual, push]), t)
            free, response, found = solved[:, 0], solved[:, 1:], impulse
            if impulse.size:
                by_velocity = active @ self._derivative(self.velocity, after)
                change = by_velocity @ response
                offset = active @ self.velocity(after) + by_velocity @ free - change @ impulse
                found = impulse_of(change, offset, t)
            return free + response @ (found - impulse), found

        start = z + h * _rotated(self.slope(z)), np.zeros(len(active))
        after, impulse = _iterated(improve, *start, f"the step to t = {t:.9g}: take more steps")
        every = np.zeros(self.k)
        every[contacts] = impulse
        return self._on_constraints(after, every > 0.0), every

    def strike(self, z: Vector, closed: BoolVector, restitution: Vector, t: float) -> tuple[Vector, Vector]:
        """Return the state after an impact at the closed contacts, and its impulses (k,).

        C_q v+ >= -e C_q v-, with equality where there is an impulse (Moreau 1988).
        """
        n = z.size // 2
        normals = self.normals(z[:n])[closed]
        wanted = restitution[closed] * (normals @ self.velocity(z))

        def improve(after: Vector, impulse: Vector) -> tuple[Vector, Vector]:
            by_momentum = normals @ self._derivative(self.velocity, after)[:, n:]
            change = by_momentum @ normals.T
            found = impulse_of(change, normals @ self.velocity(after) + wanted - change @ impulse, t)
            return np.concatenate([np.zeros(n), normals.T @ (found - impulse)]), found

        where = f"the impact at t = {t:.9g}: C_q or H_pp may be singular there"
        after, impulse = _iterated(improve, z, np.zeros(len(normals)), where)
        every = np.zeros(self.k)
        every[closed] = impulse
        return after, every

    def gaps(self, z: Vector) -> Vector:
        """Return C(q), shape (k,)."""
        q = z[: z.size // 2]
        return as_values(
            "constraints", np.atleast_1d(as_array("constraints", self.constraints(q))), (self.k,)
        )

    def normals(self, q: Vector) -> Matrix:
        """Return C_q, shape (k, n)."""
        given = np.atleast_2d(as_array("constraint_jacobian", self.constraint_jacobian(q)))
        return as_values("constraint_jacobian", given, (self.k, q.size))

    def velocity(self, z: Vector) -> Vector:
        """Return H_p, shape (n,)."""
        return self.slope(z)[z.size // 2 :]

    def speeds(self, z: Vector) -> Vector:
        """Return C_q v, shape (k,)."""
        return np.asarray(self.normals(z[: z.size // 2]) @ self.velocity(z))

    def energy(self, z: Vector) -> float:
        """Return H."""
        n = z.size // 2
        return float(as_values("energy", self.energy_function(z[:n], z[n:]), ()))

    def slope(self, z: Vector) -> Vector:
        """Return (H_q, H_p)."""
        n = z.size // 2
        parts = as_pair("gradient", self.gradient(z[:n], z[n:]))
        return np.concatenate(
            [as_values("gradient", np.atleast_1d(as_array("gradient", part)), (n,)) for part in parts]
        )

    def _discrete_gradient(self, start: Vector, end: Vector) -> Vector:
        """Return g with g^T (end - start) = H(end) - H(start), the gradient in the middle to second order."""
        middle, change = self.slope(0.5 * (start + end)), end - start
        length = float(change @ change)
        if length == 0.0:
            return middle
        levels = self.energy(start), self.energy(end)
        missing = levels[1] - levels[0] - float(middle @ change)
        if abs(missing) <= ROUNDING * (abs(levels[0]) + abs(levels[1])):
            return middle
        return np.asarray(middle + missing / length * change)

    def _derivative(self, function: Callable[[Vector], Vector], z: Vector) -> Matrix:
        """Return the Jacobian by central differences."""
        columns = []
        for i, size in enumerate(np.maximum(np.abs(z), 1.0)):
            step = np.zeros(z.size)
            step[i] = DIFFERENCE * size
            columns.append((function(z + step) - function(z - step)) / (2.0 * step[i]))
        return np.array(columns).T

    def _on_constraints(self, z: Vector, held: BoolVector) -> Vector:
        """Move q by the least that closes the gaps of the held contacts, to first order."""
        if not held.any():
            return z
        n = z.size // 2
        shift = np.linalg.lstsq(self.normals(z[:n])[held], -self.gaps(z)[held])[0]
        return np.concatenate([z[:n] + shift, z[n:]])


def _iterated(
    improve: Callable[[Vector, Vector], tuple[Vector, Vector]], after: Vector, impulse: Vector, where: str
) -> tuple[Vector, Vector]:
    """Return the state and the impulse at which Newton's steps settle; `improve` gives a step and a new impulse."""
    for _ in range(MOST_ITERATIONS):
        step, impulse = improve(after, impulse)
        after = after + step
        if _is_settled(step, after):
            return after, impulse
    raise IterationLimitError(f"Newton's method does not converge in {where}")


def _solved(jacobian: Matrix, right: Matrix, t: float) -> Matrix:
    """Return the solution of a linearised step."""
    try:
        solved = np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        solved = np.full(right.shape, np.nan)
    if not np.isfinite(solved).all():
        raise NumericalError(f"the equations of the step to t = {t:.9g} are singular: take more steps")
    return solved


def impulse_of(change: Matrix, offset: Vector, t: float) -> Vector:
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


def _is_settled(step: Vector, after: Vector) -> bool:
    """Tell whether Newton's last step is rounding beside the state that it led to."""
    return float(np.max(np.abs(step))) <= SETTLED * max(float(np.max(np.abs(after))), 1.0)
