import numpy as np
import pytest

from pricing_core.stepping import FixedStep, IController, PIController

VALUE = np.array([1.0, 100.0])


def test_fixed_step_accepts_everything():
    decision = FixedStep(0.5).decide(VALUE, None, 0.5, 1, 0.0)
    assert decision.accept
    assert decision.next_h == 0.5


@pytest.mark.parametrize("controller", [IController(0.0, 1e-3), PIController(0.0, 1e-3)])
def test_large_errors_are_rejected_and_small_ones_let_the_step_grow(controller):
    bad = controller.decide(VALUE, np.array([8e-3, 0.0]), 0.1, 2, 1.0)
    good = controller.decide(VALUE, np.array([0.0, 1e-6]), 0.1, 2, 1.0)
    assert not bad.accept
    assert bad.scaled_error == pytest.approx(8.0)
    assert bad.next_h == pytest.approx(0.1 * 0.9 * 8.0 ** (-1 / 3))
    assert good.accept
    assert good.next_h > 0.1


def test_errors_are_scaled_by_absolute_and_relative_tolerance():
    decision = IController(1e-3, 1e-3).decide(VALUE, np.array([0.0, 0.1]), 0.1, 1, 0.0)
    assert decision.scaled_error == pytest.approx(0.1 / (1e-3 + 1e-3 * 100.0))


def test_growth_is_limited():
    controller = IController(0.0, 1.0)
    assert controller.decide(VALUE, np.zeros(2), 0.1, 1, 0.0).next_h == pytest.approx(0.4)
    assert controller.decide(VALUE, np.array([1e9, 0.0]), 0.1, 1, 0.0).next_h == pytest.approx(0.01)
    assert not controller.decide(VALUE, np.array([np.nan, 0.0]), 0.1, 1, 0.0).accept


def test_the_proportional_part_slows_growth_while_the_error_rises():
    controller = PIController(0.0, 1.0)
    rising = controller.decide(VALUE, np.array([0.5, 0.0]), 0.1, 2, 0.05)
    falling = controller.decide(VALUE, np.array([0.5, 0.0]), 0.1, 2, 0.9)
    assert rising.next_h < falling.next_h
