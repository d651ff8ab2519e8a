"""The motion of a Hamiltonian system over one step, with the impacts located in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import IterationLimitError
from pricing_core.models.hamiltonian_flow import HamiltonianFlow

CLOSED = 1e-10  # gap that is none, as a share of the size of the state
SLOW = 1e-10  # speed that is none, in the same way
DIED_OUT = 1e-3  # what is left of a speed after so many impacts that the rest of them is left out
MOST_IMPACTS = 5_000
LOCATED = 1e-14  # share of the step


@dataclass(frozen=True, slots=True, eq=False)
class MotionWithImpacts:
    """Steps of the flow that end at each impact, and go on after it."""

    flow: HamiltonianFlow
    restitution: float
    length: float  # of a whole step

    def advance(self, z: Vector, h: float, t: float) -> tuple[Vector, Vector]:
        """Return the state after h, at time t, and the impulses (k,).

        Raises
        ------
        IterationLimitError
            Thousands of impacts do not end.
        """
        total = np.zeros(self.flow.k)
        most = self._impacts_until_rest()
        for count in range(MOST_IMPACTS + most):
            closed = self.flow.gaps(z) <= closed_gap(self.flow, z)
            slow = SLOW * (1.0 + float(np.abs(self.flow.velocity(z)).max()))
            if (closed & (self.flow.speeds(z) < -slow)).any():
                z, impulse = self._strike(z, closed, slow, t, plastic=count >= most)
                total += impulse
            resting: BoolVector = closed & (self.flow.speeds(z) <= slow)
            after, impulse, share = self._until_contact(z, h, closed, resting, t)
            z, total, h = after, total + impulse, h * (1.0 - share)
            if share == 1.0:
                return z, total
        raise IterationLimitError(f"{MOST_IMPACTS} impacts in the step to t = {t:.9g}: take more steps")

    def _impacts_until_rest(self) -> int:
        """Return after how many impacts in one step the speeds of all contacts have died out."""
        e = self.restitution
        each = 2 if e == 0.0 else MOST_IMPACTS if e == 1.0 else 2 + int(math.log(DIED_OUT) / math.log(e))
        return min(2 * max(self.flow.k, 1) * each, MOST_IMPACTS)

    def _strike(
        self, z: Vector, closed: BoolVector, slow: float, t: float, *, plastic: bool
    ) -> tuple[Vector, Vector]:
        """Return the state after an impact; without rebound where the flights that follow end within a step."""
        e = self.restitution
        rebound = np.full(self.flow.k, 0.0 if plastic and e < 1.0 else e)
        after, impulse = self.flow.strike(z, closed, rebound, t)
        if not 0.0 < e < 1.0 or plastic:
            return after, impulse
        speeds, h = self.flow.speeds(after), self.length
        resting = closed & (speeds <= slow)
        bends = (self.flow.speeds(self.flow.step(after, h, resting, t)[0]) - speeds) / h
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing brings the contact back
            duration = np.where(bends < 0.0, 2.0 * speeds / (-bends * (1.0 - e)), np.inf)
        ends = closed & (speeds > slow) & (duration <= h)
        if not ends.any():
            return after, impulse
        return self.flow.strike(z, closed, np.where(ends, 0.0, rebound), t)

    def _until_contact(
        self, z: Vector, h: float, closed: BoolVector, resting: BoolVector, t: float
    ) -> tuple[Vector, Vector, float]:
        """Return the state at the first new contact, or after h, with the impulses and the share of h that passed."""
        after, impulse = self.flow.step(z, h, resting, t)
        ends = self.flow.gaps(after)
        through = ~resting & (ends < -closed_gap(self.flow, after))
        if not through.any():
            return after, impulse, 1.0
        speeds, shares = self.flow.speeds(z), []
        for i in np.flatnonzero(through).tolist():
            rise = float(h * speeds[i])
            lowest = rise / (2.0 * (rise - float(ends[i]))) if closed[i] else 0.0
            if lowest < 0.0 or self._gap(lowest, z, h, resting, t, i) <= 0.0:  # a flight of rounding size
                return self._until_contact(z, h, closed, resting | (np.arange(self.flow.k) == i), t)
            shares.append(
                brentq(self._gap, lowest, 1.0, args=(z, h, resting, t, i), xtol=LOCATED, rtol=LOCATED)
            )
        share = float(min(shares))
        return *self.flow.step(z, share * h, resting, t), share

    def _gap(self, share: float, z: Vector, h: float, resting: BoolVector, t: float, i: int) -> float:
        """Return a gap after a share of h."""
        reached = self.flow.step(z, share * h, resting, t)[0] if share > 0.0 else z
        return float(self.flow.gaps(reached)[i])


def closed_gap(flow: HamiltonianFlow, z: Vector) -> Vector:
    """Return the gaps that count as closed, shape (k,)."""
    q = z[: z.size // 2]
    return np.asarray(CLOSED * max(1.0, float(np.abs(q).max())) * np.abs(flow.normals(q)).sum(axis=1))
