"""One step of a time integrator, and step doubling, which gives any of them an error estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from pricing_core.arrays import Vector

State = TypeVar("State")


@dataclass(frozen=True, slots=True)
class Step(Generic[State]):
    """The result of one step.

    Parameters
    ----------
    state : State
        The state at the end of the step, whatever the method carries.
    value : Vector, shape (n,)
        The part of the state whose error is controlled.
    error : Vector, shape (n,), or None
        Estimate of the local error of `value`; None where the method has none.
    """

    state: State
    value: Vector
    error: Vector | None = None


class OneStepMethod(Protocol[State]):
    """A method that needs nothing but the present state to take a step.

    `order` is the p for which the local error of a smooth solution is O(h**(p + 1)).
    """

    @property
    def order(self) -> int:
        """The order p of the method."""
        ...

    def step(self, t: float, state: State, h: float) -> Step[State]:
        """Return the step from t to t + h, which begins at `state`."""
        ...


@dataclass(frozen=True, slots=True)
class StepDoubling(Generic[State]):
    """Compare one step of h with two of h/2; go on from the two halves.

    error = (two halves - one step) / (2**p - 1), the leading local error of the two halves
    (Hairer, Norsett, Wanner, Solving ODEs I, II.4). The halves are not extrapolated, so
    inequality constraints that each step satisfies stay satisfied.

    Parameters
    ----------
    method : OneStepMethod
        Makes the steps; its order is p.
    """

    method: OneStepMethod[State]

    @property
    def order(self) -> int:
        """The order of the underlying method."""
        return self.method.order

    def step(self, t: float, state: State, h: float) -> Step[State]:
        """Return the step from t to t + h in two halves, which begins at `state`.

        It costs three times as much as one step.
        """
        whole = self.method.step(t, state, h)
        half = self.method.step(t, state, h / 2)
        end = self.method.step(t + h / 2, half.state, h / 2)
        return Step(end.state, end.value, (end.value - whole.value) / (2**self.order - 1))
