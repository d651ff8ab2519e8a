"""Orders of convergence on a linear equation with a known solution: one row per method."""

from dataclasses import dataclass

import numpy as np
import pytest

from pricing_core.stepping import (
    ESDIRK3,
    IMPLICIT_EULER,
    SDIRK2,
    SDIRK3,
    DiagonallyImplicit,
    FixedStep,
    RannacherStart,
    StepDoubling,
    integrate,
    theta_method,
)

A = np.array([[-1.0, 2.0], [-2.0, -1.0]])


@dataclass(frozen=True)
class LinearState:
    value: np.ndarray


class LinearStage:
    """value = base + h A value for x' = A x, the rotation with decay x(t) = e^{-t} R(2t) x(0)."""

    def solve(self, t, base, h, near):
        return LinearState(np.linalg.solve(np.eye(2) - h * A, base))

    def rate(self, t, state):
        return A @ state.value


def exact(t):
    return np.exp(-t) * np.array([np.cos(2 * t), -np.sin(2 * t)])


ORDERS = [
    (IMPLICIT_EULER, 1),
    (theta_method(0.75), 1),
    (theta_method(0.5), 2),
    (SDIRK2, 2),
    (SDIRK3, 3),
    (ESDIRK3, 3),
]
L_STABLE = [IMPLICIT_EULER, SDIRK2, SDIRK3, ESDIRK3]


@pytest.mark.parametrize(("tableau", "order"), ORDERS)
def test_order_of_convergence(tableau, order):
    assert tableau.order == order
    errors = []
    for steps in (10, 20, 40, 80):
        run = integrate(
            DiagonallyImplicit(LinearStage(), tableau),
            LinearState(np.array([1.0, 0.0])),
            (0.0, 1.0),
            controller=FixedStep(1.0 / steps),
        )
        assert run.accepted == steps
        errors.append(np.max(np.abs(run.states[-1].value - exact(1.0))))
    assert -np.polyfit(range(4), np.log2(errors), 1)[0] == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("tableau", [IMPLICIT_EULER, SDIRK2])
def test_step_doubling_estimates_the_local_error(tableau):
    doubled = StepDoubling(DiagonallyImplicit(LinearStage(), tableau))
    assert doubled.order == tableau.order
    for h in (0.1, 0.05, 0.025):
        step = doubled.step(0.0, LinearState(np.array([1.0, 0.0])), h)
        true = step.value - exact(h)
        assert np.linalg.norm(step.error) == pytest.approx(np.linalg.norm(true), rel=0.3)


class Stiff:
    """A decay at 1e8 a unit of time."""

    def solve(self, t, base, h, near):
        return LinearState(base / (1 + 1e8 * h))

    def rate(self, t, state):
        return -1e8 * state.value


@pytest.mark.parametrize("tableau", L_STABLE)
def test_one_step_of_a_very_stiff_decay_goes_almost_to_zero(tableau):
    end = DiagonallyImplicit(Stiff(), tableau).step(0.0, LinearState(np.ones(1)), 1.0)
    assert abs(end.value[0]) < 1e-6


def test_the_tableaux_satisfy_the_order_conditions():
    """sum b c^(k-1) = 1/k up to the order, and A c = c^2/2 at all stages but an implicit first one (stage order 2)."""
    for tableau, order in ORDERS:
        c, b = np.array(tableau.c), np.array([*tableau.a[-1]])
        for k in range(1, order + 1):
            assert b @ c ** (k - 1) == pytest.approx(1.0 / k, abs=1e-12)
        A_ = np.array([[*row, *[0.0] * (len(b) - len(row))] for row in tableau.a])
        if order >= 3:
            assert b @ A_ @ c == pytest.approx(1.0 / 6.0, abs=1e-12)
        if tableau.has_explicit_start and order == 3:
            assert np.allclose(A_ @ c, c * c / 2.0, rtol=0.0, atol=1e-12)


def test_rannachers_start_damps_what_crank_nicolson_keeps():
    crank_nicolson = DiagonallyImplicit(Stiff(), theta_method(0.5))
    damped = RannacherStart(crank_nicolson, DiagonallyImplicit(Stiff(), IMPLICIT_EULER), until=0.5)
    assert damped.order == 2
    state = LinearState(np.ones(1))
    assert abs(crank_nicolson.step(0.0, state, 1.0).value[0]) == pytest.approx(1.0, abs=1e-6)
    assert abs(damped.step(0.0, state, 1.0).value[0]) < 1e-6
    assert abs(damped.step(0.5, state, 1.0).value[0]) == pytest.approx(1.0, abs=1e-6)
