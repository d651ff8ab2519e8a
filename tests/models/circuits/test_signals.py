"""All sources together are the output of one exosystem."""

import numpy as np
import pytest

from pricing_core.lcs import Exosystem, piecewise_linear
from pricing_core.models import PiecewiseConstant, Sine
from pricing_core.models.circuits.signals import stacked

STEP = PiecewiseConstant([0.5, 1.0], [1.0, 3.0])
RAMP = piecewise_linear([0.0, 1.0, 2.0], [0.0, 2.0, 0.0])
VALUES = (5, Sine(2.0, 3.0, 0.4, 1.0), Sine(1.0, 3.0), Sine(1.0, 7.0), STEP, RAMP)


@pytest.mark.parametrize("t", [-1.0, 0.0, 0.25, 0.5, 0.9, 1.5, 4.0])
def test_every_component_has_its_own_value(t):
    def sine(value: Sine) -> float:
        return value.offset + value.amplitude * np.sin(2 * np.pi * value.frequency * t + value.phase)

    expected = [5.0, *(sine(v) for v in VALUES[1:4]), STEP.after(t)[0], RAMP.after(t)[0]]
    assert stacked(VALUES).after(t) == pytest.approx(expected, abs=1e-12)


def test_states_are_shared_where_they_can_be():
    both = stacked(VALUES)
    assert both.generator.shape == (1 + 2 + 2 + 1 + 2, 1 + 2 + 2 + 1 + 2)  # constant, 3 Hz, 7 Hz, step, ramp
    assert set(both.jumps) == {0.0, 0.5, 1.0, 2.0}


def test_no_sources_are_an_exosystem_without_output():
    assert stacked([]).size == 0


def test_an_exosystem_is_taken_as_it_is():
    decay = Exosystem([[-1.0]], [[3.0]], [1.0])
    assert stacked([decay, 2.0]).after(1.0) == pytest.approx([3.0 / np.e, 2.0])
