import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.models import HamiltonianSystem, MechanicalSystem
from tests.problems.nightly import nightly

G = 9.81


def pendulum(restitution=0.0, wall=-0.3):
    """Angle q from the vertical, a wall at q = wall."""
    return HamiltonianSystem(
        energy=lambda q, p: 0.5 * p[0] ** 2 - G * math.cos(q[0]),
        gradient=lambda q, p: (np.array([G * math.sin(q[0])]), p),
        constraints=lambda q: q - wall,
        constraint_jacobian=lambda q: np.eye(1),
        restitution=restitution,
    )


def test_between_impacts_the_energy_does_not_change():
    swing = pendulum(wall=-10.0).simulate([1.0], [0.0], (0.0, 10.0), steps=500)
    assert np.ptp(swing.energy) < 1e-11
    assert not swing.impulses.any()


def test_the_angle_converges_with_order_two_between_impacts():
    fine = pendulum(wall=-10.0).simulate([1.0], [0.0], (0.0, 2.0), steps=1600).q[-1]
    errors = [
        abs(pendulum(wall=-10.0).simulate([1.0], [0.0], (0.0, 2.0), steps=steps).q[-1] - fine).item()
        for steps in (50, 100, 200)
    ]
    assert -np.polyfit(range(3), np.log2(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_an_impact_adds_no_energy_and_turns_the_velocity_by_newton_s_law(e):
    swing = pendulum(e).simulate([1.0], [0.0], (0.0, 3.0), steps=1500)
    assert np.all(np.diff(swing.energy) <= 1e-11)
    assert swing.gaps.min() > -1e-9
    hit = int(np.flatnonzero(swing.impulses[:, 0] > 0.1)[0])
    speed = -math.sqrt(2.0 * G * (math.cos(0.3) - math.cos(1.0)))
    assert swing.p[hit - 1, 0] == pytest.approx(speed, rel=5e-3)
    assert swing.p[hit, 0] == pytest.approx(-e * speed, abs=1e-2)
    assert swing.impulses[hit, 0] == pytest.approx(-(1.0 + e) * speed, rel=1e-2)
    if e == 1.0:
        assert np.ptp(swing.energy) < 1e-9


def test_a_mass_that_depends_on_the_place_keeps_its_energy():
    """A bead on the parabola y = x^2 / 2: H = p^2 / (2 (1 + x^2)) + G x^2 / 2."""
    bead = HamiltonianSystem(
        energy=lambda q, p: 0.5 * p[0] ** 2 / (1.0 + q[0] ** 2) + 0.5 * G * q[0] ** 2,
        gradient=lambda q, p: (
            np.array([-(p[0] ** 2) * q[0] / (1.0 + q[0] ** 2) ** 2 + G * q[0]]),
            p / (1.0 + q[0] ** 2),
        ),
        constraints=lambda q: q + 0.5,
        constraint_jacobian=lambda q: np.eye(1),
        restitution=0.5,
    )
    slide = bead.simulate([1.0], [0.0], (0.0, 4.0), steps=1000)
    free = slide.impulses[1:, 0] == 0.0
    assert np.abs(np.diff(slide.energy)[free]).max() < 1e-11
    assert np.diff(slide.energy).max() < 1e-9
    assert slide.energy[-1] < 0.6 * slide.energy[0]


def test_linear_mechanics_is_the_limit_of_small_steps():
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]])
    F = np.array([[1.0, 0.0], [1.0, -1.0]])
    exact = MechanicalSystem(np.eye(2), np.zeros((2, 2)), stiffness, F).simulate(
        [0.3, 0.1], [-0.5, 0.2], (0.0, 3.0)
    )
    same = HamiltonianSystem(
        energy=lambda q, p: float(0.5 * (p @ p + q @ stiffness @ q)),
        gradient=lambda q, p: (stiffness @ q, p),
        constraints=lambda q: F @ q,
        constraint_jacobian=lambda q: F,
    )
    for steps, error in ((125, 1e-4), (500, 1e-5)):
        found = same.simulate([0.3, 0.1], [-0.5, 0.2], (0.0, 3.0), steps=steps)
        assert np.hstack([found.q[-1], found.p[-1]]) == pytest.approx(exact(3.0), abs=error)


def ball(restitution):
    return HamiltonianSystem(
        energy=lambda q, p: 0.5 * p @ p + G * q[0],
        gradient=lambda q, p: (np.array([G]), p),
        constraints=lambda q: q,
        constraint_jacobian=lambda q: np.eye(1),
        restitution=restitution,
    )


def height(e, t):
    """Return the height of a ball dropped from 1 m, flight by flight (closed form)."""
    speed = math.sqrt(2.0 * G)
    since = t - speed / G
    if since < 0.0:
        return 1.0 - 0.5 * G * t**2
    while speed > 1e-9:
        speed *= e
        if since < 2.0 * speed / G:
            return speed * since - 0.5 * G * since**2
        since -= 2.0 * speed / G
    return 0.0


@pytest.mark.parametrize("e", [0.0, 0.1, 0.35, 0.5, 0.7, 0.9, 1.0])
@pytest.mark.parametrize("steps", [40, 150])
def test_a_dropped_ball_bounces_and_comes_to_rest_at_any_restitution(e, steps):
    """Off by the flights alone that die out within one step: g h**2 / 8."""
    fall = ball(e).simulate([1.0], [0.0], (0.0, 3.0), steps=steps)
    error = max(abs(q - height(e, t)) for q, t in zip(fall.q[:, 0], fall.t, strict=True))
    assert error < G * (3.0 / steps) ** 2 / 8
    assert np.diff(fall.energy).max() < 1e-10
    if e <= 0.5:
        assert (abs(fall.q[-1, 0]), fall.p[-1, 0]) == (
            pytest.approx(0.0, abs=1e-12),
            pytest.approx(0.0, abs=1e-12),
        )
        assert fall.impulses[-1, 0] == pytest.approx(G * 3.0 / steps)


@pytest.mark.parametrize("e", [0.0, 0.3, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("q0", [0.0, -1e-16])
def test_a_ball_that_lies_stays(e, q0):
    lying = ball(e).simulate([q0], [0.0], (0.0, 0.1), steps=20)
    assert np.abs(lying.q).max() < 1e-12
    assert np.abs(lying.p).max() < 1e-12


@pytest.mark.parametrize("e", [0.0, 0.8, *nightly([0.4, 1.0])])
def test_errors_with_impacts_decrease_steadily_with_order_two(e):
    """A pendulum against a wall, up to a time after several impacts."""
    fine = pendulum(e).simulate([1.0], [0.0], (0.0, 2.3), steps=800)
    errors = []
    for steps in (25, 50, 100):
        found = pendulum(e).simulate([1.0], [0.0], (0.0, 2.3), steps=steps)
        errors.append(np.abs([found.q[-1, 0] - fine.q[-1, 0], found.p[-1, 0] - fine.p[-1, 0]]).max())
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2]


@pytest.mark.parametrize("seed", [*range(5), *nightly(range(5, 8))])
def test_stacks_of_balls_end_without_gain_of_energy(seed):
    """Two or three balls above each other, of random masses, restitution and heights."""
    rng = np.random.default_rng(seed)
    n, e = int(rng.integers(2, 4)), float(rng.choice([0.0, 0.2, 0.5, 0.7]))
    m, C = rng.uniform(0.5, 2.0, n), np.eye(n) - np.eye(n, k=-1)
    stack = HamiltonianSystem(
        energy=lambda q, p: float(0.5 * (p * p / m).sum() + G * m @ q),
        gradient=lambda q, p: (G * m, p / m),
        constraints=lambda q: C @ q,
        constraint_jacobian=lambda q: C,
        restitution=e,
    )
    fall = stack.simulate(np.cumsum(rng.uniform(0.0, 0.3, n)), np.zeros(n), (0.0, 2.0), steps=60)
    assert np.diff(fall.energy).max() < 1e-9
    assert fall.gaps.min() > -1e-8
    if e <= 0.2:
        assert fall.q[-1] == pytest.approx(np.zeros(n), abs=1e-8)


@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("q0", {"q0": [-1.0]}),
        ("q0", {"q0": [], "p0": []}),
        ("q0", {"q0": [[1.0], [1.0, 2.0]]}),
        ("p0", {"p0": [0.0, 1.0]}),
        ("steps", {"steps": 0}),
        ("steps", {"steps": 2.5}),
        ("steps", {"steps": "10"}),
        ("steps", {"steps": 10**12}),
        ("t_span", {"t_span": (1.0, 0.0)}),
        ("t_span", {"t_span": (0.0, math.nan)}),
        ("t_span", {"t_span": (0.0, math.inf)}),
        ("t_span", {"t_span": (-1e308, 1e308)}),
        ("t_span", {"t_span": (0.0, 1.0, 2.0)}),
        ("t_span", {"t_span": None}),
        ("t_span", {"t_span": "01"}),
    ],
)
def test_bad_arguments_are_refused(field, arguments):
    given = {"q0": [1.0], "p0": [0.0], "t_span": (0.0, 1.0), "steps": 10, **arguments}
    with pytest.raises(InvalidInputError, match=field):
        pendulum().simulate(**given)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("restitution", 1.5),
        ("restitution", -0.1),
        ("restitution", math.nan),
        ("restitution", "x"),
        pytest.param("restitution", 10**5000, id="an integer of 5001 digits"),
        ("energy", 1.0),
        ("gradient", None),
        ("constraints", np.eye(1)),
        ("constraint_jacobian", "q"),
    ],
)
def test_bad_parts_of_a_system_are_refused(field, value):
    with pytest.raises(InvalidInputError, match=field):
        replace(pendulum(), **{field: value})


@pytest.mark.parametrize(
    ("field", "function"),
    [
        ("energy", lambda q, p: p),
        ("energy", lambda q, p: "much"),
        ("gradient", lambda q, p: p),
        ("gradient", lambda q, p: (np.zeros(2), p)),
        ("gradient", lambda q, p: (1j * q, p)),
        ("constraints", lambda q: np.ones((2, 2))),
        ("constraints", lambda q: [math.nan]),
        ("constraints", lambda q: [[1.0], [1.0, 2.0]]),
        ("constraints", lambda q: np.ones(1 if q[0] == 1.0 else 2)),
        ("constraint_jacobian", lambda q: np.eye(2)),
    ],
)
def test_functions_that_return_something_else_are_named(field, function):
    with pytest.raises(InvalidInputError, match=field):
        replace(pendulum(), **{field: function}).simulate([1.0], [0.0], (0.0, 1.0), steps=10)


@pytest.mark.parametrize(
    ("field", "function"),
    [
        ("energy", lambda q, p: math.nan),
        ("gradient", lambda q, p: (np.array([math.inf]), p)),
        ("constraints", lambda q: q if q[0] == 1.0 else [math.nan]),
        ("constraint_jacobian", lambda q: [[math.nan]]),
    ],
)
def test_functions_without_a_value_on_the_way_are_named(field, function):
    with pytest.raises(NumericalError, match=f"{field} has no finite value"):
        replace(pendulum(), **{field: function}).simulate([1.0], [0.0], (0.0, 1.0), steps=10)


def test_numpy_numbers_are_numbers():
    span = (np.float32(0.0), np.int64(1))
    swing = pendulum(np.float32(0.5)).simulate([np.int64(1)], [0.0], span, steps=np.int64(10))
    assert np.array_equal(swing.q, pendulum(0.5).simulate([1.0], [0.0], (0.0, 1.0), steps=10).q)


@pytest.mark.parametrize("end", [1e6, 1e300])
def test_steps_that_are_far_too_long_say_so(end):
    with pytest.raises(NumericalError, match=r"take more steps|overflows|no finite value"):
        pendulum().simulate([1.0], [0.0], (0.0, end), steps=100)


def test_a_motion_without_bound_overflows_at_a_time():
    """H = (p^2 - q^2)/2: q = cosh t passes 1e140 at t = 323."""
    saddle = HamiltonianSystem(
        energy=lambda q, p: 0.5 * float(p @ p - q @ q),
        gradient=lambda q, p: (-q, p),
        constraints=lambda q: q,
        constraint_jacobian=lambda q: np.eye(1),
    )
    with pytest.raises(NumericalError, match=r"the state overflows at t = 3[0-3]\d"):
        saddle.simulate([1.0], [0.0], (0.0, 400.0), steps=1600)
