import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from pricing_core.errors import (
    InfeasibleError,
    IterationLimitError,
    NonUniqueError,
    NumericalError,
    ZenoError,
)
from pricing_core.lcs import (
    LCS,
    EventDriven,
    Exosystem,
    PiecewiseConstant,
    TimeStepping,
    piecewise_linear,
    simulate,
    sine,
)
from tests.problems.lcs_problems import diode_bridge, problems, pulled_particle, two_capacitors, two_relays
from tests.problems.lcs_systems import bridge, filtered_bridge, integrators, two_carts, two_integrators
from tests.problems.nightly import nightly


def relays(B, A=None) -> LCS:
    """x' = A x - B sgn(x), in the form of `two_relays`."""
    B = np.asarray(B, dtype=float)
    n = B.shape[0]
    inputs, slacks = np.zeros((n, 2 * n)), np.zeros((2 * n, n))
    inputs[:, ::2], slacks[::2] = B, np.eye(n)
    D = np.kron(np.eye(n), [[0.0, 1.0], [-1.0, 0.0]])
    A = np.zeros((n, n)) if A is None else A
    return LCS(A, inputs, slacks, D, f=-B.sum(axis=1), g=[0.0, 2.0] * n)


def steady(x):
    return pytest.approx(x, abs=1e-10)


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
def test_every_exact_trajectory_is_met(problem):
    span = (0.0, max(problem.times) * 1.0001)
    trajectory = simulate(problem.system, problem.x0, span, t_eval=problem.times)
    exact = np.array([problem.exact(t) for t in problem.times])
    assert np.max(np.abs(trajectory.x - exact) / problem.scale) < 1e-12
    assert np.array_equal(trajectory(problem.times), trajectory.x)
    assert trajectory.scheme == "event-driven"


def test_the_bridge_switches_wherever_its_voltage_vanishes():
    problem = diode_bridge()
    trajectory = simulate(problem.system, problem.x0, (0.0, 5e-3))
    assert len(trajectory.events) == 16
    voltages = [problem.exact(event.time)[0] for event in trajectory.events]
    assert np.max(np.abs(voltages)) < 1e-11
    assert trajectory(4.999e-3) == pytest.approx(problem.exact(4.999e-3), rel=1e-10)
    assert np.all(trajectory.u >= -1e-12)
    assert np.all(trajectory.y >= -1e-12)


def test_an_oscillation_that_has_died_out_is_at_rest():
    """Where the envelope is exp(-500), squares underflow."""
    trajectory = simulate(bridge(1, 1, 1), [10.0, 0.0], (0.0, 1000.0))
    assert trajectory.status == "finished"
    assert trajectory(1000.0) == pytest.approx(np.zeros(2), abs=1e-140)


def test_a_slack_that_vanishes_identically_in_a_jump_does_not_exclude_it():
    """A capacitor discharges through a diode into two others side by side: y1 = y2, and either may carry it all."""
    D = np.array([[1, 1, -1], [1, 1, -1], [-1, -1, 1]]) / 8
    trajectory = simulate(LCS([[0]], [[0, 0, -4]], [[0], [0], [-1]], D), [1.0], (0.0, 1.0))
    (event,) = trajectory.events
    assert (event.kind, event.x_after) == ("jump", steady([0.0]))
    assert event.impulse[0] + event.impulse[1] == pytest.approx(0.25)
    assert event.impulse[2] == pytest.approx(0.25)


def test_diodes_back_to_back_are_a_wire():
    """Two antiparallel diodes join a capacitor to another one with a coil beside it, all of size 1.

    On x1 = x2 each slack is minus the other: both vanish identically. The capacitors make one of 2: v'' = -v/2.
    """
    system = LCS([[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[-1, 1], [1, -1], [0, 0]], [[-1, 1, 0], [1, -1, 0]])
    trajectory = simulate(system, [1.0, 1.0, 0.0], (0.0, 20.0))
    assert trajectory(19.0)[:2] == steady([math.cos(19.0 / math.sqrt(2.0))] * 2)


# From the closed solution of each mode, switching times by bisection with 30 digits.
FILTERED = {
    1e-6: [7.686097103377391],
    2e-6: [7.679300282877036],
    1e-4: [4.096759706332225, 0.0639902632531, 5.747070622528],
}


def test_the_filtered_bridge_shares_its_charge_and_then_has_its_exact_values():
    trajectory = simulate(filtered_bridge(), [10.0, 0.0, 0.0], (0.0, 5e-3))
    first, second = trajectory.events[:2]
    assert (first.kind, first.multiplicity) == ("jump", 1)
    assert first.x_after == steady([100 / 13, 0.0, 100 / 13])
    # Q = diag(C, L, Cf): 1e-6 * 100 / 2 before, 1.3e-6 * (100/13)**2 / 2 afterwards
    assert first.energy_lost == pytest.approx(5e-5 - 0.65e-6 * (100 / 13) ** 2, rel=1e-9)
    assert second.time == pytest.approx(3.204207127275e-5, rel=1e-12)
    assert second.x_after[0] == pytest.approx(7.208181476840, rel=1e-12)
    for t, known in FILTERED.items():
        assert trajectory(t)[: len(known)] == pytest.approx(known, rel=1e-11)
    assert trajectory(1e-3)[::2] == pytest.approx([-4.437266965, 4.437266965], abs=1e-9)
    assert trajectory(4.999e-3) == pytest.approx([-0.196622956, -0.00570183564, 0.421491734], abs=1e-9)


def test_multipliers_that_are_not_unique_are_those_of_least_norm():
    """While the filtered bridge is off with v > 0, u2 may be anything from 0 to vf - v."""
    trajectory = simulate(filtered_bridge(), [10.0, 0.0, 0.0], (0.0, 1e-4), t_eval=[5e-5])
    assert trajectory.x[0, 2] > trajectory.x[0, 0] > 0.0
    assert trajectory.u[0] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_four_legs_of_a_chair_share_its_load_evenly():
    """Heave, pitch and roll of a plate on four stops at the corners of a square, at rest under gravity."""
    F = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], dtype=float)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [np.zeros((3, 6))]])
    system = LCS(
        A,
        np.vstack([np.zeros((3, 4)), F.T]),
        np.hstack([F, np.zeros((4, 3))]),
        f=[0, 0, 0, -8.0, 0, 0],
    )
    trajectory = simulate(system, np.zeros(6), (0.0, 1.0))
    assert trajectory.x[-1] == steady(np.zeros(6))
    assert trajectory.u[-1] == pytest.approx([2.0, 2.0, 2.0, 2.0], rel=1e-9)


def test_two_carts_halve_their_amplitude_at_every_impact():
    a, root = 0.5, math.sqrt(2.0)
    trajectory = simulate(two_carts(), [0.0, 0.0, a, a], (0.0, 13.0))
    half, whole = math.pi * root, math.pi * (root + 1.0)
    assert [event.time for event in trajectory.events] == pytest.approx(
        [half, whole, whole + half], rel=1e-12
    )
    assert [event.mode_after for event in trajectory.events] == [(0,), (1,), (0,)]
    states = [[0, 0, 0, -a], [0, 0, a / 2, a / 2], [0, 0, 0, -a / 2]]
    for event, state in zip(trajectory.events, states, strict=True):
        assert event.x_after == steady(state)
        assert event.energy_lost is None  # positions and forces exchange no energy: no storage function
    assert trajectory(1.0)[:2] == steady([a * root * math.sin(1.0 / root)] * 2)
    assert trajectory(half + 1.0)[:2] == steady([0.0, -a * math.sin(1.0)])


@pytest.mark.parametrize(
    ("start", "end", "sensitive"),
    [
        ([0.0, 0.0, -2.0, 1.0], [0.0, 0.0, 0.0, 0.0], True),
        ([1e-9, -1e-9, -2.0, 1.0], [0.0, 0.0, 0.5, 0.5], False),
        ([1e-9, 1e-9, -2.0, 1.0], [0.0, 0.0, 0.0, -0.5], False),
    ],
    ids=["together", "first cart first", "second cart first"],
)
def test_the_order_of_two_impacts_matters_and_is_reported(start, end, sensitive):
    trajectory = simulate(two_carts(), start, (0.0, 1e-6))
    assert trajectory.x[-1] == pytest.approx(end, abs=1e-5)
    assert any(event.order_sensitive for event in trajectory.events) == sensitive


@pytest.mark.parametrize(
    ("t", "state"),
    [
        (1.0, (4 / 3, -2 / 3)),
        (1.5, (-1 / 18, -17 / 18)),
        (1.9, (-31 / 270, 23 / 270)),
        (2.0, (0.0, 0.0)),
        (2.5, (0.0, 0.0)),
    ],
)
def test_two_relays_reach_the_origin_through_infinitely_many_switches(t, state):
    """|x1| + |x2| falls at the rate 2 (Schumacher, example 11.1)."""
    trajectory = simulate(two_relays(), [3.0, 1.0], (0.0, 2.5))
    assert trajectory(t) == steady(state)
    zeno = trajectory.events[-1]
    assert (zeno.kind, zeno.x_after.tolist()) == ("zeno", [0.0, 0.0])
    assert zeno.time == pytest.approx(2.0, rel=1e-12)
    assert zeno.ratio == pytest.approx(1 / 81, rel=1e-5)  # a third for each quarter turn


@pytest.mark.parametrize(
    ("B", "start", "end"),
    [
        (2 * np.array([[1.0, -26.0], [26.0, 1.0]]), 3.0, 1.5),
        (500 * np.array([[0.01, 0.99], [-0.99, 0.01]]), 10.0, 2.0),
    ],
)
def test_slow_spirals_end_when_they_should(B, start, end):
    """|x1| + |x2| falls at the constant rate 2 B11 (Filippov's example, in numbers of the Siconos project)."""
    trajectory = simulate(relays(B), [start, start], (0.0, 1.1 * end))
    assert trajectory.events[-1].time == pytest.approx(end, rel=1e-11)
    assert trajectory(1.05 * end) == steady([0.0, 0.0])


def test_a_spiral_has_its_exact_values_on_the_way():
    trajectory = simulate(relays([[2.0, -52.0], [52.0, 2.0]]), [3.0, 3.0], (0.0, 1.2))
    known = {
        0.06: (5.537777777777778, -0.2222222222222),
        0.2: (-1.872427983539, -3.327572016461),
        0.5: (0.9145106313673, -3.0854893686327),
        1.0: (-1.5559612263266, -0.4440387736734),
    }
    for t, state in known.items():
        assert trajectory(t) == pytest.approx(state, abs=1e-12)


def test_a_sliding_mode_is_entered_and_left_exactly():
    """x' = w - sgn(x) with w = t: x slides at 0 while |w| <= 1, from t = 1/2 to 1."""
    system = LCS(
        [[0.0]],
        [[1.0, 0.0]],
        [[1.0], [0.0]],
        [[0.0, 1.0], [-1.0, 0.0]],
        f=piecewise_linear([0.0, 4.0], [-1.0, 3.0]),
        g=[0.0, 2.0],
    )
    trajectory = simulate(system, [0.375], (0.0, 3.0))
    assert [event.time for event in trajectory.events] == pytest.approx([0.5, 1.0], rel=1e-12)
    assert trajectory(0.75) == steady([0.0])
    assert trajectory(3.0) == steady([2.0])  # the integral of t - 1 from 1 to 3


def test_both_relays_may_switch_at_once():
    trajectory = simulate(relays(2 * np.eye(2)), [1.0, -1.0], (0.0, 1.0))
    assert len(trajectory.events) == 1
    assert trajectory(0.25) == steady([0.5, -0.5])
    assert trajectory(0.8) == steady([0.0, 0.0])


@pytest.mark.parametrize("B", [[[-1.0]], [[1.0, -3.0], [-2.0, 1.0]]], ids=["sgn x", "no P-matrix"])
def test_several_continuations_are_reported_or_chosen_from(B):
    system = relays(B)
    zero = np.zeros(len(B))
    with pytest.raises(NonUniqueError, match=r"several continuations.*t = 0"):
        simulate(system, zero, (0.0, 1.0))
    ends = set()
    for wanted in range(3):
        method = EventDriven(lambda t, x, modes, i=wanted: modes[i])
        trajectory = simulate(system, zero, (0.0, 1.0), method=method)
        ends.add(tuple(trajectory.x[-1].round(9)))
    expected = {(0.0,), (1.0,), (-1.0,)} if len(B) == 1 else {(0.0, 0.0), (2.0, 1.0), (-2.0, -1.0)}
    assert ends == expected
    first = simulate(system, zero, (0.0, 1.0), method=EventDriven("first"))
    assert tuple(first.x[-1].round(9)) in expected


def test_a_mode_that_was_not_offered_is_refused():
    with pytest.raises(NonUniqueError, match="not one of"):
        simulate(relays([[-1.0]]), [0.0], (0.0, 1.0), method=EventDriven(lambda t, x, modes: (1,)))


def test_a_triple_integrator_jumps_to_the_origin():
    (event,) = simulate(integrators(3), [0.0, -1.0, 0.0], (0.0, 1.0)).events
    assert (event.kind, event.mode_after, event.multiplicity) == ("jump", (0,), 1)
    assert event.x_after == steady([0.0, 0.0, 0.0])


def test_a_touch_is_no_switch():
    """x = (t - 1)**2 / 2."""
    trajectory = simulate(LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], f=[0, 1]), [0.5, -1.0], (0.0, 3.0))
    assert [(event.kind, event.mode_after) for event in trajectory.events] == [("grazing", ())]
    assert trajectory.events[0].time == pytest.approx(1.0, abs=1e-6)  # a double zero, to the root of rounding
    assert trajectory(3.0) == steady([2.0, 2.0])


@pytest.mark.parametrize("depth", [1e-6, 1e-9])
def test_no_excursion_below_the_tolerance_is_missed(depth):
    """x = (t - 1)**2 / 2 - depth is stopped at zero, an inelastic impact, and lifts off at once."""
    system = LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], f=[0, 1])
    trajectory = simulate(system, [0.5 - depth, -1.0], (0.0, 2.0))
    (event,) = trajectory.events
    hit = 1.0 - math.sqrt(2.0 * depth)
    assert event.time == pytest.approx(hit, abs=1e-6 * math.sqrt(depth))
    assert trajectory(2.0) == pytest.approx([(2.0 - hit) ** 2 / 2, 2.0 - hit], abs=1e-8)


@pytest.mark.parametrize("at_the_end", [True, False])
def test_an_impact_at_the_end_of_the_interval_is_noted(at_the_end):
    hit = math.sqrt(2.0 / 9.81)
    system = LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], f=[0, -9.81])
    trajectory = simulate(system, [1.0, 0.0], (0.0, hit if at_the_end else 0.999 * hit))
    assert [event.kind for event in trajectory.events] == (["jump"] if at_the_end else [])
    assert trajectory(trajectory.t[-1])[1] == pytest.approx(0.0 if at_the_end else -9.81 * 0.999 * hit)


def test_a_start_on_the_constraint_is_no_event():
    trajectory = simulate(LCS([[0.0]], [[1.0]], [[1.0]], f=[-1.0]), [0.0], (0.0, 1.0))
    assert trajectory.events == ()
    assert trajectory.u[-1] == pytest.approx([1.0])


def test_a_wall_that_moves_like_a_sine_carries_the_particle_until_it_is_too_fast():
    """x' = -1/2 + u, x >= sin t: caught at x = 1/2 - t/2 = sin t, left where cos t = -1/2."""
    system = LCS([[0.0]], [[1.0]], [[1.0]], f=[-0.5], g=sine(-1.0, frequency=0.5 / math.pi))
    trajectory = simulate(system, [0.5], (0.0, 3.0))
    caught = brentq(lambda t: 0.5 - 0.5 * t - math.sin(t), 0.0, 1.0, xtol=1e-15)
    assert [event.time for event in trajectory.events] == pytest.approx([caught, 2 * math.pi / 3], rel=1e-12)
    assert trajectory(1.0) == steady([math.sin(1.0)])
    left = 2 * math.pi / 3
    assert trajectory(3.0) == steady([math.sin(left) - 0.5 * (3.0 - left)])


def test_inputs_that_jump_are_events_and_may_force_the_state_to_jump():
    trajectory = simulate(pulled_particle().system, [0.5], (0.0, 2.0))
    assert [(event.time, event.kind) for event in trajectory.events] == [
        (0.5, "switch"),
        (1.0, "input"),
        (1.5, "jump"),
    ]
    assert trajectory.events[-1].impulse == pytest.approx([2.0])
    assert trajectory(1.5) == steady([3.0])


def test_a_jump_has_its_impulse_and_the_energy_it_loses():
    """Two capacitors, 1 at 3 V and 2 at 0 V: the charge 2 flows, and of 4.5 J there remain 1.5."""
    problem = two_capacitors()
    (event,) = simulate(problem.system, problem.x0, (0.0, 1.0)).events
    assert event.impulse == pytest.approx([2.0])
    assert event.energy_lost == pytest.approx(3.0)


def test_a_state_from_which_nothing_goes_on_is_named():
    with pytest.raises(InfeasibleError, match=r"no mode goes on from x = \[-1\.\].*t = 0"):
        simulate(LCS([[0.0]], [[0.0]], [[1.0]]), [-1.0], (0.0, 1.0))
    with pytest.raises(InfeasibleError):
        simulate(two_integrators([[0, 0], [0, 0]]), [1.0, -1.0], (0.0, 1.0))


def test_too_many_events_are_refused_by_time():
    with pytest.raises(IterationLimitError, match="5 events by t = "):
        simulate(diode_bridge().system, [10.0, 0.0], (0.0, 5e-3), method=EventDriven(max_events=5))


def test_an_interrupt_keeps_the_trajectory_so_far():
    answers = iter([False] * 5 + [True] * 5)
    problem = diode_bridge()
    trajectory = simulate(problem.system, problem.x0, (0.0, 5e-3), interrupt=lambda: next(answers))
    assert trajectory.status == "interrupted"
    assert 0.0 < trajectory.t[-1] < 5e-3
    assert trajectory.x[-1] == pytest.approx(problem.exact(trajectory.t[-1]), rel=1e-10)


@pytest.mark.parametrize("seed", [*range(6), *nightly(range(6, 12))])
def test_random_passive_systems_keep_their_constraints_and_lose_energy(seed):
    """x' = (J - R) x + B u, y = B^T x + D u with J skew, R and D + D^T positive definite: Q = I."""
    rng = np.random.default_rng(seed)
    n, k = rng.integers(2, 6), rng.integers(1, 4)
    J, R, N = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(k, k))
    B = rng.normal(size=(n, k))
    D = 0.1 * N @ N.T + (N - N.T) if seed % 2 else np.zeros((k, k))
    system = LCS(J - J.T - 0.1 * R @ R.T, B, B.T, D)
    x0 = rng.normal(size=n)
    trajectory = simulate(system, x0, (0.0, 5.0))
    assert trajectory.u.min() > -1e-10
    assert trajectory.y.min() > -1e-10
    assert np.abs(trajectory.u * trajectory.y).max() < 1e-12
    assert trajectory.y == pytest.approx(trajectory.x @ B + trajectory.u @ D.T, abs=1e-10)
    assert np.all(np.diff(np.sum(trajectory.x**2, axis=1)) < 1e-12)
    times = np.linspace(0.0, 5.0, 6)
    stepped = simulate(system, x0, (0.0, 5.0), method=TimeStepping(tolerance=1e-6), t_eval=times)
    assert trajectory(times) == pytest.approx(stepped.x, abs=2e-4)


@pytest.mark.parametrize("parasitic", [None, 1e-9])
def test_a_stiff_rectifier_takes_the_steps_of_its_slow_part_alone(parasitic):
    """A 50 Hz source of 10 V behind 1 mOhm and a diode charges 1 mF beside 100 Ohm; 1 nF behind another mOhm, or none.

    While the diode blocks the voltage falls as e^{-t/0.1 s}.
    """
    r, C, R = 1e-3, 1e-3, 100.0
    source = sine(-10.0, frequency=50.0)
    if parasitic is None:
        system = LCS([[-1 / (R * C)]], [[1 / C]], [[1.0]], [[r]], g=source)
    else:
        A = [[-1 / (R * C) - 1 / (r * C), 1 / (r * C)], [1 / (r * parasitic), -1 / (r * parasitic)]]
        system = LCS(A, [[0.0], [1 / parasitic]], [[0.0, 1.0]], [[r]], g=source)
    trajectory = simulate(system, np.zeros(system.shape[0]), (0.0, 0.1))
    assert trajectory.accepted < 3000
    assert sum(event.time > 1e-9 for event in trajectory.events) == 9
    off = trajectory.events[-1].time
    assert 0.085 < off < 0.086
    times = np.array([off + 1e-4, 0.1])
    v = trajectory(times)[:, 0]
    assert v[1] / v[0] == pytest.approx(math.exp(-(times[1] - times[0]) / (R * C)), rel=1e-6)
    assert v[0] == pytest.approx(10.0, rel=0.02)


@pytest.mark.parametrize("seed", range(10))
def test_units_do_not_matter(seed):
    """x = S x', u = P u', y = P^-1 y', t = T t' with powers of ten from 1e-9 to 1e9."""
    rng = np.random.default_rng(seed)
    n, k = rng.integers(1, 5), rng.integers(1, 4)
    J, R, B = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(n, k))
    A, x0 = J - J.T - 0.1 * R @ R.T, rng.normal(size=n)
    S, P = 10.0 ** rng.integers(-8, 9, n), 10.0 ** rng.integers(-6, 7, k)
    T = 10.0 ** rng.integers(-9, 4)
    plain = simulate(LCS(A, B, B.T), x0, (0.0, 3.0))
    scaled = LCS(A * S[:, None] / S / T, B * S[:, None] / P / T, B.T / P[:, None] / S)
    other = simulate(scaled, x0 * S, (0.0, 3.0 * T))
    assert other(3.0 * T) / S == pytest.approx(plain(3.0), abs=1e-10)
    assert [event.time / T for event in other.events] == pytest.approx([event.time for event in plain.events])


def test_a_twisting_relay_comes_to_rest_in_finite_time():
    """x'' = -2 sgn x - sgn x' from (0, 2): the speed at x = 0 falls by the factor sqrt(1/3) from pass to pass.

    Out against 3 for v/3, back against 1 for v/sqrt(3): together (1/3 + 1/sqrt 3) v, with v = 2, 2/sqrt 3, ....
    """
    B, C = [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 1.0, 0.0]], [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
    D = np.kron(np.eye(2), [[0.0, 1.0], [-1.0, 0.0]])
    twisting = LCS([[0.0, 1.0], [0.0, 0.0]], B, C, D, f=[0.0, -3.0], g=[0.0, 2.0, 0.0, 2.0])
    trajectory = simulate(twisting, [0.0, 2.0], (0.0, 6.0), method=EventDriven("first"))
    zeno = trajectory.events[-1]
    assert zeno.kind == "zeno"
    shrink = 1.0 / math.sqrt(3.0)
    assert zeno.time == pytest.approx(2.0 * (1.0 / 3.0 + shrink) / (1.0 - shrink), rel=1e-10)
    assert trajectory(6.0) == pytest.approx([0.0, 0.0], abs=1e-10)


def test_events_that_accumulate_where_nothing_goes_on_are_an_error():
    """Example 11.1 from (3, 1), at rest from t = 2 on, beside a clock that must not pass zero and does at t = 2."""
    spiral = two_relays()
    A, B = np.zeros((3, 3)), np.zeros((3, 5))
    B[:2, :4] = spiral.B
    C, D = np.zeros((5, 3)), np.zeros((5, 5))
    C[:4, :2], C[4, 2], D[:4, :4] = spiral.C, 1.0, spiral.D
    system = LCS(A, B, C, D, f=[*spiral.f.after(0.0), -1.0], g=[*spiral.g.after(0.0), 0.0])
    with pytest.raises(ZenoError, match=r"events accumulate at t = 2.*nothing goes on"):
        simulate(system, [3.0, 1.0, 2.0], (0.0, 3.0))
    assert simulate(system, [3.0, 1.0, 2.5], (0.0, 2.4)).events[-1].kind == "zeno"


@pytest.mark.parametrize(
    ("A", "B", "C", "x0"),
    [
        ([[0]], [[1]], [[0]], [0]),  # x' = u, y = 0
        ([[0, 0], [0, 0]], [[1], [0]], [[0, 1]], [2, 0]),  # x1' = u, y = x2 = 0
        (
            [[0, 0], [0, 0]],
            [[1, 1], [1, 0]],
            [[1, -1], [0, 0]],
            [0, 0],
        ),  # y1 sees u2 alone
        (
            [[0, 0], [0, 0]],
            [[1, 2], [1, 2]],
            [[1, -1], [-1, 1]],
            [0, 0],
        ),  # two inputs that the difference misses
    ],
)
def test_inputs_that_no_output_sees_leave_the_state_open(A, B, C, x0):
    system = LCS(A, B, C)
    with pytest.raises(NonUniqueError, match=r"several continuations .* no output sees"):
        simulate(system, x0, (0.0, 1.0))
    assert simulate(system, x0, (0.0, 1.0), method=EventDriven("first")).x[-1] == steady(x0)


def test_inputs_that_no_output_sees_and_that_move_nothing_leave_the_state_alone():
    """x' = 2 - x - u1 - u2, y = 1 - x twice, once doubled: x = 1 from ln 2 on, however u1 + u2 = 1 is shared."""
    system = LCS([[-1, 0], [0, 0]], [[-1, -1], [0, 0]], [[-1, 1], [-2, 2]], f=[2.0, 0.0])
    trajectory = simulate(system, [0.0, 1.0], (0.0, 2.0), t_eval=[0.5, 2.0])
    assert trajectory.x[:, 0] == steady([2.0 - 2.0 * math.exp(-0.5), 1.0])
    assert trajectory.u[1].sum() == steady(1.0)


def test_inputs_may_be_shared_only_where_there_are_some():
    """x1' = f + u1, x2' = f + u2, y1 = y2 = x1 + x2: u1 + u2 = -2 f, which 0 is shared in one way, 2 in many."""
    B, C = np.eye(2), np.ones((2, 2))
    assert simulate(LCS(np.zeros((2, 2)), B, C), [1.0, -1.0], (0.0, 1.0)).x[-1] == steady([1.0, -1.0])
    with pytest.raises(NonUniqueError):
        simulate(LCS(np.zeros((2, 2)), B, C, f=[-1.0, -1.0]), [1.0, -1.0], (0.0, 1.0))


@pytest.mark.parametrize("knot", [1.0, 0.3, 0.1 + 0.2, 1 / 3, 7.7])
@pytest.mark.parametrize("start", [0.0, -1e6])
@pytest.mark.parametrize("drive", [0.0, 1.0], ids=["no input of its own", "held by u"])
def test_an_output_that_reaches_zero_at_a_knot_is_left_to_the_input_after_it(knot, start, drive):
    """x falls from 1 to 0 at the knot, where its rate turns: without u nothing would go on before the turn."""
    times, rates = [start + knot, start + 2 * knot], [[-1 / knot], [1 / knot]]
    system = LCS([[0.0]], [[drive]], [[1.0]], f=PiecewiseConstant(times, rates))
    trajectory = simulate(system, [1.0], (start, start + 2 * knot))
    (event,) = trajectory.events
    assert (event.kind, event.time, event.mode_after) == ("input", start + knot, ())
    assert trajectory.x[-1, 0] == pytest.approx(1.0, abs=2e-9)  # times about 1e6 are known no better
    assert not trajectory.u.any()


def test_a_slack_that_the_input_alone_takes_to_zero_at_its_knot_rises_again():
    system = LCS([[-1.0]], [[0.0]], [[0.0]], g=piecewise_linear([0.0, 0.3, 0.6], [1.0, 0.0, 1.0]))
    trajectory = simulate(system, [1.0], (0.0, 0.6), t_eval=[0.15, 0.3, 0.45])
    assert [event.kind for event in trajectory.events] == ["input"]
    assert trajectory.y[:, 0] == pytest.approx([0.5, 0.0, 0.5], abs=1e-14)
    assert trajectory.x[:, 0] == pytest.approx(np.exp([-0.15, -0.3, -0.45]), rel=1e-14)


@pytest.mark.parametrize("method", [EventDriven(), TimeStepping(step=0.5)])
def test_a_state_that_grows_without_bound_overflows_at_a_time(method):
    """x = e^t is 1e140 at t = 140 ln 10 = 322.4."""
    system = LCS([[1.0]], [[1.0]], [[1.0]])
    with pytest.raises(NumericalError, match=r"the state overflows at t = 3[12]\d"):
        simulate(system, [1.0], (0.0, 1000.0), method=method)
    assert simulate(system, [1.0], (0.0, 300.0)).x[-1, 0] == pytest.approx(math.exp(300.0), rel=1e-11)


@pytest.mark.parametrize("method", ["event-driven", "time-stepping"])
def test_a_state_that_is_too_large_from_the_start_overflows_there(method):
    with pytest.raises(NumericalError, match="the state overflows at t = 0:"):
        simulate(LCS([[-1.0]], [[1.0]], [[1.0]]), [1e300], (0.0, 1.0), method=method)


def test_an_input_that_overflows_says_so():
    growing = Exosystem([[1.0]], [[1.0]], [[1.0], [1.0]], times=[0.0, 2000.0])
    with pytest.raises(NumericalError, match="the input overflows at t = 1999"):
        simulate(LCS([[-1.0]], [[1.0]], [[1.0]], f=growing), [0.0], (1999.0, 2001.0))


@pytest.mark.parametrize("f", [1e308, -1e308])
def test_coefficients_that_no_units_bring_together_are_refused(f):
    with pytest.raises(NumericalError, match="take units of state, input and time"):
        simulate(LCS([[-1.0]], [[1.0]], [[1.0]], f=[f]), [1.0], (0.0, 1.0))


@pytest.mark.parametrize(
    ("A", "f", "rest"),
    [
        ([[-1.0]], [0.0], [0.0]),
        ([[-1.0]], [1.0], [1.0]),
        ([[-0.1, 1.0], [-1.0, -0.1]], [0.0, 0.0], [0.0, 0.0]),
        ([[-0.1, 1.0], [-1.0, -0.1]], [1.0, 1.0], [1.1 / 1.01, -0.9 / 1.01]),
    ],
    ids=["decay", "to a fixed point", "oscillation", "oscillation about a fixed point"],
)
@pytest.mark.parametrize("end", [1e9, 1e300])
def test_a_settled_state_is_followed_no_longer(A, f, rest, end):
    """-A^-1 f; the slowest of these would otherwise take 1e9 Taylor polynomials."""
    n = len(A)
    trajectory = simulate(LCS(A, np.zeros((n, 1)), np.zeros((1, n)), [[1.0]], f=f), np.ones(n), (0.0, end))
    assert trajectory.x[-1] == pytest.approx(rest, abs=1e-12)
    assert trajectory.accepted < 4000
    state = rest + expm(2.0 * np.array(A)) @ (np.ones(n) - rest)
    assert trajectory(2.0) == pytest.approx(state, abs=1e-12)


@pytest.mark.parametrize("end", [1e6, 1e300])
def test_a_motion_that_never_settles_but_meets_nothing_costs_nothing(end):
    """x = (cos t, -sin t) and a third state that drifts: both stay away from the constraints y = 2 + x1, y = 1 + x3."""
    A = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    system = LCS(A, np.eye(3)[:, ::2], np.eye(3)[::2], f=[0.0, 0.0, 1e-3], g=[2.0, 1.0])
    trajectory = simulate(system, [1.0, 0.0, 0.0], (0.0, min(end, 1e130)))
    assert trajectory.accepted < 10
    assert trajectory.events == ()
    times = np.array([1.0, 1234.5, 9.9e5])
    exact = np.column_stack([np.cos(times), -np.sin(times), 1e-3 * times])
    assert trajectory(times) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("d", 10.0 ** np.arange(-14.0, 0.0, 2.0))
def test_feedthrough_of_any_size_lets_the_rectifier_hold_its_crest(d):
    """x' = u, y = x + d u - sin 2 pi t: x follows the sine to its crest, 1 at t = 1/4, and stays there."""
    run = simulate(LCS([[0.0]], [[1.0]], [[1.0]], [[d]], g=sine(-1.0, 1.0)), [0.0], (0.0, 3.0))
    assert run.x[-1, 0] == pytest.approx(1.0, abs=1e-12 + 25.0 * d)
    assert run.unique is True


def test_a_megahertz_costs_nothing_without_events():
    """x' = -1000 x + 1000 sin: after the decay amplitude and phase of the transfer function."""
    w = 2e6 * math.pi
    system = LCS([[-1e3]], [[1.0]], [[0.0]], [[1.0]], f=sine([1e3], 1e6))
    run = simulate(system, [0.0], (0.0, 0.1))
    assert run.accepted < 1000
    t = 0.1 - 0.25e-6
    assert run(t)[0] == pytest.approx((1e3 / (1j * w + 1e3) * np.exp(1j * w * t)).imag, abs=1e-12)


def test_an_offset_of_rounding_size_is_none():
    data = ([[-1, 0.5], [0.3, -1]], np.eye(2), np.eye(2), [[1, 0.2], [0.3, 1]])
    noisy, plain = (simulate(LCS(*data, f=[f, 1.0]), [-1.0, -2.0], (0.0, 1.0)) for f in (1e-17, 0.0))
    assert noisy.accepted < 50
    assert noisy.x[-1] == pytest.approx(plain.x[-1], abs=1e-15)


def test_uniqueness_is_claimed_only_where_it_is_known():
    assert simulate(diode_bridge().system, [10.0, 0.0], (0.0, 1e-3)).unique is True
    chosen = simulate(relays([[-1.0]]), [0.0], (0.0, 1.0), method=EventDriven("first"))
    assert chosen.unique is None
    stepped = simulate(relays([[1.0]]), [1.0], (0.0, 0.5), method=TimeStepping(step=0.1))
    assert stepped.unique is None


def test_a_limit_of_events_says_what_repeats():
    with pytest.raises(IterationLimitError, match=r"5 events by t = .*; the modes \(.* follow each other"):
        simulate(diode_bridge().system, [10.0, 0.0], (0.0, 5e-3), method=EventDriven(max_events=5))


def test_three_contacts_under_a_slow_sine_do_not_chatter():
    """Two of them close one after the other ever faster: the mode of both is where that ends."""
    rates = [
        [-10.544, 0.155, -2.636, -0.204, -0.082, 0.002],
        [-4.258, -0.12, -0.968, -0.082, -0.051, -0.008],
        [-0.044, 0.0, -0.023, 0.002, -0.008, -0.013],
    ]
    A = np.vstack([np.hstack([np.zeros((3, 3)), np.eye(3)]), rates])
    B = np.vstack(
        [np.zeros((3, 3)), [[3.392, 0.444, 3.27], [1.226, -0.175, 1.419], [-0.049, -0.317, -0.006]]]
    )
    normals = [[1.585, -0.774, 0.471], [0.499, -0.864, -1.181], [1.014, 0.517, -0.163]]
    drive = sine([0.0, 0.0, 0.0, 0.85, -1.034, -0.288], 0.024, phase=0.646)
    for f in (drive, sine([0.85, -1.034, -0.288, -1.365, -0.101, 0.079], 0.024, phase=0.646)):
        system = LCS(A, B, np.hstack([normals, np.zeros((3, 3))]), f=f)
        run = simulate(system, [0.789, -1.351, 0.477, -1.21, 0.378, 1.972], (0.0, 5.0))
        assert len(run.events) < 200
        assert run.y.min() >= -1e-9
