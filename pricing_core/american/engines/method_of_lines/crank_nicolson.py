"""Crank-Nicolson with a Rannacher start and an exact LCP at every step: the common method, to compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.american.engines.method_of_lines.stage import OptionStage, OptionState, end_forcing
from pricing_core.arrays import Vector
from pricing_core.stepping import ImplicitEuler, Step

DAMPED_STEPS = 2  # Number of steps replaced by two implicit Euler steps of half the size (Rannacher 1984).


@dataclass(frozen=True, slots=True)
class CrankNicolson:
    """v+ = v + h/2 (F(v) + F(v+)) + h u+ with the complementarity condition at the new time.

    Steps that begin before `damped_until` are two implicit Euler half steps: the trapezoidal rule does not
    damp the kink of the payoff. Order 2 for smooth solutions; L-stable only while damping.
    """

    stage: OptionStage
    damped_until: float

    @property
    def order(self) -> int:
        """The order for smooth solutions, 2."""
        return 2

    def step(self, t: float, state: OptionState, h: float) -> Step[OptionState]:
        """Go from t to t + h."""
        if t < self.damped_until:
            damping = ImplicitEuler(self.stage)
            middle = damping.step(t, state, h / 2).state
            return damping.step(t + h / 2, middle, h / 2)
        base = state.value + 0.5 * h * self._rate(t, state)
        end = self.stage.solve(t + h, base, 0.5 * h, state)
        return Step(end, np.ravel(end.value))

    def _rate(self, t: float, state: OptionState) -> Vector:
        """Return L v + e, continued beyond an exercise boundary inside a cell as the stages do."""
        form = self.stage.form.at(t)
        rate = form.operator.times(state.value) + end_forcing(form.operator, form.ends(t))
        return rate if state.continued is None else rate + state.continued


def damped_until(steps_end: list[float]) -> float:
    """Return the end of the damped part of a prescribed mesh of times, or of its only step."""
    return steps_end[min(DAMPED_STEPS, len(steps_end) - 1)]
