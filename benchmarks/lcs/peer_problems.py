"""Systems on which other software is run beside ours: a regulated converter, and a column of beads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.lcs.problems import KnownProblem
from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import LCS, JoinedExosystem, piecewise_linear, pulses, simulate
from pricing_core.models import MechanicalSystem, RelaySystem

# The values of Siconos' example "BuckConverter" (siconos-tutorials, examples/electronics, Apache licence 2.0).
SUPPLY, SETPOINT, SETTLING = 3.0, 1.8, 100e-6
CAPACITANCE, INDUCTANCE, LOAD = 22e-6, 10e-6, 10.0
R11, R12, R21, C11, C21 = 15.58e3, 227.8e3, 5.613e6, 20e-12, 1.9e-12
GAIN, BANDWIDTH = 10e3, 2.0 * 3.14159 * 30e6
STEP_BAND, THRESHOLD, CONDUCTION, DIODE = 0.1, 2.0, 10.0, 0.8
RAMP = {"low": 0.0, "high": 2.25, "period": 1.6667e-6, "width": 1e-9, "rise": 1.655e-6, "fall": 10e-9}
CONVERTER_TIMES = (0.5e-6, 1e-6, 2e-6, 4e-6)


def regulated_converter() -> KnownProblem:
    """Return a buck converter with its compensator, amplifier, comparator and two transistors, all piecewise linear.

    States: output voltage, inductor current, two voltages of the compensator, output of the amplifier. The twelve pairs
    are the two corners of the comparator, the two pieces of each transistor in either direction, and the two diodes.
    The exact states are those of the run from event to event: other methods must come to them as their steps shrink.
    """
    system = LCS(*_converter_matrices(), *_converter_inputs())
    times = np.array(CONVERTER_TIMES)
    exact = simulate(system, np.zeros(5), (0.0, float(times[-1])), t_eval=times).x
    scale = np.maximum(np.abs(exact).max(axis=0), 1e-9)
    return KnownProblem(
        "regulated converter", system, np.zeros(5), times, exact, scale, ("implicit-euler", "sdirk2")
    )


def _converter_matrices() -> tuple[Matrix, Matrix, Matrix, Matrix]:
    sides = 1 / R11 + 1 / R12
    node = sides + 1 / R21  # conductance of the amplifier's inverting input
    # The voltage of that input as a function of the states.
    inner = np.array([sides, 0.0, -1 / R11, -1 / R21, 1 / R21]) / node
    A = np.zeros((5, 5))
    A[0] = [-1 / (LOAD * CAPACITANCE), 1 / CAPACITANCE, 0, 0, 0]
    A[0] -= np.array([sides, 0, -1 / R11, sides, -sides]) / (R21 * CAPACITANCE * node)
    A[1, 0] = -1 / INDUCTANCE
    A[2] = (np.array([1, 0, -1, 0, 0]) - inner) / (R11 * C11)
    A[3] = (np.array([0, 0, 0, -1, 1]) - inner) / (R21 * C21)
    A[4] = -GAIN * BANDWIDTH * inner
    A[4, 3] = GAIN * BANDWIDTH / (node * R21)
    A[4, 4] -= BANDWIDTH
    reach = (SUPPLY - THRESHOLD) / (2.0 * (1.0 + math.sqrt(2.0)))
    pieces = np.array([2.0 * reach, 4.0 * math.sqrt(2.0) * reach])  # slopes that x**2 gains at 0 and later
    slope = SUPPLY / (2.0 * STEP_BAND)
    D = np.eye(12)
    ways = np.array([0, 0, 1, 1])  # towards the supply or the ground, and back
    for first, sign in ((2, 1.0), (6, -1.0)):
        rows = slice(first, first + 4)
        D[rows, 0], D[rows, 1], D[rows, 11] = sign * slope, -sign * slope, -sign * ways
        D[11, rows] = -sign * CONDUCTION / 2.0 * np.concatenate([pieces, -pieces])
    D[10, 10], D[10, 11], D[11, 10], D[11, 11] = 0.0, -1.0, 1.0, 0.0
    B, C = np.zeros((5, 12)), np.zeros((12, 5))
    B[1, 11] = 1 / INDUCTANCE
    C[:2, 4], C[11, 1] = 1.0, 1.0
    return A, B, C, D


def _converter_inputs() -> tuple[JoinedExosystem, JoinedExosystem]:
    """Return f and g as outputs of the ramp, the setpoint, and a constant."""
    reach = (SUPPLY - THRESHOLD) / (2.0 * (1.0 + math.sqrt(2.0)))
    corners = np.array([0.0, (1.0 + math.sqrt(2.0)) * reach] * 2)
    back = np.array([0.0, 0.0, 1.0, 1.0])
    constant = np.concatenate(
        [
            [-STEP_BAND, STEP_BAND],
            THRESHOLD - SUPPLY * (1.0 - back) + DIODE * back + corners,
            THRESHOLD - DIODE * back + corners,
            [SUPPLY + 2.0 * DIODE, 0.0],
        ]
    )
    parts = (
        pulses(**RAMP),
        piecewise_linear([0.0, SETTLING], [0.0, SETPOINT]),
        piecewise_linear([0.0, 1.0], [1.0, 1.0]),
    )
    f, g = np.zeros((5, 6)), np.zeros((12, 6))  # each part has a value and a slope
    f[1, 4], f[4, 2] = -DIODE / INDUCTANCE, GAIN * BANDWIDTH
    g[:2, 0], g[:, 4] = -1.0, constant
    return JoinedExosystem(parts, f), JoinedExosystem(parts, g)


def dry_friction() -> KnownProblem:
    """Return x'' + x = -sgn x' from (3.3, 0): half a wave about 1, one about -1, and then it sticks at -0.7."""

    def exact(t: float) -> list[float]:
        if t < math.pi:
            return [1.0 + 2.3 * math.cos(t), -2.3 * math.sin(t)]
        if t < 2.0 * math.pi:
            return [-1.0 + 0.3 * math.cos(t), -0.3 * math.sin(t)]
        return [-0.7, 0.0]

    system = RelaySystem([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[0.0, 1.0]]).to_lcs()
    times = np.array([1.0, 3.0, 5.0, 8.0])
    values = np.array([exact(t) for t in times.tolist()])
    return KnownProblem(
        "dry friction", system, np.array([3.3, 0.0]), times, values, np.ones(2), ("implicit-euler", "sdirk2")
    )


@dataclass(frozen=True, slots=True, eq=False)
class Beads:
    """Beads of one mass above each other and the floor, that bounce with a coefficient of restitution."""

    heights: Vector  # (n,)
    velocities: Vector  # (n,)
    restitution: float
    times: Vector  # (m,)
    gravity: float = 9.81

    @property
    def exact(self) -> Matrix:
        """The heights and velocities at the times, shape (m, 2 n): parabolas from one collision to the next."""
        found = []
        q, v, t = self.heights.copy(), self.velocities.copy(), 0.0
        for wanted in self.times.tolist():
            while True:
                wait, pair = self._next(q, v)
                if t + wait >= wanted:
                    break
                q, v, t = *self._flown(q, v, wait), t + wait
                if pair < 0:
                    q[0], v[0] = 0.0, -self.restitution * v[0]
                else:
                    q[pair + 1] = q[pair]
                    mean, half = (
                        (v[pair] + v[pair + 1]) / 2.0,
                        self.restitution * (v[pair] - v[pair + 1]) / 2.0,
                    )
                    v[pair], v[pair + 1] = mean - half, mean + half
            found.append(np.concatenate(self._flown(q, v, wanted - t)))
        return np.array(found)

    def _flown(self, q: Vector, v: Vector, t: float) -> tuple[Vector, Vector]:
        return q + v * t - self.gravity * t * t / 2.0, v - self.gravity * t

    def _next(self, q: Vector, v: Vector) -> tuple[float, int]:
        """Return the time to the next collision, and the lower bead of it, -1 for the floor."""
        floor = (v[0] + math.sqrt(v[0] ** 2 + 2.0 * self.gravity * q[0])) / self.gravity
        waits = [(floor, -1)]
        for i in range(q.size - 1):
            if v[i + 1] < v[i]:
                waits.append((float((q[i + 1] - q[i]) / (v[i] - v[i + 1])), i))
        return min(waits)

    @property
    def gaps(self) -> Matrix:
        """F: the gaps as functions of the heights, shape (n, n)."""
        n = self.heights.size
        return np.eye(n) - np.eye(n, k=-1)

    def system(self) -> MechanicalSystem:
        """Return the beads as our model."""
        n = self.heights.size
        zero = np.zeros((n, n))
        weight = np.full(n, -self.gravity)
        return MechanicalSystem(np.eye(n), zero, zero, self.gaps, force=weight, restitution=self.restitution)


def beads() -> Beads:
    """Return five beads, dropped from different heights."""
    heights = np.array([1.0, 1.3, 1.75, 2.1, 2.8])
    return Beads(heights, np.zeros(5), 0.8, np.array([0.4, 0.6, 0.8, 1.0]))
