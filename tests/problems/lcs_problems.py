"""Linear complementarity systems with exact trajectories."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.lcs import LCS, PiecewiseConstant


@dataclass(frozen=True)
class LCSProblem:
    name: str
    system: LCS
    x0: tuple[float, ...]
    times: tuple[float, ...]
    exact: Callable[[float], np.ndarray]  # the state at t
    scale: tuple[float, ...]  # natural size of each state
    relative_degree: int


def diode_bridge() -> LCSProblem:
    """Four ideal diodes, a resistor, and an LC oscillator (an example of the Siconos project).

    An ideal bridge makes its load look linear, so (v, i) is one damped oscillation:
    v' = -i/C - v/(R C), i' = v/L. G_II is singular for two modes, yet x and u are unique.
    """
    L, C, R = 1e-2, 1e-6, 1e3
    system = LCS(
        [[0, -1 / C], [1 / L, 0]],
        [[0, 0, -1 / C, 1 / C], [0, 0, 0, 0]],
        [[0, 0], [0, 0], [-1, 0], [1, 0]],
        [[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]],
    )
    a = 1 / (2 * R * C)
    w = math.sqrt(1 / (L * C) - a * a)
    k = (-10 / (2 * R * C)) / w

    def exact(t: float) -> np.ndarray:
        decay, c, s = math.exp(-a * t), math.cos(w * t), math.sin(w * t)
        v = decay * (10 * c + k * s)
        # i = (C v' + v/R) with the sign of v' = -i/C - v/(R C)
        slope = decay * ((-10 * a + k * w) * c - (k * a + 10 * w) * s)
        return np.array([v, -C * slope - v / R])

    times = (1e-6, 1e-4, 3e-4, 5e-4, 1e-3)
    return LCSProblem("diode bridge", system, (10.0, 0.0), times, exact, (10.0, 0.1), 1)


def particle_on_the_half_line() -> LCSProblem:
    """x' = -1 + u, 0 <= x _|_ u >= 0 from 1/2: down to 0, then at rest."""
    system = LCS([[0.0]], [[1.0]], [[1.0]], f=[-1.0])
    return LCSProblem(
        "half line", system, (0.5,), (0.2, 0.5, 0.9), lambda t: np.array([max(0.5 - t, 0.0)]), (1.0,), 1
    )


def two_capacitors() -> LCSProblem:
    """C1 = 1 at 3 V and C2 = 2 at 0 V joined by a diode: a jump to (C1 v1 + C2 v2)/(C1 + C2) = 1 V."""
    system = LCS(np.zeros((2, 2)), [[-1.0], [0.5]], [[-1.0, 1.0]])
    return LCSProblem(
        "two capacitors", system, (3.0, 0.0), (0.0, 0.5, 1.0), lambda t: np.ones(2), (1.0, 1.0), 1
    )


def diode_rectifier() -> LCSProblem:
    """x' = -x + u, u = max(0, 1 - x) through D = 1: x' = -x + u, y = x - 1 + u: relative degree 0, x -> 1/2."""
    system = LCS([[-1.0]], [[1.0]], [[1.0]], [[1.0]], g=[-1.0])
    return LCSProblem(
        "resistive diode",
        system,
        (0.0,),
        (0.25, 0.5, 1.0),
        lambda t: np.array([0.5 * (1 - math.exp(-2 * t))]),
        (1.0,),
        0,
    )


def falling_ball() -> LCSProblem:
    """A ball dropped from height 1: an inelastic hit at sqrt(2/g), then rest with u = g."""
    g = 9.81
    system = LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], f=[0, -g])

    def exact(t: float) -> np.ndarray:
        if t * t >= 2 / g:
            return np.zeros(2)
        return np.array([1 - g * t * t / 2, -g * t])

    return LCSProblem("falling ball", system, (1.0, 0.0), (0.2, 0.4, 0.6, 1.0), exact, (1.0, 5.0), 2)


def pulled_particle() -> LCSProblem:
    """x' = f + u, x >= 0, f = -1 up to t = 1, then 2; the wall moves from 0 to 3 at t = 3/2: a jump to 3."""
    system = LCS(
        [[0.0]],
        [[1.0]],
        [[1.0]],
        f=PiecewiseConstant([1.0, 9.0], [[-1.0], [2.0]]),
        g=PiecewiseConstant([1.5, 9.0], [[0.0], [-3.0]]),
    )

    def exact(t: float) -> np.ndarray:
        if t < 1.0:
            return np.array([max(0.5 - t, 0.0)])
        return np.array([2 * (t - 1.0) if t < 1.5 else 3.0 + 2 * (t - 1.5)])

    return LCSProblem("pulled particle", system, (0.5,), (0.25, 1.0, 1.25, 1.5, 2.0), exact, (1.0,), 1)


def two_relays() -> LCS:
    """x1' = -sgn x1 + 2 sgn x2, x2' = -2 sgn x1 - sgn x2 (Schumacher, example 11.1).

    sgn x_i = 1 - u_a, with 0 <= x_i + u_b _|_ u_a >= 0 and 0 <= 2 - u_a _|_ u_b >= 0: u_b is the negative
    part of x_i. The pairs are ordered (u_a, u_b) for x1, then for x2.
    """
    rates = np.array([[-1.0, 2.0], [-2.0, -1.0]])
    B, C = np.zeros((2, 4)), np.zeros((4, 2))
    B[:, ::2], C[::2] = -rates, np.eye(2)
    D = np.kron(np.eye(2), [[0.0, 1.0], [-1.0, 0.0]])
    return LCS(np.zeros((2, 2)), B, C, D, f=rates.sum(axis=1), g=[0.0, 2.0, 0.0, 2.0])


def problems() -> list[LCSProblem]:
    return [
        diode_bridge(),
        particle_on_the_half_line(),
        two_capacitors(),
        diode_rectifier(),
        falling_ball(),
        pulled_particle(),
    ]
