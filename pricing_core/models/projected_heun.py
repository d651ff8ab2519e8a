"""A one-step method for projected dynamics x' = pi(x, -F(x)) with any F and any convex set."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcs.overflow import check_size
from pricing_core.models.convex_set import ConvexSet, active_set
from pricing_core.models.tangent_cone import project_velocity
from pricing_core.stepping import Step


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedHeun:
    """x+ = P(x + h (v1 + v2)/2), v1 = pi(x, -F(x)), v2 = pi(z, -F(z)) at z = P(x + h v1).

    Order 2 while the active constraints stay the same, on curved boundaries too as v1 and v2 are tangential; a step in
    which a constraint becomes active has an error of order h**2.
    """

    F: Callable[[Vector], Vector]
    K: ConvexSet

    @property
    def order(self) -> int:
        """2."""
        return 2

    def step(self, t: float, state: Vector, h: float) -> Step[Vector]:
        """Go from t to t + h."""
        check_size(state, t)
        first = self.velocity(state)
        second = self.velocity(self.K.project(state + h * first))
        end = self.K.project(state + 0.5 * h * (first + second))
        return Step(end, end)

    def velocity(self, x: Vector) -> Vector:
        """Return pi(x, -F(x)), shape (n,)."""
        active = active_set(self.K, x)
        v0 = -self.F(x)
        return project_velocity(self.K.gradients(x)[active], v0).v if active else np.asarray(v0)
