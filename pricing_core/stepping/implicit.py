"""One-step methods built on one implicit stage, value = base + h F(t, value), whatever solves it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from pricing_core.arrays import Vector
from pricing_core.stepping.method import Step

SDIRK2_THETA = 1.0 - math.sqrt(0.5)


class HasValue(Protocol):
    """A state whose differential part is an array."""

    @property
    def value(self) -> Vector:
        """The differential part; linear combinations of it make sense."""
        ...


ImplicitState = TypeVar("ImplicitState", bound=HasValue)


class ImplicitStage(Protocol[ImplicitState]):
    """Solves value = base + h F(t, value), constraints at t included."""

    def solve(self, t: float, base: Vector, h: float, near: ImplicitState) -> ImplicitState:
        """Return the state at t; `near` is a recent one, for warm starts."""
        ...


class RatedStage(ImplicitStage[ImplicitState], Protocol[ImplicitState]):
    """An implicit stage that also tells F itself."""

    def rate(self, t: float, state: ImplicitState) -> Vector:
        """Return F(t, state) just after t."""
        ...


@dataclass(frozen=True, slots=True)
class ImplicitEuler(Generic[ImplicitState]):
    """y+ = y + h F(t + h, y+): order 1, L-stable; a state off the constraints is carried onto them.

    Parameters
    ----------
    stage : ImplicitStage
        Solves y = base + h F(t, y).
    """

    stage: ImplicitStage[ImplicitState]

    @property
    def order(self) -> int:
        """The order of the method, 1."""
        return 1

    def step(self, t: float, state: ImplicitState, h: float) -> Step[ImplicitState]:
        """Return the step from t to t + h, which begins at `state`."""
        end = self.stage.solve(t + h, state.value, h, state)
        return Step(end, end.value.ravel())


@dataclass(frozen=True, slots=True)
class Sdirk2(Generic[ImplicitState]):
    """The two-stage singly diagonally implicit Runge-Kutta method of order 2 (Alexander 1977).

    theta = 1 - 1/sqrt(2): y1 = y + theta h F(y1), y+ = y + (1 - theta) h F(y1) + theta h F(y+). L-stable and
    stiffly accurate: the new state satisfies the constraints at t + h. h F(y1) is (y1 - y)/theta, so F is
    never evaluated. It must start on the constraints: the first stage would carry a jump 2.4 times too far
    into the second.

    Parameters
    ----------
    stage : ImplicitStage
        Solves y = base + h F(t, y).
    """

    stage: ImplicitStage[ImplicitState]

    @property
    def order(self) -> int:
        """The order of the method, 2."""
        return 2

    def step(self, t: float, state: ImplicitState, h: float) -> Step[ImplicitState]:
        """Return the step from t to t + h, which begins at `state`."""
        first = self.stage.solve(t + SDIRK2_THETA * h, state.value, SDIRK2_THETA * h, state)
        base = state.value + (1.0 - SDIRK2_THETA) / SDIRK2_THETA * (first.value - state.value)
        end = self.stage.solve(t + h, base, SDIRK2_THETA * h, first)
        return Step(end, end.value.ravel())


@dataclass(frozen=True, slots=True)
class ThetaMethod(Generic[ImplicitState]):
    """y+ = y + (1 - theta) h F(t, y) + theta h F(t + h, y+): order 2 for theta = 1/2, the trapezoidal rule, else 1.

    Stable for theta >= 1/2; only theta = 1 damps the fastest components. It must start on the constraints.

    Parameters
    ----------
    stage : RatedStage
        Solves y = base + h F(t, y), and evaluates F.
    theta : float
        Weight of the end of the step, above 0 and at most 1.
    """

    stage: RatedStage[ImplicitState]
    theta: float

    @property
    def order(self) -> int:
        """The order of the method: 2 for theta = 1/2, else 1."""
        return 2 if self.theta == 0.5 else 1

    def step(self, t: float, state: ImplicitState, h: float) -> Step[ImplicitState]:
        """Return the step from t to t + h, which begins at `state`."""
        base = state.value + (1.0 - self.theta) * h * self.stage.rate(t, state)
        end = self.stage.solve(t + h, base, self.theta * h, state)
        return Step(end, end.value.ravel())
