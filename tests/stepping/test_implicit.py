"""Orders of convergence on a linear equation with a known solution: one row per method."""

from dataclasses import dataclass

import numpy as np
import pytest

from pricing_core.stepping import FixedStep, ImplicitEuler, Sdirk2, StepDoubling, integrate

A = np.array([[-1.0, 2.0], [-2.0, -1.0]])


@dataclass(frozen=True)
class LinearState:
    value: np.ndarray


class LinearStage:
    """value = base + h A value for x' = A x, the rotation with decay x(t) = e^{-t} R(2t) x(0)."""

    def solve(self, t, base, h, near):
        return LinearState(np.linalg.solve(np.eye(2) - h * A, base))


def exact(t):
    return np.exp(-t) * np.array([np.cos(2 * t), -np.sin(2 * t)])


@pytest.mark.parametrize(("method", "order"), [(ImplicitEuler, 1), (Sdirk2, 2)])
def test_order_of_convergence(method, order):
    errors = []
    for steps in (20, 40, 80, 160):
        run = integrate(
            method(LinearStage()),
            LinearState(np.array([1.0, 0.0])),
            (0.0, 1.0),
            controller=FixedStep(1.0 / steps),
        )
        assert run.accepted == steps
        errors.append(np.max(np.abs(run.states[-1].value - exact(1.0))))
    assert -np.polyfit(range(4), np.log2(errors), 1)[0] == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(("method", "order"), [(ImplicitEuler, 1), (Sdirk2, 2)])
def test_step_doubling_estimates_the_local_error(method, order):
    doubled = StepDoubling(method(LinearStage()))
    assert doubled.order == order
    for h in (0.1, 0.05, 0.025):
        step = doubled.step(0.0, LinearState(np.array([1.0, 0.0])), h)
        true = step.value - exact(h)
        assert np.linalg.norm(step.error) == pytest.approx(np.linalg.norm(true), rel=0.3)


@pytest.mark.parametrize("method", [ImplicitEuler, Sdirk2])
def test_methods_are_l_stable(method):
    """One step of a very stiff decay goes to (almost) zero without changing sign much."""

    class Stiff:
        def solve(self, t, base, h, near):
            return LinearState(base / (1 + 1e8 * h))

    assert abs(method(Stiff()).step(0.0, LinearState(np.ones(1)), 1.0).value[0]) < 1e-6
