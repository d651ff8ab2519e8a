"""Nonlinear complementarity systems with exact trajectories."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.lcs import LCS, SemiExplicitSystem


@dataclass(frozen=True)
class SemiExplicitProblem:
    name: str
    system: SemiExplicitSystem
    x0: tuple[float, ...]
    smooth_until: float  # before the first switch
    end: float
    exact: Callable[[float], np.ndarray]


def quadratic_fall() -> SemiExplicitProblem:
    """x' = -1 - x**2 + u, 0 <= x _|_ u >= 0 from 1: tan(pi/4 - t), then 0: relative degree 1."""
    system = SemiExplicitSystem(lambda x, u: u - 1.0 - x**2, lambda x, u: x, 1)
    return SemiExplicitProblem(
        "quadratic fall", system, (1.0,), 0.75, 2.0, lambda t: np.array([math.tan(max(math.pi / 4 - t, 0.0))])
    )


def sliding_on_the_disc() -> SemiExplicitProblem:
    """x' = (-x2, x1) - x/|x| + u x, y = (|x|**2 - 1)/2: drawn inwards, and kept outside the unit disc.

    The angle grows at rate 1, the radius falls from 2 at rate 1, to 1.
    """

    def f(x, u):
        return np.array([-x[1], x[0]]) - x / np.hypot(*x) + u[0] * x

    def exact(t: float) -> np.ndarray:
        return max(2.0 - t, 1.0) * np.array([math.cos(t), math.sin(t)])

    system = SemiExplicitSystem(f, lambda x, u: np.array([(x @ x - 1.0) / 2.0]), 1)
    return SemiExplicitProblem("disc", system, (2.0, 0.0), 0.95, 2.0, exact)


def hyperbolic_diode() -> SemiExplicitProblem:
    """x' = sinh u, y = sinh u - (1 - x), from 0: u = arsinh(1 - x), x = 1 - exp(-t): relative degree 0."""
    system = SemiExplicitSystem(
        lambda x, u: np.sinh(u),
        lambda x, u: np.sinh(u) - 1.0 + x,
        1,
        f_jacobian=lambda x, u: (np.zeros((1, 1)), np.diag(np.cosh(u))),
        h_jacobian=lambda x, u: (np.eye(1), np.diag(np.cosh(u))),
    )
    return SemiExplicitProblem(
        "hyperbolic diode", system, (0.0,), 1.0, 1.0, lambda t: np.array([1.0 - math.exp(-t)])
    )


def problems() -> list[SemiExplicitProblem]:
    return [quadratic_fall(), sliding_on_the_disc(), hyperbolic_diode()]


def as_semi_explicit(system: LCS) -> SemiExplicitSystem:
    """A linear system with constant inputs as a nonlinear one, with derivatives by differences."""
    f, g = system.f.after(0.0), system.g.after(0.0)
    return SemiExplicitSystem(
        lambda x, u: system.A @ x + system.B @ u + f,
        lambda x, u: system.C @ x + system.D @ u + g,
        system.shape[1],
    )
