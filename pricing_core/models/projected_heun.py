"""A one-step method for projected dynamics x' = pi(x, -F(x)) with any F and any convex set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcs.overflow import check_size
from pricing_core.models.convex_set import ConvexSet
from pricing_core.models.nearest_point import nearest_point
from pricing_core.stepping import Step, StepDoubling

TOLERANCES = 3.0  # that all steps together may spend
LEAST_SHARE = 1e-3  # of that, for any step, however short


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedHeun:
    """x+ = P(x + h (v1 + v2)/2), with v1 next to -F(x), v2 next to -F(z) at z = P(x + h v1).

    v1 is the nearest velocity with h(x) + h H(x) v1 >= 0, v2 that with h(x) + h H(z) v2 >= 0: a constraint that the
    step meets is met by both, and closed at the end of the step. Order 2 while the active constraints stay the same,
    on curved boundaries too; a step in which a constraint becomes active has an error of order h**2.
    """

    F: Callable[[Vector], Vector]
    K: ConvexSet

    @property
    def order(self) -> int:
        """The order of the method, 2."""
        return 2

    def step(self, t: float, state: Vector, h: float) -> Step[Vector]:
        """Go from t to t + h."""
        check_size(state, t)
        room = np.maximum(self.K.slack(state), 0.0) / h
        first = nearest_point(self.K.gradients(state), -room, -self.F(state)).point
        middle = self.K.project(state + h * first)
        second = nearest_point(self.K.gradients(middle), -room, -self.F(middle)).point
        end = self.K.project(state + 0.5 * h * (first + second))
        return Step(end, end)


@dataclass(frozen=True, slots=True, eq=False)
class ControlledHeun:
    """Step doubling whose error estimate is held against the part of the tolerance that is due to the step.

    All steps together may spend three times the tolerance: a step of h the share h / length of that, or a thousandth
    where that is more. Where -F does not drive motions apart, projections do not either, and the error at the end is no
    more than the errors of all steps together.
    """

    method: StepDoubling[Vector]
    length: float  # of the whole interval

    @property
    def order(self) -> int:
        """1, the order of the error per unit of time less 1."""
        return self.method.order - 1

    def step(self, t: float, state: Vector, h: float) -> Step[Vector]:
        """Go from t to t + h."""
        taken = self.method.step(t, state, h)
        assert taken.error is not None  # step doubling estimates it
        return Step(taken.state, taken.value, taken.error / (TOLERANCES * max(h / self.length, LEAST_SHARE)))
