"""The collocation path for problems that are affine in the control."""

import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.models import ControlAffineProblem
from tests.problems.control_problems import stopped_scalar

KNOWN = stopped_scalar(3.0)


def in_logarithms(horizon: float = 3.0) -> ControlAffineProblem:
    """The scalar example x' = -x + u, x >= 1, for z = exp(x): z' = z (u - log z), z >= e."""
    return ControlAffineProblem(
        reward=lambda t, z, u: -0.5 * (math.log(z[0]) ** 2 + u[0] ** 2),
        drift=lambda t, z: [-z[0] * math.log(z[0])],
        input_map=lambda t, z: [[z[0]]],
        x0=[math.exp(2.0)],
        horizon=horizon,
        state_constraint=lambda t, z: [z[0] - math.e],
    )


def test_a_change_of_variables_keeps_the_value_at_second_order():
    numbers = np.array([25, 50, 100])
    errors = [abs(in_logarithms().solve(intervals=int(N)).reward + KNOWN.cost) for N in numbers]
    assert -np.polyfit(np.log(numbers), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 4e-4


def test_the_multiplier_changes_as_a_gradient_does():
    N = 100
    answer = in_logarithms().solve(intervals=N)
    eta = answer.state_masses[:, 0] * math.e  # d(z - e) = e dx on the bound
    assert eta[-40:-1] * N / 3.0 == pytest.approx(2.0, abs=1e-3)
    assert eta[-1] == pytest.approx(1.0 + 3.0 / N, abs=1e-3)  # the atom, and half an interval
    assert answer.costate[:, 0] * np.sqrt(answer.x[1:, 0] * answer.x[:-1, 0]) == pytest.approx(
        answer.control[:, 0], abs=2e-3
    )


def test_a_linear_problem_gives_what_the_quadratic_programme_gives():
    p = KNOWN.problem
    linear = ControlAffineProblem(
        lambda t, x, u: -0.5 * (x @ p.Q @ x + u @ u),
        lambda t, x: p.A @ x,
        lambda t, x: p.B,
        p.x0,
        p.horizon,
        state_constraint=lambda t, x: p.C @ x - p.bound,
    )
    answer = linear.solve(intervals=200)
    assert answer.reward == pytest.approx(-KNOWN.cost, abs=5e-5)
    assert answer.is_local_maximum
    assert answer.stationarity < 1e-8


def test_a_bound_on_the_control_and_a_final_reward():
    """Maximise 3 x(2) - (1/2) int u^2 with x' = u <= 1: u = 1, lambda = 3, eta = lambda - u = 2."""
    answer = ControlAffineProblem(
        lambda t, x, u: -0.5 * float(u @ u),
        lambda t, x: [0.0],
        lambda t, x: [[1.0]],
        [0.0],
        2.0,
        final_reward=lambda x: 3.0 * float(x[0]),
        mixed_constraint=lambda t, x, u: [1.0 - u[0]],
    ).solve(intervals=10)
    assert answer.reward == pytest.approx(5.0, abs=1e-6)
    assert answer.control == pytest.approx(1.0, abs=1e-6)
    assert answer.costate == pytest.approx(3.0, abs=1e-6)
    assert answer.mixed_multiplier == pytest.approx(2.0, abs=1e-6)
    assert answer.is_local_maximum  # the bound alone holds it


def test_a_cost_of_the_last_state_alone_has_its_closed_form():
    """Minimise (1/2) int_0^3 u^2 + (5/2) x(3)^2 with x' = u from 2: u = -5 x(3), x(3) = 2/(1 + 15)."""
    answer = ControlAffineProblem(
        lambda t, x, u: -0.5 * float(u @ u),
        lambda t, x: [0.0],
        lambda t, x: [[1.0]],
        [2.0],
        3.0,
        final_reward=lambda x: -2.5 * float(x[0] ** 2),
    ).solve(intervals=10)
    assert answer.reward == pytest.approx(-0.625, abs=1e-9)
    assert answer.x[-1] == pytest.approx([0.125], abs=1e-8)
    assert answer.control == pytest.approx(-0.625, abs=1e-8)
    assert answer.is_local_maximum
    assert answer.stationarity < 1e-9


@pytest.mark.parametrize(("horizon", "is_maximum"), [(1.5, True), (1.65, False)])
def test_beyond_its_conjugate_point_a_stationary_control_is_no_maximum(horizon: float, is_maximum: bool):
    """Maximise (1/2) int x^2 - u^2 with x' = u from 0: u = 0 is stationary, and a maximum for T < pi/2 alone."""
    answer = ControlAffineProblem(
        lambda t, x, u: 0.5 * float(x @ x - u @ u), lambda t, x: [0.0], lambda t, x: [[1.0]], [0.0], horizon
    ).solve(intervals=50)
    assert (answer.reward, answer.is_local_maximum) == (0.0, is_maximum)


def test_a_minimum_between_two_maxima_is_not_called_a_maximum():
    """F_T = -(x^2 - 1)^2 from x = 0, where u = 0 is stationary."""
    problem = ControlAffineProblem(
        lambda t, x, u: -0.05 * float(u @ u),
        lambda t, x: [0.0],
        lambda t, x: [[1.0]],
        [0.0],
        1.0,
        final_reward=lambda x: -((x[0] ** 2 - 1.0) ** 2),
    )
    assert not problem.solve(intervals=10).is_local_maximum


def test_time_enters_explicitly():
    """Maximise int t u - u^2/2: u = t at the midpoints, value T^3/6 up to the midpoint rule."""
    answer = ControlAffineProblem(
        lambda t, x, u: t * u[0] - 0.5 * u[0] ** 2, lambda t, x: [0.0], lambda t, x: [[1.0]], [0.0], 3.0
    ).solve(intervals=30)
    assert answer.control[:, 0] == pytest.approx(0.5 * (answer.t[1:] + answer.t[:-1]), abs=1e-5)
    assert answer.reward == pytest.approx(4.5, abs=5e-3)


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("x0", {"x0": [[1.0]]}),
        ("x0", {"x0": [0.5]}),
        ("horizon", {"horizon": 0.0}),
        ("drift", {"drift": lambda t, x: [1.0, 2.0]}),
        ("input_map", {"input_map": lambda t, x: [1.0]}),
        ("reward", {"reward": lambda t, x, u: float("nan")}),
        ("final_reward", {"final_reward": lambda x: float("inf")}),
        ("mixed_constraint", {"mixed_constraint": lambda t, x, u: [[1.0]]}),
        ("state_constraint", {"state_constraint": lambda t, x: 1.0}),
    ],
)
def test_bad_input_is_refused_by_name(field: str, change: dict[str, object]):
    good = {
        "reward": lambda t, x, u: -float(u @ u),
        "drift": lambda t, x: [0.0],
        "input_map": lambda t, x: [[1.0]],
        "x0": [1.0],
        "horizon": 1.0,
        "state_constraint": lambda t, x: [x[0] - 0.75],
    }
    with pytest.raises(InvalidInputError) as caught:
        ControlAffineProblem(**{**good, **change})
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("field", "setting"), [("intervals", 3), ("tolerance", 0.0), ("start", [1.0, 2.0]), ("intervals", 5.0)]
)
def test_settings_out_of_range_are_refused(field: str, setting: object):
    with pytest.raises(InvalidInputError) as caught:
        in_logarithms().solve(**{field: setting})
    assert caught.value.field == field


def test_an_iteration_limit_is_an_error():
    with pytest.raises(IterationLimitError, match="2 quadratic steps"):
        in_logarithms().solve(intervals=20, max_iterations=2)


def test_contradicting_constraints_are_an_error():
    problem = ControlAffineProblem(
        lambda t, x, u: -float(u @ u),
        lambda t, x: [0.0],
        lambda t, x: [[1.0]],
        [1.0],
        1.0,
        mixed_constraint=lambda t, x, u: [u[0] - 1.0, -u[0]],
    )
    with pytest.raises(NumericalError, match="constraints contradict"):
        problem.solve(intervals=10)
