"""Crank-Nicolson with a Rannacher start and an exact LCP at every step: the common method, to compare with."""

from __future__ import annotations

from dataclasses import dataclass

from pricing_core.american.engines.method_of_lines.stage import OptionStage, OptionState, end_forcing
from pricing_core.arrays import Vector
from pricing_core.stepping import (
    IMPLICIT_EULER,
    DiagonallyImplicit,
    OneStepMethod,
    RannacherStart,
    theta_method,
)

DAMPED_STEPS = 2  # Number of steps replaced by two implicit Euler steps of half the size (Rannacher 1984).


def crank_nicolson(stage: OptionStage, until: float) -> OneStepMethod[OptionState]:
    """Return v+ = v + h/2 (F(v) + F(v+)) + h u+ with the complementarity condition at the new time.

    Steps that begin before `until` are two implicit Euler half steps. Order 2 for smooth solutions; L-stable only while
    damping.
    """
    return RannacherStart(
        DiagonallyImplicit(OptionStageWithRate(stage), theta_method(0.5)),
        DiagonallyImplicit(stage, IMPLICIT_EULER),
        until,
    )


@dataclass(frozen=True, slots=True)
class OptionStageWithRate:
    """A stage of the option that also tells L v + e."""

    stage: OptionStage

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state t years before the segment's end, at the end of an implicit stage of size h from `base`."""
        return self.stage.solve(t, base, h, near)

    def rate(self, t: float, state: OptionState) -> Vector:
        """Return L v + e, continued beyond an exercise boundary inside a cell as the stages do."""
        form = self.stage.form.at(t)
        rate = form.operator.times(state.value) + end_forcing(form.operator, form.ends(t))
        return rate if state.continued is None else rate + state.continued


def damped_until(steps_end: list[float]) -> float:
    """Return the end of the damped part of a prescribed mesh of times, or of its only step."""
    return steps_end[min(DAMPED_STEPS, len(steps_end) - 1)]
