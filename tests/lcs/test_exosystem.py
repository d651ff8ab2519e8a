import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import (
    LCS,
    Exosystem,
    JoinedExosystem,
    PiecewiseConstant,
    piecewise_linear,
    pulses,
    sine,
)
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


@pytest.mark.parametrize("seed", range(6))
def test_a_train_of_pulses_is_the_polyline_through_its_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high, delay = rng.normal(size=3)
    rise, width, fall, rest = rng.uniform(0.1, 1.0, 4)
    period = rise + width + fall + rest
    train = pulses(low, high, period, width, rise, fall, delay)
    corners = delay + np.cumsum([0.0, rise, width, fall])
    times = np.concatenate([corners + j * period for j in range(6)])
    polyline = piecewise_linear(times, np.tile([low, high, high, low], 6))
    for t in rng.uniform(delay - 2.0, delay + 5.9 * period, 60).tolist():
        assert train.after(t) == pytest.approx(polyline.after(t), abs=1e-12)
    assert train.knots(delay - 1.0, delay + 5.5 * period) == pytest.approx(
        times[(times > delay - 1.0) & (times < delay + 5.5 * period)], abs=1e-12
    )


def test_steps_of_a_train_are_told_apart_after_a_hundred_thousand_periods() -> None:
    train = pulses(0.0, 1.0, period=1e-5, width=3e-6)
    late = train.knots(0.99999, 1.0)
    assert late == pytest.approx([0.99999 + 3e-6], abs=1e-15)
    assert (train.before(late[0]), train.after(late[0])) == (1.0, 0.0)
    for step in train.knots(0.9998, 0.99985).tolist():
        assert train.before(step) != train.after(step)


def test_what_is_no_train_is_refused() -> None:
    with pytest.raises(
        InvalidInputError, match=r"period = 1.0: must be longer than rise, width and fall, 1.5"
    ):
        pulses(0, 1, period=1, width=1, rise=0.5)
    with pytest.raises(InvalidInputError, match=r"parts\[1\] = int: must be an Exosystem"):
        JoinedExosystem([sine(1.0, 50.0), 3], [[1.0]])  # type: ignore[list-item]
    with pytest.raises(
        InvalidInputError, match=r"period = 1: must be longer than the times that are repeated"
    ):
        Exosystem([[0.0]], [[1.0]], [[0.0], [1.0], [2.0]], [0.0, 1.0, 3.0], period=1)
