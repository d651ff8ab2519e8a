"""What ends a configuration of a switched system besides time: functions of its state that become negative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.kernel import initial_signs
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.mode_dynamics import ModeDynamics, State

ROUNDING = 1e-9  # share of its terms below which a guard is zero, and its derivative decides


@dataclass(frozen=True, slots=True, eq=False)
class Guards:
    """G_z z + G_u u, in the units given, z = (x, w) with the states w of the inputs.

    Parameters
    ----------
    of_states : Matrix, shape (g, N)
    of_multipliers : Matrix, shape (g, k)
    """

    of_states: Matrix
    of_multipliers: Matrix

    def rows(self, form: AutonomousForm, dynamics: ModeDynamics) -> Matrix:
        """Return the guards as functions of the coordinates of a mode, shape (g, d), each of unit size."""
        u = np.where(dynamics.active[:, None], dynamics.outputs, 0.0)
        states, pairs = self.of_states * form.units.state, self.of_multipliers * form.units.pair
        rows = states @ dynamics.basis + pairs @ u
        sizes = np.abs(rows).max(axis=1, initial=0.0)
        return np.asarray(rows / np.where(sizes > 0.0, sizes, 1.0)[:, None])


def signs_of(rows: Matrix, dynamics: ModeDynamics, c: State) -> Vector:
    """Return the sign of each function just after the coordinates are c: of its first derivative that is not zero."""
    derivatives = [rows]
    for _ in range(min(dynamics.rate.shape[0], 2)):
        derivatives.append(derivatives[-1] @ dynamics.scaled_rate)
    table = np.ascontiguousarray(np.array(derivatives))
    return np.asarray(initial_signs(table, dynamics.scaled_rate, c.z, c.sizes, ROUNDING, ROUNDING))
