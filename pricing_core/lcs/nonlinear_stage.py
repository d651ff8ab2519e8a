"""The implicit stage of a nonlinear complementarity system: Newton's method with an LCP in every iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import IterationLimitError, NumericalError
from pricing_core.lcp import LCP, Method, solve
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.semi_explicit import Linearisation, SemiExplicitSystem
from pricing_core.lcs.time_stepping import LCSState
from pricing_core.stepping import OneStepMethod, Step

MOST_ITERATIONS = 50
SMALL_CHANGE = 1e-9  # relative: what is left after such an iteration is of the order of its square
SMALL_RESIDUAL = 1e-14  # relative
DECREASE = 1e-4  # of the residual, per unit of damping
MOST_HALVINGS = 12


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearStage:
    """Solves x = base + h f(x, u), 0 <= y = h(x, u) _|_ u >= 0 by the Josephy-Newton method.

    Every iteration solves the problem linearised at the last (x, u), an LCP with the matrix of (11.65),
    M = h_u + h h_x (I - h f_x)^-1 f_u, and goes as far towards its solution as the residual falls.

    Source: Josephy 1979; Facchinei and Pang, Finite-dimensional variational inequalities, 7.3.
    """

    system: SemiExplicitSystem
    lcp_method: Method = "auto"

    def solve(self, t: float, base: Vector, h: float, near: LCSState) -> LCSState:
        """Return the state at t.

        Raises
        ------
        IterationLimitError
            The iteration does not settle, or a linearised problem has no solution: nothing is proved.
        NumericalError
            The state overflows.
        """
        check_size(base, t)
        x, u = near.value, near.multiplier
        for _ in range(MOST_ITERATIONS):
            local = self.system.linearised(x, u)
            dx, du = self._step(t, local, x, u, base, h)
            sizes = _Sizes.of(local, x, u, base, h, dx)
            before = sizes.residual(local.f, local.h, x, u, base, h)
            length = self._length(sizes, before, x, u, dx, du, base, h)
            x, u = x + length * dx, np.maximum(u + length * du, 0.0)
            if before <= SMALL_RESIDUAL or (length == 1.0 and sizes.relative(dx, du) <= SMALL_CHANGE):
                return LCSState(x, u, self.system.slack(x, u))
        raise IterationLimitError(
            f"Newton's method did not settle in {MOST_ITERATIONS} iterations at t = {t:g}: take smaller steps"
        )

    def rate(self, t: float, state: LCSState) -> Vector:
        """Return x' = f(x, u)."""
        return self.system.rate(state.value, state.multiplier)

    def _step(
        self, t: float, local: Linearisation, x: Vector, u: Vector, base: Vector, h: float
    ) -> tuple[Vector, Vector]:
        """Return the way to the solution of the linearised problem."""
        matrix = np.eye(x.size) - h * local.f_x
        try:
            free = np.linalg.solve(matrix, base + h * local.f - x)
            response = h * np.linalg.solve(matrix, local.f_u)
            M = local.h_u + local.h_x @ response
            problem = LCP(M, local.h + local.h_x @ free - M @ u)
            du = solve(problem, method=self.lcp_method, start=u > local.h).z - u
        except (NumericalError, np.linalg.LinAlgError) as error:
            raise IterationLimitError(
                f"Newton's method stops at t = {t:g}, where its linearised problem was not solved: {error}"
            ) from error
        return free + response @ du, du

    def _length(
        self,
        sizes: _Sizes,
        before: float,
        x: Vector,
        u: Vector,
        dx: Vector,
        du: Vector,
        base: Vector,
        h: float,
    ) -> float:
        """Return 1, or the first of 1/2, 1/4, ... at which the residual falls; 1 if it nowhere does."""
        for halvings in range(MOST_HALVINGS):
            length = 0.5**halvings
            x_new, u_new = x + length * dx, u + length * du
            try:
                f, y = self.system.rate(x_new, u_new), self.system.slack(x_new, u_new)
            except NumericalError:
                continue
            if sizes.residual(f, y, x_new, u_new, base, h) <= (1.0 - DECREASE * length) * before:
                return length
        return 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Sizes:
    """What residuals and changes are measured by: x by x, y and the effect of u on y by the larger of them."""

    x: float
    y: float
    effect: Vector  # (k,): of u on y

    @classmethod
    def of(cls, local: Linearisation, x: Vector, u: Vector, base: Vector, h: float, dx: Vector) -> _Sizes:
        effect = np.abs(np.diag(local.h_u)) + h * np.sum(np.abs(local.h_x) @ np.abs(local.f_u), axis=1)
        effect = np.where(effect > 0.0, effect, 1.0)
        x_size = max(_largest(x), _largest(base), h * _largest(local.f), _largest(dx))
        y_size = max(_largest(local.h), _largest(effect * u), _largest(np.abs(local.h_x) @ np.abs(x)))
        return cls(x_size or 1.0, y_size or 1.0, effect)

    def residual(self, f: Vector, y: Vector, x: Vector, u: Vector, base: Vector, h: float) -> float:
        """Return the natural residual, relative."""
        return max(_largest(x - base - h * f) / self.x, _largest(np.minimum(y, self.effect * u)) / self.y)

    def relative(self, dx: Vector, du: Vector) -> float:
        """Return the size of a change, relative."""
        return max(_largest(dx) / self.x, _largest(self.effect * du) / self.y)


@dataclass(frozen=True, slots=True)
class RetriedSmaller:
    """Turns a step whose equations were not solved into one with an infinite error, to be tried with a smaller h."""

    method: OneStepMethod[LCSState]
    smallest: float  # in the units of t: here the failure is told

    @property
    def order(self) -> int:
        """The order of the underlying method."""
        return self.method.order

    def step(self, t: float, state: LCSState, h: float) -> Step[LCSState]:
        """Go from t to t + h."""
        try:
            return self.method.step(t, state, h)
        except IterationLimitError:
            if h <= self.smallest:
                raise
            return Step(state, state.value, np.full(state.value.size, np.inf))


def _largest(vector: Vector) -> float:
    return float(np.max(np.abs(vector), initial=0.0))
