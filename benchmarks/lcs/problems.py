"""Linear complementarity systems whose exact states are known, for measuring how far a simulation is off."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import LCS
from pricing_core.lcs.time_stepping import Scheme


@dataclass(frozen=True, slots=True, eq=False)
class KnownProblem:
    """A system, where it starts, and its exact states at some times.

    `scale` is the natural size of each state: errors are fractions of it. `schemes` are those that converge.
    """

    name: str
    system: LCS
    x0: Vector  # (n,)
    times: Vector  # (m,)
    exact: Matrix  # (m, n)
    scale: Vector  # (n,)
    schemes: tuple[Scheme, ...]

    def error(self, x: Matrix) -> float:
        """Return the largest error at the times, a fraction of each state's size."""
        return float(np.max(np.abs(x - self.exact) / self.scale))


def diode_bridge() -> KnownProblem:
    """Return four ideal diodes, which make the load look linear: (v, i) is one damped oscillation."""
    L, C, R = 1e-2, 1e-6, 1e3
    system = LCS(
        [[0, -1 / C], [1 / L, 0]],
        np.array([[0, 0, -1 / C, 1 / C], [0, 0, 0, 0]]),
        [[0, 0], [0, 0], [-1, 0], [1, 0]],
        np.array([[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]]),
    )
    oscillation = np.array([[-1 / (R * C), -1 / C], [1 / L, 0.0]])
    x0, times = np.array([10.0, 0.0]), np.array([1e-4, 3e-4, 5e-4, 1e-3])
    exact = np.array([expm(oscillation * t) @ x0 for t in times])
    return KnownProblem(
        "diode bridge", system, x0, times, exact, np.array([10.0, 0.1]), ("implicit-euler", "sdirk2")
    )


def filtered_bridge() -> KnownProblem:
    """Return the bridge with a capacitor beside its load, off its constraints: it jumps, conducts, and parts.

    Charge is shared at t = 0; then the two capacitors are one until the current through the diodes, Cf v' + v/R, is
    zero; then the oscillator is free and the filter discharges, up to 1e-4 and beyond.
    """
    L, C, R, Cf = 1e-2, 1e-6, 1e3, 3e-7
    system = LCS(
        [[0, -1 / C, 0], [1 / L, 0, 0], [0, 0, -1 / (R * Cf)]],
        np.array([[0, 0, -1 / C, 1 / C], [0, 0, 0, 0], [1 / Cf, 0, 1 / Cf, 0]]),
        [[0, 0, 1], [0, 0, 0], [-1, 0, 1], [1, 0, 0]],
        [[0, -1, 0, 0], [1, 0, 1, -1], [0, -1, 0, 0], [0, 1, 0, 0]],
    )
    both = np.array([[-1 / (R * (C + Cf)), -1 / (C + Cf)], [1 / L, 0.0]])
    shared = np.array([10.0 * C / (C + Cf), 0.0])

    def current(t: float) -> float:
        v, i = expm(both * t) @ shared
        return float(Cf * (-v / R - i) / (C + Cf) + v / R)

    parting = float(brentq(current, 1e-6, 1e-4, xtol=1e-20, rtol=1e-15))
    free = np.array([[0.0, -1 / C], [1 / L, 0.0]])

    def exact(t: float) -> list[float]:
        v, i = expm(both * min(t, parting)) @ shared
        after = max(t - parting, 0.0)
        return [*(expm(free * after) @ [v, i]), v * math.exp(-after / (R * Cf))]

    times = np.array([1e-6, 2e-5, 5e-5, 1e-4])
    values = np.array([exact(t) for t in times])
    scale = np.array([10.0, 0.1, 10.0])
    x0 = np.array([10.0, 0.0, 0.0])
    return KnownProblem("bridge with filter", system, x0, times, values, scale, ("implicit-euler", "sdirk2"))


def two_relays() -> KnownProblem:
    """Return example 11.1, x1' = -sgn x1 + 2 sgn x2, x2' = -2 sgn x1 - sgn x2, from (3, 1)."""
    rates = np.array([[-1.0, 2.0], [-2.0, -1.0]])
    B, C = np.zeros((2, 4)), np.zeros((4, 2))
    B[:, ::2], C[::2] = -rates, np.eye(2)
    D = np.kron(np.eye(2), [[0.0, 1.0], [-1.0, 0.0]])
    system = LCS(np.zeros((2, 2)), B, C, D, f=rates.sum(axis=1), g=[0.0, 2.0, 0.0, 2.0])
    times = np.array([1.0, 1.5, 1.9])
    exact = np.array([[4 / 3, -2 / 3], [-1 / 18, -17 / 18], [-31 / 270, 23 / 270]])
    x0 = np.array([3.0, 1.0])
    return KnownProblem("two relays", system, x0, times, exact, np.ones(2), ("implicit-euler", "sdirk2"))


def two_carts() -> KnownProblem:
    """Return example 11.3: together off the wall, a stop, apart, and together again; the velocities jump twice."""
    system = LCS(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -1, 0, 0]],
        [[0, 0], [0, 0], [1, 1], [0, -1]],
        [[1, 0, 0, 0], [1, -1, 0, 0]],
    )
    root = math.sqrt(2.0)
    stop, meeting = math.pi * root, math.pi * root + math.pi

    def together(a: float, t: float) -> list[float]:
        return [a * root * math.sin(t / root)] * 2 + [a * math.cos(t / root)] * 2

    def apart(a: float, t: float) -> list[float]:
        return [0.0, -a * math.sin(t), 0.0, -a * math.cos(t)]

    times = np.array([2.0, 6.0, 9.0])
    exact = np.array([together(0.5, 2.0), apart(0.5, 6.0 - stop), together(0.25, 9.0 - meeting)])
    x0 = np.array([0.0, 0.0, 0.5, 0.5])
    return KnownProblem("two carts", system, x0, times, exact, np.ones(4), ("implicit-euler",))


PROBLEMS: Mapping[str, Callable[[], KnownProblem]] = {
    "diode bridge": diode_bridge,
    "bridge with filter": filtered_bridge,
    "two relays": two_relays,
    "two carts": two_carts,
}


def passive_network(n: int, k: int, seed: int = 0) -> LCS:
    """Return a random passive system: A = S - S^T - G G^T / 2, C = B^T, D = 0, with a random constant input."""
    random = np.random.default_rng(seed)
    S, G = random.normal(size=(2, n, n)) / math.sqrt(n)
    B = random.normal(size=(n, k)) / math.sqrt(n)
    return LCS(S - S.T - 0.5 * G @ G.T, B, B.T, f=random.normal(size=n))


def integer_system(n: int, k: int, kind: str, seed: int = 0) -> LCS:
    """Return a system with entries from -3 to 3: "any", "no feedthrough" (D = 0), or "dominant" (D a P-matrix)."""
    random = np.random.default_rng(seed)
    A, B, C, D = (random.integers(-3, 4, shape) for shape in ((n, n), (n, k), (k, n), (k, k)))
    if kind == "dominant":
        np.fill_diagonal(D, 1 + np.abs(D).sum(axis=1))
    return LCS(A, B, C, np.zeros_like(D) if kind == "no feedthrough" else D)
