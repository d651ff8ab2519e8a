import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, NumericalError, StepSizeError
from pricing_core.stepping import FixedStep, IController, PIController, Step, StepDoubling, integrate


class Decay:
    """Implicit midpoint for x' = -x."""

    order = 2

    def step(self, t, x, h):
        y = x * (1 - h / 2) / (1 + h / 2)
        return Step(y, y)


class Relax:
    """Implicit midpoint for the stiff x' = -100 (x - cos t)."""

    order = 2

    def step(self, t, x, h):
        y = (x * (1 - 50 * h) + 100 * h * math.cos(t + h / 2)) / (1 + 50 * h)
        return Step(y, y)


class Jump:
    """A solution that jumps by 1 at t = 1/3, which no step size makes smooth."""

    order = 1

    def step(self, t, x, h):
        y = x + (t < 1 / 3 <= t + h) * (1.0 + h)
        return Step(y, y, np.array([1.0 if t < 1 / 3 <= t + h else 0.0]))


ONE = np.ones(1)


def test_fixed_steps_end_exactly_at_the_end():
    run = integrate(Decay(), ONE, (0.0, 1.0), controller=FixedStep(0.3))
    assert run.t.tolist() == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    assert run.t[-1] == 1.0
    assert run.status == "finished"


def test_infinite_fixed_steps_follow_the_stop_times():
    stops = [0.1, 0.4, 0.9]
    run = integrate(Decay(), ONE, (0.0, 1.0), controller=FixedStep(), stop_times=stops)
    assert run.t.tolist() == [0.0, *stops, 1.0]


def test_stop_times_outside_the_interval_are_ignored():
    run = integrate(Decay(), ONE, (0.0, 1.0), controller=FixedStep(), stop_times=[-1.0, 0.0, 0.5, 2.0])
    assert run.t.tolist() == [0.0, 0.5, 1.0]


def test_an_empty_interval_takes_no_step():
    run = integrate(Decay(), ONE, (1.0, 1.0), controller=FixedStep())
    assert run.t.tolist() == [1.0]
    assert run.accepted == 0


@pytest.mark.parametrize("controller", [IController, PIController])
def test_the_error_follows_the_tolerance(controller):
    errors, steps = [], []
    for tolerance in (1e-4, 1e-6, 1e-8):
        run = integrate(StepDoubling(Decay()), ONE, (0.0, 1.0), controller=controller(0.0, tolerance))
        errors.append(abs(run.states[-1][0] - math.exp(-1)))
        steps.append(run.accepted)
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-5
    # local error h**3: a hundredth of the tolerance costs about 100**(1/3) times the steps
    assert steps[2] / steps[1] == pytest.approx(100 ** (1 / 3), rel=0.3)


def test_step_size_grows_after_a_transient():
    run = integrate(StepDoubling(Relax()), np.array([5.0]), (0.0, 2.0), controller=PIController(0.0, 1e-5))
    sizes = np.diff(run.t)
    assert sizes[3:].max() > 10 * sizes[:3].max()
    assert abs(run.states[-1][0] - math.cos(2.0)) < 0.02


def test_adaptive_steps_meet_stop_times_without_losing_their_size():
    stops = np.linspace(0.01, 0.99, 7)
    run = integrate(
        StepDoubling(Decay()), ONE, (0.0, 1.0), controller=PIController(0.0, 1e-6), stop_times=stops
    )
    free = integrate(StepDoubling(Decay()), ONE, (0.0, 1.0), controller=PIController(0.0, 1e-6))
    assert set(stops) <= set(run.t.tolist())
    assert run.accepted <= free.accepted + 2 * stops.size


def test_an_interrupt_ends_the_run_with_what_it_has():
    answers = iter([False, False, True])
    run = integrate(Decay(), ONE, (0.0, 1.0), controller=FixedStep(0.1), interrupt=lambda: next(answers))
    assert run.status == "interrupted"
    assert run.t.tolist() == pytest.approx([0.0, 0.1, 0.2])


def test_a_jump_is_an_error_unless_smallest_steps_are_forced():
    controller = PIController(0.0, 1e-6)
    with pytest.raises(StepSizeError, match="smallest step"):
        integrate(Jump(), np.zeros(1), (0.0, 1.0), controller=controller, smallest_h=1e-6)
    run = integrate(
        Jump(), np.zeros(1), (0.0, 1.0), controller=controller, smallest_h=1e-6, force_smallest=True
    )
    assert run.forced == 1
    assert run.states[-1][0] == pytest.approx(1.0, abs=1e-5)


def test_too_many_steps_are_an_error():
    with pytest.raises(StepSizeError, match="10 steps"):
        integrate(Decay(), ONE, (0.0, 1.0), controller=FixedStep(1e-3), max_steps=10)


def test_adaptive_control_needs_an_error_estimate():
    with pytest.raises(NumericalError, match="StepDoubling"):
        integrate(Decay(), ONE, (0.0, 1.0), controller=PIController())


@pytest.mark.parametrize(
    "make",
    [
        lambda: FixedStep(0.0),
        lambda: FixedStep(math.nan),
        lambda: IController(rtol=-1.0),
        lambda: PIController(atol=0.0),
        lambda: PIController(start=0.0),
        lambda: integrate(Decay(), ONE, (1.0, 0.0), controller=FixedStep()),
        lambda: integrate(Decay(), ONE, (0.0, math.inf), controller=FixedStep()),
    ],
)
def test_bad_choices_are_refused(make):
    with pytest.raises(InvalidInputError):
        make()
