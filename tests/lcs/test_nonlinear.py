"""Nonlinear complementarity systems: orders, the linear case, and refusals."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError, RelativeDegreeError
from pricing_core.lcs import EventDriven, SemiExplicitSystem, TimeStepping, simulate, simulate_nonlinear
from pricing_core.lcs.nonlinear_stage import NonlinearStage
from pricing_core.lcs.time_stepping import LCSState
from tests.problems.lcs_problems import diode_bridge, diode_rectifier, falling_ball, two_relays
from tests.problems.semi_explicit_problems import as_semi_explicit, hyperbolic_diode, problems, quadratic_fall


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
@pytest.mark.parametrize(("scheme", "order"), [("implicit-euler", 1), ("sdirk2", 2), ("theta", 2)])
def test_a_scheme_has_its_order_where_the_mode_does_not_change(problem, scheme, order):
    end = problem.smooth_until
    errors = []
    for steps in (20, 40, 80):
        trajectory = simulate_nonlinear(
            problem.system, problem.x0, (0.0, end), method=TimeStepping(scheme, step=end / steps)
        )
        errors.append(np.max(np.abs(trajectory.x[-1] - problem.exact(end))))
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_error_control_meets_the_exact_trajectory_across_switches(problem, rtol):
    times = np.linspace(0.0, problem.end, 9)
    trajectory = simulate_nonlinear(
        problem.system, problem.x0, (0.0, problem.end), method=TimeStepping(tolerance=rtol), t_eval=times
    )
    exact = np.array([problem.exact(t) for t in times])
    assert np.max(np.abs(trajectory.x - exact)) < 20 * rtol
    assert trajectory.scheme == "sdirk2"
    assert np.all(trajectory.u >= 0)
    assert np.max(np.abs(np.minimum(trajectory.u, trajectory.y))) < 1e-9


@pytest.mark.parametrize(
    ("system", "x0", "h", "scheme"),
    [
        (diode_bridge().system, [10.0, 0.0], 1e-5, "implicit-euler"),
        (diode_bridge().system, [10.0, 0.0], 1e-5, "sdirk2"),
        (diode_rectifier().system, [0.0], 0.01, "theta"),
        (falling_ball().system, [1.0, 0.0], 0.01, "implicit-euler"),
        (two_relays(), [3.0, 1.0], 0.01, "implicit-euler"),
    ],
)
def test_linear_functions_give_the_linear_simulation(system, x0, h, scheme):
    span = (0.0, 60 * h)
    method = TimeStepping(scheme, step=h)
    linear = simulate(system, x0, span, method=method)
    general = simulate_nonlinear(as_semi_explicit(system), x0, span, method=method)
    size = np.max(np.abs(linear.x), axis=0)
    assert general.t == pytest.approx(linear.t, abs=0.0)
    assert np.max(np.abs(general.x - linear.x) / size) < 1e-9


def test_a_rectifier_with_a_saturating_load_agrees_with_an_ordinary_integrator():
    """v' = u - tanh v, y = v - 3 sin t + u / 5: the diode's current is u = max(0, 5 (3 sin t - v))."""

    def f(x, u):
        return np.array([u[0] - math.tanh(x[0]), 1.0])

    rectifier = SemiExplicitSystem(f, lambda x, u: np.array([x[0] - 3.0 * math.sin(x[1]) + u[0] / 5.0]), 1)
    trajectory = simulate_nonlinear(rectifier, [0.0, 0.0], (0.0, 7.0), method=TimeStepping(tolerance=1e-6))

    def rate(t, v):
        return max(0.0, 5.0 * (3.0 * math.sin(t) - v[0])) - np.tanh(v)

    peer = solve_ivp(rate, (0.0, 7.0), [0.0], rtol=1e-10, atol=1e-12, max_step=0.05)
    assert trajectory.x[-1, 0] == pytest.approx(peer.y[0, -1], abs=2e-5)


def test_newton_is_damped_where_full_steps_diverge():
    """y = arctan(u - 3) = 0 from u = 0: full Newton steps go to 12.5, -104, ...."""
    system = SemiExplicitSystem(lambda x, u: 0.0 * x, lambda x, u: np.arctan(u - 3.0), 1)
    state = LCSState(np.zeros(1), np.zeros(1), np.zeros(1))
    found = NonlinearStage(system).solve(0.0, np.zeros(1), 0.1, state)
    assert found.multiplier == pytest.approx([3.0], abs=1e-9)


def test_a_jacobian_spares_calls_and_gives_the_same():
    problem = hyperbolic_diode()
    by_differences = SemiExplicitSystem(problem.system.f, problem.system.h, 1)
    run = partial(simulate_nonlinear, x0=[0.0], t_span=(0.0, 1.0), method=TimeStepping(step=0.05))
    assert run(problem.system).x == pytest.approx(run(by_differences).x, abs=1e-11)


def test_relative_degree_is_that_of_the_linearisation():
    pendulum = SemiExplicitSystem(
        lambda x, u: np.array([x[1], -math.sin(x[0]) + u[0]]), lambda x, u: x[:1], 1
    )
    trajectory = simulate_nonlinear(pendulum, [0.5, 0.0], (0.0, 3.0), method=TimeStepping(tolerance=1e-4))
    assert trajectory.scheme == "implicit-euler"
    assert trajectory.x[-1] == pytest.approx([0.0, 0.0], abs=1e-3)  # an inelastic hit, then rest
    with pytest.raises(RelativeDegreeError, match="use implicit-euler"):
        simulate_nonlinear(pendulum, [0.5, 0.0], (0.0, 3.0), method=TimeStepping("sdirk2"))


@pytest.mark.parametrize(
    ("system", "arguments", "words"),
    [
        (quadratic_fall().system, {"x0": [-1.0]}, "x0 .* on the constraints"),
        (quadratic_fall().system, {"t_span": (1.0, 0.0)}, "t_span"),
        (quadratic_fall().system, {"method": "event-driven"}, "method .* TimeStepping"),
        (quadratic_fall().system, {"method": EventDriven()}, "method .* TimeStepping"),
        (
            quadratic_fall().system,
            {"method": TimeStepping(multipliers="least-norm")},
            "multipliers .* left out",
        ),
        (
            quadratic_fall().system,
            {"method": TimeStepping(absolute_tolerance=[1, 1])},
            "absolute_tolerance .* 1",
        ),
        (SemiExplicitSystem(lambda x, u: [1.0, 2.0], lambda x, u: x, 1), {}, "f = .*shape"),
        (SemiExplicitSystem(lambda x, u: x, lambda x, u: [], 1), {}, "h = .*shape"),
        (
            SemiExplicitSystem(lambda x, u: x, lambda x, u: x, 1, f_jacobian=lambda x, u: ([1.0], [1.0])),
            {},
            "f_jacobian by x",
        ),
    ],
)
def test_wrong_arguments_are_named(system, arguments, words):
    with pytest.raises(InvalidInputError, match=words):
        simulate_nonlinear(system, **({"x0": [1.0], "t_span": (0.0, 1.0)} | arguments))


def test_no_pairs_are_refused():
    with pytest.raises(InvalidInputError, match="pairs"):
        SemiExplicitSystem(lambda x, u: x, lambda x, u: u, 0)


@pytest.mark.parametrize(("h", "x0"), [(None, 0.5), (0.1, 0.45)])
def test_a_system_that_cannot_go_on_says_where(h, x0):
    """y = x, x' = -1 whatever u: nothing goes on from x = 0."""
    stuck = SemiExplicitSystem(lambda x, u: -np.ones(1), lambda x, u: x, 1)
    with pytest.raises(IterationLimitError, match=r"Newton's method stops at t = 0\.5"):
        simulate_nonlinear(stuck, [x0], (0.0, 1.0), method=TimeStepping("implicit-euler", step=h))


def test_a_function_without_a_finite_value_is_told():
    burst = SemiExplicitSystem(lambda x, u: np.array([np.inf]), lambda x, u: u, 1)
    with pytest.raises(NumericalError, match="f has no finite value"):
        simulate_nonlinear(burst, [1.0], (0.0, 1.0))


def test_an_interrupt_ends_the_run():
    trajectory = simulate_nonlinear(quadratic_fall().system, [1.0], (0.0, 1.0), interrupt=lambda: True)
    assert (trajectory.status, trajectory.t.tolist()) == ("interrupted", [0.0])
