"""One implicit stage: the compact scheme's equations with the averaged complementarity function, by Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgtsv

from pricing_core.arrays import Vector
from pricing_core.errors import IterationLimitError
from pricing_core.obstacle.averaged import Point, Side
from pricing_core.obstacle.compact import neighbouring, product
from pricing_core.obstacle.moment import Moment

MOST_ITERATIONS = 60  # ten suffice
# What a last iteration may still change in the distances of contact sets' ends, in cells: it leaves an error of its
# square. Where no distance changes the equations are linear, whatever the values' size, and solved.
SETTLED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """V at the nodes, shape (n,), and the mass of u - w under the hats of the inner ones, shape (n - 2,)."""

    value: Vector
    mass: Vector


@dataclass(frozen=True, slots=True, eq=False)
class StageSystem:
    """A V - mass/D = rhs at the inner nodes, the ends eliminated.

    Parameters
    ----------
    moment : Moment
    a : float
        The implicit weight, in years.
    lower, upper : Vector, shape (n - 3,)
    diagonal, diffusion : Vector, shape (n - 2,)
        A, and D.
    left, right : float
        What multiplies the values that are held at the ends.
    side : Side or None
        Which obstacle each node may touch; None where that depends on V.
    """

    moment: Moment
    a: float
    lower: Vector
    diagonal: Vector
    upper: Vector
    diffusion: Vector
    left: float
    right: float
    side: Side | None

    @classmethod
    def of(cls, moment: Moment, a: float) -> StageSystem:
        """Return the system of a stage at one time."""
        scheme, contact = moment.scheme, moment.contact
        A = scheme.weights * (1.0 / a + neighbouring(moment.rate)) - scheme.operator
        lower, diagonal, upper, left, right = moment.without_ends(A)
        D = scheme.diffusion[1:-1]
        side = None if contact.is_two_sided else contact.side(contact.lower, D * diagonal)
        return cls(moment, a, lower, diagonal, upper, D, left, right, side)

    @property
    def omega(self) -> Vector:
        """The scale of the right angle."""
        return self.diffusion * self.diagonal

    def rhs(self, base: Vector) -> Vector:
        """Return the right-hand side of V = base + a (...)."""
        moment = self.moment
        rhs = product(moment.scheme.weights, base / self.a + moment.source)
        rhs[0] -= self.left * moment.left.value
        rhs[-1] -= self.right * moment.right.value
        return rhs

    def residual(self, point: Point, rhs: Vector) -> Vector:
        """Return A V - mass/D - rhs."""
        residual: Vector = self.diagonal * point.value - rhs - point.mass / self.diffusion
        residual[1:] += self.lower * point.value[:-1]
        residual[:-1] += self.upper * point.value[1:]
        return residual

    def solve(self, point: Point, rhs: Vector) -> Vector:
        """Solve with the derivative of the residual by s."""
        slope = point.slope
        diagonal = self.diagonal * slope - point.change / self.diffusion
        return np.asarray(dgtsv(self.lower * slope[:-1], diagonal, self.upper * slope[1:], rhs)[3])

    def solve_transposed(self, point: Point, rhs: Vector) -> Vector:
        """Solve with the transpose of the derivative of the residual by s."""
        slope = point.slope
        diagonal = self.diagonal * slope - point.change / self.diffusion
        return np.asarray(dgtsv(self.upper * slope[1:], diagonal, self.lower * slope[:-1], rhs)[3])


def solve_stage(system: StageSystem, base: Vector, near: Values) -> Values:
    """Return V = base + a (L V + f + u - w).

    Parameters
    ----------
    system : StageSystem
    base : Vector, shape (n,)
    near : Values
        Where to start.

    Raises
    ------
    IterationLimitError
        Newton's method did not settle.
    """
    moment, contact = system.moment, system.moment.contact
    rhs = system.rhs(base)
    side = system.side or contact.side(near.value[1:-1], system.omega)
    s = side.parameter(near.value[1:-1], near.mass)
    point = side.at(s)
    for _ in range(MOST_ITERATIONS):
        before, s = point.distance, s - system.solve(point, system.residual(point, rhs))
        point = side.at(s)
        if np.abs(point.distance - before).max() > SETTLED:
            continue
        if system.side is not None:
            break
        other = contact.side(point.value, system.omega)
        if np.array_equal(other.c > 0.0, side.c > 0.0):
            break
        side, s = other, other.parameter(point.value, point.mass)
        point = side.at(s)
    else:
        raise IterationLimitError(f"a stage has not settled in {MOST_ITERATIONS} iterations: take more nodes")
    return Values(moment.with_ends(point.value), point.mass)
