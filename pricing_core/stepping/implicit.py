"""Diagonally implicit Runge-Kutta methods on one implicit stage, value = base + h F(t, value), whatever solves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from pricing_core.arrays import Vector
from pricing_core.stepping.method import OneStepMethod, Step
from pricing_core.stepping.tableaux import Tableau


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
class DiagonallyImplicit(Generic[ImplicitState]):
    """The method of a tableau on an implicit stage.

    The new state is that of the last stage, so that it satisfies the constraints at t + h. A method with more than one
    stage, or with an explicit first one, must start on the constraints: a jump onto them would be carried too far into
    the later stages.

    Parameters
    ----------
    stage : RatedStage
        Solves y = base + h F(t, y), and evaluates F; that only where the tableau has an explicit start.
    tableau : Tableau
    """

    stage: ImplicitStage[ImplicitState] | RatedStage[ImplicitState]
    tableau: Tableau

    @property
    def order(self) -> int:
        """The order of the method for smooth solutions."""
        return self.tableau.order

    def step(self, t: float, state: ImplicitState, h: float) -> Step[ImplicitState]:
        """Return the step from t to t + h, which begins at `state`."""
        rate = self.stage.rate(t, state) if self.tableau.has_explicit_start else None  # type: ignore[union-attr]
        end, _ = take_step(self.tableau, self.stage.solve, t, state, h, rate)
        return Step(end, end.value.ravel())


def take_step(
    tableau: Tableau,
    solve: Callable[[float, Vector, float, ImplicitState], ImplicitState],
    t: float,
    state: ImplicitState,
    h: float,
    rate: Vector | None = None,
    start: Vector | None = None,
) -> tuple[ImplicitState, Vector]:
    """Return the state at t + h and F there.

    Parameters
    ----------
    solve : callable
        The method `solve` of an `ImplicitStage`.
    rate : Vector, optional
        F(t, state), for a tableau with an explicit start.
    start : Vector, optional
        What the step starts from, where it is not the state's own value.
    """
    begin = state.value if start is None else start
    changes: list[tuple[Vector, float]] = []  # a_jj h F_j, and a_jj
    last = state
    for row, c in zip(tableau.a, tableau.c, strict=True):
        if row == (0.0,):
            assert rate is not None
            changes.append((h * rate, 1.0))
            continue
        base = begin
        for weight, (change, own) in zip(row[:-1], changes, strict=True):
            base = base + weight / own * change
        last = solve(t + c * h, base, row[-1] * h, last)
        changes.append((last.value - base, row[-1]))
    change, own = changes[-1]
    return last, change / (own * h)


@dataclass(frozen=True, slots=True)
class RannacherStart(Generic[ImplicitState]):
    """A method whose first steps are two half steps of a damping one each: a kink at the start is not damped otherwise.

    Parameters
    ----------
    method, damping : OneStepMethod
        Such as Crank-Nicolson and implicit Euler (Rannacher 1984).
    until : float
        Steps that begin before this time are those of `damping`.
    """

    method: OneStepMethod[ImplicitState]
    damping: OneStepMethod[ImplicitState]
    until: float

    @property
    def order(self) -> int:
        """The order of the method."""
        return self.method.order

    def step(self, t: float, state: ImplicitState, h: float) -> Step[ImplicitState]:
        """Return the step from t to t + h, which begins at `state`."""
        if t >= self.until:
            return self.method.step(t, state, h)
        middle = self.damping.step(t, state, h / 2).state
        return self.damping.step(t + h / 2, middle, h / 2)
