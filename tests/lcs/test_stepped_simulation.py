from functools import partial

import numpy as np
import pytest

from pricing_core.errors import InfeasibleError, RelativeDegreeError
from pricing_core.lcs import LCS, TimeStepping, simulate
from tests.problems.lcs_problems import (
    diode_bridge,
    diode_rectifier,
    problems,
    pulled_particle,
    two_capacitors,
    two_relays,
)

stepped = partial(simulate, method="time-stepping")


def final_time(problem):
    return max(problem.times) * 1.0001


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
def test_time_stepping_meets_every_exact_trajectory(problem):
    tolerance = 1e-6 * np.array(problem.scale)
    trajectory = stepped(
        problem.system,
        problem.x0,
        (0.0, final_time(problem)),
        method=TimeStepping(tolerance=0.0, absolute_tolerance=tolerance),
        t_eval=problem.times,
    )
    exact = np.array([problem.exact(t) for t in problem.times])
    error = np.max(np.abs(trajectory.x - exact) / problem.scale)
    # order 1 with an impact of unknown time inside a step; order 2 elsewhere
    assert error < (5e-3 if problem.relative_degree == 2 else 2e-4)
    assert trajectory.status == "finished"
    assert np.all(trajectory.u >= 0)
    assert np.all(trajectory.y >= -1e-9)


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
def test_a_tighter_tolerance_gives_a_smaller_error(problem):
    errors = []
    for tolerance in (1e-3, 1e-5):
        method = TimeStepping(tolerance=0.0, absolute_tolerance=tolerance * np.array(problem.scale))
        trajectory = stepped(
            problem.system, problem.x0, (0.0, final_time(problem)), method=method, t_eval=problem.times
        )
        exact = np.array([problem.exact(t) for t in problem.times])
        errors.append(np.max(np.abs(trajectory.x - exact) / problem.scale))
    assert errors[1] < max(0.3 * errors[0], 1e-8)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_a_switch_that_falls_on_the_constraint_is_located(tolerance):
    """x1 = max(0.6 - t, 0), x2' = x1: every step lands on x1 = 0 exactly, and x2(1) = 0.6**2 / 2."""
    system = LCS([[0, 0], [1, 0]], [[1], [0]], [[1, 0]], f=[-1, 0])
    trajectory = stepped(system, [0.6, 0.0], (0.0, 1.0), method=TimeStepping(tolerance=tolerance))
    assert trajectory.x[-1] == pytest.approx([0.0, 0.18], abs=tolerance)
    assert trajectory.accepted + trajectory.rejected < 200


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_two_relays_switch_at_the_right_time(tolerance):
    """From (3, 1) the rate is (1, -3) up to x2(1/3) = 0, then (-3, -1): x(1) = (4/3, -2/3)."""
    trajectory = stepped(two_relays(), [3.0, 1.0], (0.0, 1.0), method=TimeStepping(tolerance=tolerance))
    assert trajectory.x[-1] == pytest.approx([4 / 3, -2 / 3], abs=tolerance)
    assert trajectory.accepted + trajectory.rejected < 200


def test_two_relays_spiral_into_the_origin_through_infinitely_many_switches():
    """Each loop shrinks |x|: the switches accumulate, and x stays at 0 thereafter."""
    trajectory = stepped(two_relays(), [3.0, 1.0], (0.0, 6.0))
    assert trajectory.x[-1] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert trajectory.accepted + trajectory.rejected < 2000


@pytest.mark.parametrize("span", [10.0, 1e4])
def test_a_switch_in_a_long_interval_is_no_failure(span):
    """The interval's resolution, not atol = 1e-8 at x = 0, then limits how well the switch is located."""
    trajectory = stepped(LCS([[0]], [[1]], [[1]], f=[-1]), [0.47 * span], (0.0, span))
    assert trajectory.x[-1] == pytest.approx([0.0], abs=1e-12)


def test_the_bridge_needs_no_more_than_a_few_hundred_steps():
    problem = diode_bridge()
    trajectory = stepped(
        problem.system, problem.x0, (0.0, 1e-3), method=TimeStepping(tolerance=1e-5), t_eval=[1e-3]
    )
    assert np.max(np.abs(trajectory.x[-1] - problem.exact(1e-3)) / problem.scale) < 1e-3
    assert trajectory.accepted + trajectory.rejected < 600


# (problem, scheme, expected order) with constant steps
ORDERS = [
    (diode_rectifier, "implicit-euler", 1),
    (diode_rectifier, "sdirk2", 2),
    (diode_rectifier, "theta", 2),
    (diode_bridge, "implicit-euler", 1),
    (diode_bridge, "sdirk2", 2),
]


@pytest.mark.parametrize(("make", "scheme", "order"), ORDERS)
def test_order_of_convergence_with_constant_steps(make, scheme, order):
    problem = make()
    end = 0.6 * max(problem.times)
    errors = []
    for steps in (400, 800, 1600):
        trajectory = stepped(
            problem.system, problem.x0, (0.0, end), method=TimeStepping(scheme, step=end / steps)
        )
        errors.append(np.max(np.abs(trajectory.x[-1] - problem.exact(end)) / problem.scale))
    observed = -np.polyfit(range(3), np.log2(errors), 1)[0]
    assert observed > order - 0.15, errors


def test_a_jump_at_the_start_is_an_event_with_its_impulse():
    """The charge 2 flows through the diode at once."""
    problem = two_capacitors()
    trajectory = stepped(problem.system, problem.x0, (0.0, 1.0))
    (event,) = trajectory.events
    assert (event.time, event.kind) == (0.0, "jump")
    assert event.x_before == pytest.approx([3.0, 0.0])
    assert event.x_after == pytest.approx([1.0, 1.0], abs=1e-9)
    assert event.impulse == pytest.approx([2.0], abs=1e-9)
    assert trajectory.u[0] == pytest.approx([0.0], abs=1e-9)
    assert trajectory(0.0) == pytest.approx([1.0, 1.0], abs=1e-9)


def test_inconsistent_start_of_the_filtered_bridge_shares_the_charge():
    """Bridge with capacitor filter from (10, 0, 0): x(0+) = (100/13, 0, 100/13), u not unique while off."""
    C, L, R, Cf = 1e-6, 1e-2, 1e3, 3e-7
    system = LCS(
        [[0, -1 / C, 0], [1 / L, 0, 0], [0, 0, -1 / (R * Cf)]],
        [[0, 0, -1 / C, 1 / C], [0, 0, 0, 0], [1 / Cf, 0, 1 / Cf, 0]],
        [[0, 0, 1], [0, 0, 0], [-1, 0, 1], [1, 0, 0]],
        [[0, -1, 0, 0], [1, 0, 1, -1], [0, -1, 0, 0], [0, 1, 0, 0]],
    )
    trajectory = stepped(
        system,
        [10.0, 0.0, 0.0],
        (0.0, 1.1e-4),
        method=TimeStepping(tolerance=0.0, absolute_tolerance=[1e-5, 1e-7, 1e-5]),
        t_eval=[0.0, 1e-6, 2e-6, 1e-4],
    )
    assert trajectory.events[0].x_after == pytest.approx([100 / 13, 0.0, 100 / 13], abs=1e-7)
    assert trajectory.x[1:, 0] == pytest.approx(
        [7.686097103377391, 7.679300282877036, 4.096759706332225], abs=1e-3
    )
    assert trajectory.x[3, 1:] == pytest.approx([0.0639902632531, 5.747070622528], abs=1e-3)


def test_inputs_change_at_their_times_and_the_trajectory_is_right_continuous():
    problem = pulled_particle()
    trajectory = stepped(
        problem.system, problem.x0, (0.0, 2.0), method=TimeStepping(tolerance=0.0, absolute_tolerance=1e-7)
    )
    assert [(e.time, e.kind) for e in trajectory.events] == [(1.0, "input"), (1.5, "jump")]
    assert trajectory(1.5) == pytest.approx([3.0], abs=1e-6)
    assert trajectory(1.4999999) == pytest.approx([1.0], abs=1e-5)
    assert trajectory([0.25, 2.0]).shape == (2, 1)


def test_a_ball_at_rest_needs_the_force_of_gravity():
    system = LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], f=[0, -9.81])
    trajectory = stepped(system, [1.0, 0.0], (0.0, 1.0))
    assert trajectory.scheme == "implicit-euler"
    assert trajectory.u[-1] == pytest.approx([9.81], rel=1e-9)


def test_relative_degree_three_is_refused_by_name():
    """The triple integrator from (0, -1, 0): time stepping gives x1(1) = 1/(2h) - 1/2, which diverges."""
    system = LCS([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [0], [1]], [[1, 0, 0]])
    with pytest.raises(RelativeDegreeError, match="relative degree 3"):
        stepped(system, [0.0, -1.0, 0.0], (0.0, 1.0))
    with pytest.raises(RelativeDegreeError, match="relative degree 3"):
        stepped(system, [0.0, -1.0, 0.0], (0.0, 1.0), method=TimeStepping("implicit-euler"))


def test_the_second_order_scheme_is_refused_where_the_state_may_jump():
    system = LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]])
    with pytest.raises(RelativeDegreeError, match="implicit-euler"):
        stepped(system, [1.0, 0.0], (0.0, 1.0), method=TimeStepping("sdirk2"))


def test_a_start_without_admissible_jump_is_infeasible():
    """y = x with B = 0: nothing can push x back."""
    system = LCS([[0.0]], [[0.0]], [[1.0]])
    with pytest.raises(InfeasibleError, match=r"no mode goes on.*proved"):
        stepped(system, [-1.0], (0.0, 1.0))


def test_an_interrupt_keeps_the_trajectory_so_far():
    answers = iter([False] * 3 + [True])
    trajectory = stepped(
        LCS([[-1.0]], [[1.0]], [[1.0]]),
        [1.0],
        (0.0, 1.0),
        method=TimeStepping(step=0.1),
        interrupt=lambda: next(answers),
    )
    assert trajectory.status == "interrupted"
    assert trajectory.t[-1] == pytest.approx(0.3)
