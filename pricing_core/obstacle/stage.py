"""One implicit stage: the compact scheme's equations with the averaged complementarity function, by Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgtsv

from pricing_core.arrays import Vector
from pricing_core.errors import IterationLimitError
from pricing_core.obstacle.compact import product
from pricing_core.obstacle.moment import Moment

MOST_ITERATIONS = 60  # ten suffice
SETTLED = 1e-9  # of the largest value: a last change by which leaves an error of its square


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """V at the nodes, shape (n,), and the mass of u - w under the hats of the inner ones, shape (n - 2,)."""

    value: Vector
    mass: Vector


def solve_stage(moment: Moment, base: Vector, a: float, near: Values) -> Values:
    """Return V = base + a (L V + f + u - w) at one time.

    Parameters
    ----------
    moment : Moment
        The equation at that time.
    base : Vector, shape (n,)
    a : float
        Years.
    near : Values
        Where to start.

    Raises
    ------
    IterationLimitError
        Newton's method did not settle.
    """
    scheme = moment.scheme
    A = scheme.weights * (1.0 / a + moment.rate) - scheme.operator
    lower, diagonal, upper = A[0, 1:-1].copy(), A[1, 1:-1].copy(), A[2, 1:-1].copy()
    rhs = product(scheme.weights, base / a + moment.source)
    left, right = moment.left, moment.right
    rhs[0] -= lower[0] * left.value
    diagonal[0] += lower[0] * left.first
    upper[0] += lower[0] * left.second
    rhs[-1] -= upper[-1] * right.value
    diagonal[-1] += upper[-1] * right.first
    lower[-1] += upper[-1] * right.second
    lower, upper = lower[1:], upper[:-1]

    D = scheme.diffusion[1:-1]
    contact = moment.contact
    V, settled = near.value[1:-1], SETTLED * max(1.0, float(np.abs(near.value).max()))
    side = contact.side(V, D * diagonal)
    s = side.parameter(V, near.mass)
    point = side.at(s)
    for _ in range(MOST_ITERATIONS):
        residual = diagonal * point.value - rhs - point.mass / D
        residual[1:] += lower * point.value[:-1]
        residual[:-1] += upper * point.value[1:]
        slope = point.slope
        step = dgtsv(lower * slope[:-1], diagonal * slope - point.change / D, upper * slope[1:], residual)[3]
        before, s = point.value, s - step
        point = side.at(s)
        if np.abs(point.value - before).max() > settled:
            continue
        if not contact.is_two_sided:
            break
        other = contact.side(point.value, D * diagonal)
        if np.array_equal(other.c > 0.0, side.c > 0.0):
            break
        side, s = other, other.parameter(point.value, point.mass)
        point = side.at(s)
    else:
        raise IterationLimitError(f"a stage has not settled in {MOST_ITERATIONS} iterations: take more nodes")
    return Values(moment.with_ends(point.value), point.mass)
