"""Crank-Nicolson with a Rannacher start and an exact LCP at every step: the common method, to compare with."""

from dataclasses import dataclass

import numpy as np

from pricing_core.american.flat.tangents import parameter_source
from pricing_core.american.flat.tridiagonal_step import OptionStage, OptionState
from pricing_core.arrays import Matrix
from pricing_core.stepping import ImplicitEuler, Step

DAMPED_STEPS = 2  # steps that are replaced by two implicit Euler steps of half the size (Rannacher 1984)


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
        """2."""
        return 2

    def step(self, t: float, state: OptionState, h: float) -> Step[OptionState]:
        """Go from t to t + h."""
        if t < self.damped_until:
            damping = ImplicitEuler(self.stage)
            middle = damping.step(t, state, h / 2).state
            return damping.step(t + h / 2, middle, h / 2)
        base = state.value + 0.5 * h * self._rate(t, state.value)
        end = self.stage.solve(t + h, base, 0.5 * h, state)
        return Step(end, np.ravel(end.value))

    def _rate(self, t: float, value: Matrix) -> Matrix:
        """Return L v + e, and for the tangents L dv + de + dL v, shape of `value`."""
        form = self.stage.form
        ends = form.constraint(t, value.shape[0]).ends
        full = np.concatenate([ends[:, :1], value, ends[:, 1:]], axis=1)
        operators = form.operators
        rate = np.stack([operators.operator.apply(row) for row in full])
        if value.shape[0] > 1:
            rate[1:] += parameter_source(operators, full[0])
        return rate


def damped_until(steps_end: list[float]) -> float:
    """Return the end of the damped part of a prescribed mesh of times, or of its only step."""
    return steps_end[min(DAMPED_STEPS, len(steps_end) - 1)]
