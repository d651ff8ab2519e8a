import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, Exosystem, PiecewiseConstant, piecewise_linear, sine
from pricing_core.lcs.autonomous import as_exosystem, autonomous_form


def test_a_sine_has_its_values_and_its_offset():
    signal = sine([2.0, -1.0], frequency=3.0, phase=0.4, offset=[0.5, 0.0])
    t = 0.37
    wave = math.sin(6.0 * math.pi * t + 0.4)
    assert signal.after(t) == pytest.approx([0.5 + 2.0 * wave, -wave], rel=1e-12)
    assert signal.size == 2


def test_a_polyline_passes_through_its_points_and_rests_outside():
    times, values = [0.5, 1.0, 4.0], [[0.0, 1.0], [2.0, 1.0], [-1.0, 7.0]]
    polyline = piecewise_linear(times, values)
    for t in (-1.0, 0.5, 0.7, 1.0, 3.3, 4.0, 9.0):
        expected = [np.interp(t, times, column) for column in np.transpose(values)]
        assert polyline.after(t) == pytest.approx(expected, abs=1e-14)
        assert polyline.before(t) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    "signal",
    [
        PiecewiseConstant([0.0], [[1.0, 0.0]]),
        PiecewiseConstant([0.0], [[0.0, 0.0]]),
        PiecewiseConstant([1.0, 2.0, 3.0], [[1.0, 0.0], [-2.0, 0.0], [0.0, 0.0]]),
    ],
)
def test_piecewise_constant_inputs_are_exosystems(signal):
    same = as_exosystem(signal)
    for t in (-0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 5.0):
        assert same.after(t) == pytest.approx(signal.after(t))
        assert same.before(t) == pytest.approx(signal.before(t))


def test_the_autonomous_form_has_the_inputs_behind_the_state():
    system = LCS([[-1.0]], [[1.0]], [[1.0]], f=sine(2.0, 0.5 / math.pi), g=[3.0])
    form = autonomous_form(system)
    z = form.state_after(np.array([7.0]), 0.3)
    assert (form.states, z.size) == (1, 5)
    rates = form.system.A @ (z / form.units.state) * form.units.rate * form.units.state
    assert rates[0] == pytest.approx(-7.0 + 2.0 * math.sin(0.3))
    slacks = form.system.C @ (z / form.units.state) / form.units.pair
    assert slacks == pytest.approx([7.0 + 3.0])


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("generator", lambda: Exosystem([[0.0, 1.0]], [[1.0]], [1.0])),
        ("output", lambda: Exosystem([[0.0]], [[1.0, 2.0]], [1.0])),
        ("states", lambda: Exosystem([[0.0]], [[1.0]], [[1.0], [2.0]])),
        ("times", lambda: Exosystem([[0.0]], [[1.0]], [[1.0], [2.0]], times=[1.0, 1.0])),
        ("times", lambda: piecewise_linear([1.0, 0.0], [0.0, 1.0])),
        ("values", lambda: piecewise_linear([0.0, 1.0], [0.0, 1.0, 2.0])),
        ("f", lambda: LCS([[0.0]], [[1.0]], [[1.0]], f=sine([1.0, 2.0], 1.0))),
    ],
)
def test_what_does_not_fit_is_refused_by_name(field, make):
    with pytest.raises(InvalidInputError, match=field):
        make()
