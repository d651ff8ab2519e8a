import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcs import LCS, EventDriven, TimeStepping, simulate, sine, transfer_matrix
from pricing_core.models import MechanicalSystem

G = 9.81
NOTHING = [[0.0]]
LEGS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], dtype=float)


def ball(restitution=0.0):
    return MechanicalSystem([[2.0]], NOTHING, NOTHING, [[1.0]], force=[-2.0 * G], restitution=restitution)


def carts():
    """Two carts with inelastic stops (Schumacher, example 11.3)."""
    stiffness = [[2.0, -1.0], [-1.0, 1.0]]
    return MechanicalSystem(np.eye(2), np.zeros((2, 2)), stiffness, [[1.0, 0.0], [1.0, -1.0]])


def test_a_dropped_ball_stays_where_it_falls():
    trajectory = ball().simulate([1.0], [0.0], (0.0, 1.0))
    (impact,) = trajectory.events
    assert impact.time == pytest.approx(math.sqrt(2.0 / G), rel=1e-13)
    assert impact.energy_lost == pytest.approx(2.0 * G, rel=1e-12)
    assert impact.impulse == pytest.approx([2.0 * math.sqrt(2.0 * G)], rel=1e-12)
    assert trajectory.u[-1] == pytest.approx([2.0 * G], rel=1e-12)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.9])
def test_a_bouncing_ball_comes_to_rest_after_infinitely_many_bounces(e):
    """sqrt(2/g) (1 + 2e/(1 - e)); for e = 0.9 that is 8.57894917872889."""
    end = math.sqrt(2.0 / G) * (1.0 + 2.0 * e / (1.0 - e))
    trajectory = ball(e).simulate([1.0], [0.0], (0.0, end + 1.0))
    first, second, rest = trajectory.events[0], trajectory.events[1], trajectory.events[-1]
    assert first.time == pytest.approx(0.4515236409857308, rel=1e-13)
    assert first.x_after[1] == pytest.approx(-e * first.x_before[1], rel=1e-12)
    assert second.energy_lost == pytest.approx(e**2 * first.energy_lost, rel=1e-10)
    assert (rest.kind, rest.mode_after) == ("zeno", (0,))
    assert rest.time == pytest.approx(end, rel=1e-12)
    assert rest.ratio == pytest.approx(e, rel=1e-6)
    assert trajectory.x[-1] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_without_loss_it_bounces_for_ever():
    trajectory = ball(1.0).simulate([1.0], [0.0], (0.0, 10.0))
    period = 2.0 * math.sqrt(2.0 / G)
    assert [event.time for event in trajectory.events] == pytest.approx(
        [period * (i + 0.5) for i in range(11)], rel=1e-12
    )
    heights = trajectory.x[:, 0] * G + 0.5 * trajectory.x[:, 1] ** 2
    assert heights == pytest.approx(G, rel=1e-10)


def test_the_transfer_matrix_is_that_of_the_mechanical_system():
    """G(s) = F (s^2 M + s D + K)^-1 F^T (11.88)."""
    rng = np.random.default_rng(2)
    N, R, F = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    M, D, K = N @ N.T + np.eye(3), R @ R.T, R.T @ R
    s = 1.7
    expected = F @ np.linalg.solve(s**2 * M + s * D + K, F.T)
    assert transfer_matrix(MechanicalSystem(M, D, K, F).to_lcs())(s) == pytest.approx(expected, rel=1e-9)


def test_two_carts_lose_half_their_energy_where_they_meet():
    trajectory = carts().simulate([0.0, 0.0], [0.5, 0.5], (0.0, 8.0))
    assert [event.time for event in trajectory.events] == pytest.approx(
        [math.pi * math.sqrt(2.0), math.pi * (math.sqrt(2.0) + 1.0)], rel=1e-12
    )
    assert [event.energy_lost for event in trajectory.events] == pytest.approx([0.125, 0.0625], rel=1e-9)


@pytest.mark.parametrize("load", [0.0, 0.5])
def test_four_legs_stand_on_one_motion_and_share_the_load_by_least_norm(load):
    """The forces balance weight and moment; of all that do, the least are linear in the legs' places."""
    chair = MechanicalSystem(np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)), LEGS, force=[-8.0, load, 0.0])
    trajectory = chair.simulate([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], (0.0, 1.0))
    assert trajectory.x[-1] == pytest.approx(np.zeros(6), abs=1e-12)
    assert trajectory.u[-1] == pytest.approx(2.0 - 0.25 * load * LEGS[:, 1], rel=1e-9)


def test_a_falling_chair_settles_on_its_legs():
    chair = MechanicalSystem(np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)), LEGS, force=[-8.0, 0.5, 0.0])
    trajectory = chair.simulate([0.0, 0.0, 0.0], [1.0, 0.2, 0.1], (0.0, 1.0))
    assert all(event.energy_lost > 0.0 for event in trajectory.events if event.kind == "jump")
    assert trajectory.y.min() > -1e-10
    assert trajectory.x[-1] == pytest.approx(np.zeros(6), abs=1e-9)


@pytest.mark.parametrize("r", [0.5, 0.3, 0.1, 0.02, 1e-3, 1e-6])
def test_a_plank_rocks_from_foot_to_foot_until_it_rests(r):
    """An impact at one foot lifts the other with r times its speed: each bounce lasts r times as long as the last."""
    plank = MechanicalSystem(
        np.diag([1.0, (1.0 + r) / (1.0 - r)]),
        np.zeros((2, 2)),
        np.zeros((2, 2)),
        [[1.0, 1.0], [1.0, -1.0]],
        force=[-G, 0.0],
    )
    run = plank.simulate([1.0, 0.1], [0.0, 0.0], (0.0, 4.0))
    pull, first = (
        G * (1.0 - r),
        math.sqrt(2.0 * G * 0.9),
    )  # pull on the foot in the air; speed of the lower foot
    second = math.sqrt(
        ((1.0 - r) * first) ** 2 + 2.0 * pull * 0.2
    )  # speed of the other, from 0.2 above the floor
    landing = first / G + (second - (1.0 - r) * first) / pull
    assert run.events[0].time == pytest.approx(first / G, abs=1e-14)
    assert run.events[1].time == pytest.approx(landing, abs=1e-13)
    assert run.events[-1].time == pytest.approx(landing + 2.0 * r * second / (pull * (1.0 - r)), abs=2e-8)
    assert run.x[-1] == pytest.approx(np.zeros(4), abs=1e-12)
    assert run.u[-1] == pytest.approx([G / 2.0, G / 2.0], abs=1e-12)


@pytest.mark.parametrize(
    ("inertia", "load", "tilt"),
    [
        (0.3, [0.3, 0.1], [0.1, 0.05]),
        (0.4647, [0.3302, 0.0853], [0.0174, 0.1740]),
        (0.1675, [0.1508, -0.0889], [0.0886, 0.0101]),
        (0.3707, [-0.2595, 0.2905], [-0.0801, -0.0309]),
        (0.1454, [-0.0764, -0.2412], [0.0321, -0.0806]),
    ],
)
def test_a_tilted_chair_with_its_load_off_centre_comes_to_rest(inertia, load, tilt):
    force = [-10.0, -10.0 * load[0], -10.0 * load[1]]
    nothing = np.zeros((3, 3))
    chair = MechanicalSystem(np.diag([1.0, inertia, inertia]), nothing, nothing, LEGS, force)
    run = chair.simulate([1.0, *tilt], [0.0, 0.0, 0.0], (0.0, 3.0))
    assert run.x[-1] == pytest.approx(np.zeros(6), abs=1e-9)
    assert run.u[-1] == pytest.approx(np.linalg.pinv(LEGS.T) @ -np.array(force), abs=1e-9)
    lost = sum(event.energy_lost for event in run.events if event.kind == "jump")
    assert lost == pytest.approx(10.0 * (1.0 + load[0] * tilt[0] + load[1] * tilt[1]), abs=1e-6)


def test_a_shaken_table_throws_the_ball_off():
    """The table moves as sin(w t) / 10; the ball leaves where its acceleration is -g."""
    w = 12.0
    table = LCS(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], f=[0.0, -G], g=sine(-0.1, w / (2.0 * math.pi))
    )
    trajectory = simulate(table, [0.0, 0.1 * w], (0.0, 0.2))
    left = math.asin(G / (0.1 * w**2)) / w
    assert trajectory.events[0].time == pytest.approx(left, rel=1e-11)
    # the same in the frame of the table: an inertial force
    frame = MechanicalSystem(
        [[1.0]], NOTHING, NOTHING, [[1.0]], force=sine(0.1 * w**2, w / (2.0 * math.pi), offset=-G)
    )
    assert frame.simulate([0.0], [0.0], (0.0, 0.2)).events[0].time == pytest.approx(left, rel=1e-11)


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("mass", {"mass": [[0.0]]}),
        ("mass", {"mass": [[-1.0]]}),
        ("damping", {"damping": [[1.0, 0.0]]}),
        ("F", {"F": [[1.0, 0.0]]}),
        ("force", {"force": [1.0, 2.0]}),
        ("offset", {"offset": [1.0, 2.0]}),
        ("restitution", {"restitution": 1.5}),
    ],
)
def test_what_does_not_fit_is_refused_by_name(field, change):
    given = {"mass": [[1.0]], "damping": NOTHING, "stiffness": NOTHING, "F": [[1.0]], **change}
    with pytest.raises(InvalidInputError, match=field):
        MechanicalSystem(**given)


def test_a_start_inside_a_wall_names_the_constraint():
    with pytest.raises(InvalidInputError, match=r"constraint 1 holds: F q \+ offset is -0\.5"):
        carts().simulate([0.5, 1.0], [0.0, 0.0], (0.0, 1.0))


def test_time_stepping_comes_to_rest_on_the_floor():
    run = ball().simulate([1.0], [0.0], (0.0, 1.0), method=TimeStepping(step=1e-3))
    assert run.scheme == "implicit-euler"
    assert run.x[-1] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert run.u[-1] == pytest.approx([2.0 * G], rel=1e-9)


@pytest.mark.parametrize(
    ("field", "method"),
    [
        ("scheme", TimeStepping("implicit-euler", step=1e-3)),
        ("scheme", TimeStepping("sdirk2")),
        ("rebound", EventDriven(rebound=lambda before, after, contacts: (after, np.zeros(1)))),
    ],
)
def test_a_restitution_is_the_only_law_of_impact(field, method):
    with pytest.raises(InvalidInputError, match=f"{field} = .* where the restitution is > 0"):
        ball(0.5).simulate([1.0], [0.0], (0.0, 1.0), method=method)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.8, 0.9])
def test_what_takes_no_part_in_infinitely_many_bounces_flows_exactly(e):
    """A ball that comes to rest beside a pendulum that it does not touch: q2 = cos t + 0.3 sin t."""
    pair = MechanicalSystem(
        np.eye(2), np.zeros((2, 2)), np.diag([0.0, 1.0]), [[1.0, 0.0]], [-G, 0.0], restitution=e
    )
    run = pair.simulate([1.0, 1.0], [0.0, 0.3], (0.0, 12.0))
    times = np.linspace(0.0, 12.0, 1001)
    assert run(times)[:, 1] == pytest.approx(np.cos(times) + 0.3 * np.sin(times), abs=1e-14)
    (limit,) = [event for event in run.events if event.kind == "zeno"]
    assert limit.time == pytest.approx(math.sqrt(2.0 / G) * (1.0 + 2.0 * e / (1.0 - e)), rel=1e-12)
    assert limit.x_before == pytest.approx(limit.x_after, abs=0.0)
    assert limit.x_after[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("end", [1e4, 1e12])
def test_rest_costs_nothing(end):
    """One cart is pushed against the wall, the other against the first."""
    system = MechanicalSystem(
        np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 1.0]], [[1.0, 0.0], [1.0, -1.0]], [-1.0, 1.0]
    )
    run = system.simulate([0.0, 0.0], [0.0, 0.0], (0.0, end))
    assert (run.accepted < 10, run.events) == (True, ())
    assert run.x[-1] == pytest.approx(np.zeros(4), abs=0.0)


def test_two_masses_and_a_stop_at_a_distance_bounce_to_an_end():
    """Its gap is rounded at 1e-16: the last bounces are below that."""
    system = MechanicalSystem(
        np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 2.0]], [[1.0, 0.0]], [-5.0, 0.0], [1.0], 0.5
    )
    run = system.simulate([1.0, 0.0], [0.0, 0.0], (0.0, 10.0))
    assert len(run.events) < 100
    assert run.y.min() >= 0.0
    assert run.x[-1, 0] == pytest.approx(-1.0, abs=1e-12)


def test_without_restitution_another_law_may_be_given():
    """What Newton's law does with e = 1/2, for one contact."""

    def law(before, after, contacts):
        assert contacts == (0,)
        rising = np.array([after[0], -0.5 * before[1]])
        return rising, 2.0 * (rising[1:] - before[1:])

    given = ball().simulate([1.0], [0.0], (0.0, 1.2), method=EventDriven(rebound=law))
    newton = ball(0.5).simulate([1.0], [0.0], (0.0, 1.2))
    assert given.x[-1] == pytest.approx(newton.x[-1], rel=1e-12)
    assert given.events[0].impulse == pytest.approx(newton.events[0].impulse, rel=1e-12)


def test_events_are_counted_in_mechanics_too():
    with pytest.raises(IterationLimitError, match="2 events by t = "):
        ball(0.5).simulate([1.0], [0.0], (0.0, 3.0), method=EventDriven(max_events=2))
