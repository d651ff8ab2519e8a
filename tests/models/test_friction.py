"""Coulomb friction: against closed forms, its own law at every step, and the energy on random systems."""

import math
from fractions import Fraction

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp import LCP, solve
from pricing_core.lcs import EventDriven, TimeStepping
from pricing_core.models import (
    MechanicalSystem,
    PiecewiseLinearSystem,
    box_stack,
    coulomb_friction,
    friction_directions,
)

G = 9.81
SCHEMES = ("moreau", "stewart-trinkle")


def steps(scheme, h):
    return TimeStepping(scheme, step=h)


def block(friction, force=(0.0, -G)):
    """Return a mass of 1 above a floor, with coordinates along and above it."""
    nothing = np.zeros((2, 2))
    return MechanicalSystem(
        np.eye(2), nothing, nothing, [[0.0, 1.0]], force, tangents=[[1.0, 0.0]], friction=[friction]
    )


def puck(friction, m):
    """Return a mass of 1 on a floor in space with m directions of friction."""
    nothing = np.zeros((3, 3))
    directions = friction_directions([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], m)
    return MechanicalSystem(
        np.eye(3),
        nothing,
        nothing,
        [[0.0, 0.0, 1.0]],
        [0.0, 0.0, -G],
        tangents=[directions],
        friction=[friction],
    )


def ball(friction, restitution=0.0, gravity=G, radius=0.3):
    """Return a solid ball of mass 1 with coordinates x, y, rotation; its lowest point slides at x' + r rotation'."""
    nothing = np.zeros((3, 3))
    return MechanicalSystem(
        np.diag([1.0, 1.0, 0.4 * radius**2]),
        nothing,
        nothing,
        [[0.0, 1.0, 0.0]],
        [0.0, -gravity, 0.0],
        restitution=restitution,
        tangents=[[1.0, 0.0, radius]],
        friction=[friction],
    )


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("friction", [0.1, 0.4, 1.3])
def test_a_sliding_block_stops_where_coulomb_says(scheme, friction):
    """It stops after v/(mu g), at v^2/(2 mu g); Moreau's scheme misses it by mu g h^2/8, the implicit one by v h/2."""
    speed, h = 3.0, 4e-3
    stop, distance = speed / (friction * G), speed**2 / (2.0 * friction * G)
    run = block(friction).simulate([0.0, 0.0], [speed, 0.0], (0.0, 1.5 * stop), method=steps(scheme, h))
    missed = 0.126 * friction * G * h**2 + (scheme == "stewart-trinkle") * 0.51 * speed * h
    assert run.x[-1] == pytest.approx([distance, 0.0, 0.0, 0.0], abs=missed)
    moving = run.t[np.abs(run.x[:, 2]) > 1e-9]
    assert moving[-1] == pytest.approx(stop, abs=1.1 * h)
    slides = (run.t > 0.0) & (run.t < stop - h)
    assert run.friction_force[slides, 0] == pytest.approx(-friction * G, rel=1e-9)
    assert run.u[1:, 0] == pytest.approx(G, rel=1e-9)
    assert run.slip[:, 0] == pytest.approx(run.x[:, 2], abs=1e-15)


def test_controlled_steps_find_the_stop_by_themselves():
    run = block(0.4).simulate(
        [0.0, 0.0], [3.0, 0.0], (0.0, 1.5), method=TimeStepping(tolerance=1e-8, absolute_tolerance=1e-8)
    )
    assert run.scheme == "moreau"
    assert run.x[-1, 0] == pytest.approx(9.0 / (0.8 * G), abs=1e-6)
    assert run.accepted < 500


@pytest.mark.parametrize("m", [4, 8])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_polyhedral_cone_brakes_less_by_at_most_its_stated_error(scheme, m):
    """Along a direction by mu g, between two by cos(pi/m) of that."""
    friction, speed, h = 0.5, 1.0, 2e-3
    for angle, brake in ((0.0, friction * G), (math.pi / m, friction * G * math.cos(math.pi / m))):
        way = np.array([math.cos(angle), math.sin(angle)])
        run = puck(friction, m).simulate(
            [0.0, 0.0, 0.0], [*(speed * way), 0.0], (0.0, 0.4), method=steps(scheme, h)
        )
        assert run.x[-1, :2] == pytest.approx(speed**2 / (2.0 * brake) * way, abs=0.6 * speed * h)
        assert run.x[-1, 3:] == pytest.approx(np.zeros(3), abs=1e-12)
        assert run.friction_force.shape == run.slip.shape == (run.t.size, 1, m)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("angle", [0.2, 0.5, 1.0])
def test_a_block_on_a_slope_sticks_up_to_its_angle_of_friction_and_slides_beyond(scheme, angle):
    force = (G * math.sin(angle), -G * math.cos(angle))
    held = block(1.001 * math.tan(angle), force)
    run = held.simulate([0.0, 0.0], [0.0, 0.0], (0.0, 2.0), method=steps(scheme, 0.01))
    assert np.abs(run.x).max() <= 1e-13
    assert run.friction_force[1:, 0] == pytest.approx(-force[0], rel=1e-12)
    friction = 0.7 * math.tan(angle)
    run = block(friction, force).simulate([0.0, 0.0], [0.0, 0.0], (0.0, 1.0), method=steps(scheme, 1e-2))
    rate = G * (math.sin(angle) - friction * math.cos(angle))
    missed = 5.1e-3 * rate if scheme == "stewart-trinkle" else 1e-12  # rate h/2 at the end
    assert run.x[-1] == pytest.approx([rate / 2.0, 0.0, rate, 0.0], abs=missed)


@pytest.mark.parametrize("friction", [0.02, 0.1, 0.25, 1.0])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("spin", [-20.0, 0.0, 7.0])
def test_a_spinning_ball_bounces_as_the_closed_form_says(friction, restitution, spin):
    """The point of contact stops by 2/7 of its velocity, or is braked by mu times the normal impulse."""
    across, down, radius = 2.0, 3.0, 0.3
    run = ball(friction, restitution, 0.0).simulate(
        [0.0, 0.1, 0.0], [across, -down, spin], (0.0, 0.1), method=steps("moreau", 0.01)
    )
    slip, normal = across + radius * spin, (1.0 + restitution) * down
    impulse = -math.copysign(min(2.0 / 7.0 * abs(slip), friction * normal), slip)
    after = [across + impulse, restitution * down, spin + impulse * radius / (0.4 * radius**2)]
    assert run.x[-1, 3:] == pytest.approx(after, rel=1e-12, abs=1e-12)
    assert run.bounded_steps == 0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_ball_that_slides_comes_to_roll_with_five_sevenths_of_its_speed(scheme):
    friction, speed, h = 0.2, 2.0, 1e-3
    rolls = 2.0 / 7.0 * speed / (friction * G)
    run = ball(friction).simulate([0.0] * 3, [speed, 0.0, 0.0], (0.0, 0.5), method=steps(scheme, h))
    assert run.x[-1, 3:] == pytest.approx(
        [5.0 / 7.0 * speed, 0.0, -5.0 / 7.0 * speed / 0.3], rel=1e-9, abs=1e-12
    )
    distance = rolls * 6.0 / 7.0 * speed + (0.5 - rolls) * 5.0 / 7.0 * speed
    assert run.x[-1, 0] == pytest.approx(distance, abs=2.0 * speed * h / 7.0)
    assert np.abs(run.friction_force[run.t > rolls + 2.0 * h]).max() <= 1e-9


def rocking_block():
    width, height = 0.4, 2.0
    inertia = (width**2 + height**2) / 3.0  # about the corner, per mass
    return box_stack([1.0], [width], [height], [2.0]), width / height, inertia, G * height / (2.0 * inertia)


def test_a_rocking_block_falls_back_and_loses_speed_as_housner_says():
    """phi'' = p^2 (phi - alpha) until it lands, then 1 - 3/2 sin^2 alpha of its speed about the other corner."""
    system, alpha, inertia, square = rocking_block()
    tilt, rate = 0.3 * alpha, math.sqrt(square)
    lands = math.acosh(alpha / (alpha - tilt)) / rate
    errors = []
    for h in (2e-3, 5e-4):
        start = np.array([-0.5 * 2.0 * tilt, 0.5 * 0.4 * tilt, tilt])
        run = system.simulate(start, np.zeros(3), (0.0, 1.5 * lands), method=steps("moreau", h))
        before, after = run.t < lands - 2.0 * h, run.t > lands + 3.0 * h
        arc = alpha - (alpha - tilt) * np.cosh(rate * run.t[before])
        errors.append(np.abs(run.x[before, 2] - arc).max() / tilt)
        speed = -rate * (alpha - tilt) * math.sinh(rate * lands)
        ratio = 1.0 - 0.5 * 0.4**2 / inertia
        late = run.t[after] - lands
        other = -alpha + alpha * np.cosh(rate * late) + ratio * speed / rate * np.sinh(rate * late)
        assert run.x[after, 2] == pytest.approx(other, abs=12.0 * h * abs(speed))
        assert run.x[after, 5][0] / speed == pytest.approx(ratio, rel=20.0 * h)
    assert errors[1] <= 3e-6
    assert errors[1] <= errors[0] / 8.0  # of second order on the arc
    assert ratio == pytest.approx(1.0 - 1.5 * math.sin(math.atan(alpha)) ** 2, rel=1e-12)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_ten_boxes_rest_on_each_other(scheme):
    stack = box_stack(np.ones(10), np.ones(10), np.full(10, 0.5), np.full(10, 0.5))
    run = stack.simulate(np.zeros(30), np.zeros(30), (0.0, 1.0), method=steps(scheme, 0.02))
    assert np.abs(run.x).max() <= 1e-13
    assert run.u[-1] == pytest.approx(0.5 * G * np.repeat(np.arange(10, 0, -1), 2), rel=1e-10)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_top_box_of_ten_slides_off_its_speed_while_the_others_rest(scheme):
    stack = box_stack(np.ones(10), np.ones(10), np.full(10, 0.5), np.full(10, 0.4))
    v, h = np.zeros(30), 2e-3
    v[27] = 1.0
    run = stack.simulate(np.zeros(30), v, (0.0, 0.4), method=steps(scheme, h))
    assert run.x[-1, 27] == pytest.approx(1.0 / (0.8 * G), abs=0.6 * h)
    assert np.abs(np.delete(run.x, [27, 57], axis=1)).max() <= 1e-12


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_stack_of_ten_slides_down_a_slope_as_one(scheme):
    angle, below = 0.35, np.array([0.2] + [0.6] * 9)
    stack = box_stack(np.ones(10), np.full(10, 6.0), np.full(10, 0.5), below, slope=angle)
    run = stack.simulate(np.zeros(30), np.zeros(30), (0.0, 1.0), method=steps(scheme, 0.01))
    rate = G * (math.sin(angle) - 0.2 * math.cos(angle))
    assert run.x[-1, ::3][:10] == pytest.approx(0.5 * rate, abs=6e-3 * rate)
    assert np.ptp(run.x[:, :30:3], axis=1).max() <= 1e-11
    assert np.abs(np.delete(run.x, range(0, 60, 3), axis=1)).max() <= 1e-11


def test_boxes_that_fall_askew_come_to_rest_on_each_other():
    q = np.zeros((5, 3))
    q[:, 1], q[:, 2] = 0.05 * np.arange(1, 6), 0.01 * (-1.0) ** np.arange(5)
    stack = box_stack(np.ones(5), np.ones(5), np.full(5, 0.5), np.full(5, 0.5), restitution=0.2)
    run = stack.simulate(q.ravel(), np.zeros(15), (0.0, 2.0), method=steps("moreau", 1e-2))
    assert np.abs(run.x[-1, 15:]).max() <= 1e-9
    assert run.y.min() >= 0.0
    assert run.u[-1] == pytest.approx(0.5 * G * np.repeat(np.arange(5, 0, -1), 2), rel=1e-8)


@pytest.mark.parametrize(("scheme", "constant"), [("moreau", 1.1), ("stewart-trinkle", 11.0)])
def test_an_oscillator_with_friction_moves_as_its_piecewise_linear_system_does(scheme, constant):
    """Half swings of 5.3, 3.3 and 1.3 about -1 or 1, then it sticks at 0.7; both are of order 1."""
    law = PiecewiseLinearSystem([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], None, [coulomb_friction(1.0)])
    exact = law.simulate([5.3, 0.0], (0.0, 12.0))
    spring = MechanicalSystem(
        np.eye(2),
        np.zeros((2, 2)),
        [[1.0, 0.0], [0.0, 0.0]],
        [[0.0, 1.0]],
        [0.0, -4.0],
        tangents=[[1.0, 0.0]],
        friction=[0.25],
    )
    for h in (0.02, 0.005):
        run = spring.simulate([5.3, 0.0], [0.0, 0.0], (0.0, 12.0), method=steps(scheme, h))
        assert np.abs(run.x[:, 0] - exact(run.t)[:, 0]).max() <= constant * h
    assert run.x[-1, 0] == pytest.approx(0.7, abs=constant * h)
    assert run.friction_force[-1, 0] == pytest.approx(run.x[-1, 0], abs=1e-9)


def rod(friction, angle=math.pi / 4.0):
    """Return a rod of mass 1 and length 2 that slides on its lower end: Painleve's, its Jacobians held fixed."""
    nothing = np.zeros((3, 3))
    return MechanicalSystem(
        np.diag([1.0, 1.0, 1.0 / 3.0]),
        nothing,
        nothing,
        [[0.0, 1.0, -math.cos(angle)]],
        [0.0, -G, 0.0],
        tangents=[[1.0, 0.0, math.sin(angle)]],
        friction=[friction],
    )


@pytest.mark.parametrize("scheme", SCHEMES)
def test_painleves_rod_that_no_force_can_hold_is_stopped_by_an_impulse(scheme):
    """Where mu > 5/3 forces of sliding friction push the end into the floor: none holds it, an impulse stops it."""
    system = rod(2.0)
    coupling = system.contacts().rows @ np.linalg.solve(system.mass, system.contacts().rows.T)
    # The acceleration of the gap per contact force, sliding to the left.
    pushed = coupling[0, 0] + 2.0 * coupling[0, 1]
    assert pushed < 0.0
    with pytest.raises(NumericalError):
        solve(LCP([[pushed]], [-G]))
    run = system.simulate([0.0] * 3, [-1.0, 0.0, 0.0], (0.0, 0.01), method=steps(scheme, 1e-4))
    assert abs(run.slip[1, 0]) <= 1e-12
    assert run.u[1, 0] * 1e-4 > 0.1  # an impulse, whatever the step
    energy = [system.energy(x[:3], x[3:]) + G * x[1] for x in run.x]
    assert np.diff(energy).max() <= 1e-12


def random_system(seed, in_space):
    """Return a system with several coupled contacts, a start that violates none, and its constant force."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(2, 7)), int(rng.integers(1, 5))
    root, stiff, F = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((k, n))
    q, gap = rng.standard_normal(n), rng.uniform(0.0, 0.5, k)
    pairs = rng.standard_normal((k, 2, n))
    tangents = np.array([friction_directions(*pair, 6) for pair in pairs]) if in_space else pairs[:, 0]
    force = rng.standard_normal(n) * rng.choice([0.0, 3.0])
    system = MechanicalSystem(
        root @ root.T + 0.3 * np.eye(n),
        rng.choice([0.0, 0.2]) * stiff.T @ stiff,
        rng.choice([0.0, 2.0]) * stiff @ stiff.T,
        F,
        force,
        np.maximum(gap, gap - F @ q),
        float(rng.choice([0.0, 0.3, 0.7, 1.0])),
        tangents,
        rng.uniform(0.0, 2.0, k),
    )
    return system, q, 2.0 * rng.standard_normal(n), force


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize(
    "seeds", [range(40), pytest.param(range(100, 1100), marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_energy_never_grows_in_any_step_and_nothing_penetrates(seeds, in_space):
    bounded = 0
    for seed in seeds:
        system, q, v, force = random_system(seed, in_space)
        for scheme in SCHEMES if system.restitution == 0.0 else SCHEMES[:1]:
            run = system.simulate(q, v, (0.0, 1.0), method=steps(scheme, 0.02))
            n = q.size
            energies = np.array([system.energy(x[:n], x[n:]) - force @ x[:n] for x in run.x])
            terms = system.energy(q, v) + np.abs(run.x[:, :n] @ force).max()
            assert np.diff(energies).max() <= 1e-12 * terms
            assert (run.x[:, :n] @ system.F.T + system.offset).min() >= -1e-12
            bounded += run.bounded_steps
    assert bounded > 0  # Newton's law alone would have gained energy


def test_where_newtons_law_would_gain_energy_the_rebound_is_what_conserves_it():
    """The contact rises with e times its speed of approach and sticks: by friction that pushes it on."""
    responses = np.array([[1.0, -0.6], [-0.6, 1.0]])  # velocities of gap and slip per impulse
    nothing, before = np.zeros((2, 2)), np.array([-1.0, 0.5])
    impulse = np.linalg.solve(responses, np.array([1.0, 0.0]) - before)
    assert 0.0 < impulse[1] < 0.5 * impulse[0]  # inside the cone
    gained = 0.5 * impulse @ (np.array([1.0, 0.0]) + before)
    assert gained > 0.25
    system = MechanicalSystem(
        np.linalg.inv(responses),
        nothing,
        nothing,
        [[1.0, 0.0]],
        restitution=1.0,
        tangents=[[0.0, 1.0]],
        friction=[0.5],
    )
    run = system.simulate([0.0, 0.0], before, (0.0, 0.1), method=steps("moreau", 0.01))
    energy = system.energy([0.0, 0.0], before)
    assert run.bounded_steps == 1
    assert system.energy(run.x[-1, :2], run.x[-1, 2:]) == pytest.approx(energy, rel=1e-12)
    assert 0.3 < run.x[-1, 2] < 1.0
    assert abs(run.friction_force[1, 0]) <= 0.5 * run.u[1, 0]


@pytest.mark.parametrize("in_space", [False, True])
def test_coulombs_law_holds_at_every_contact_in_every_step(in_space):
    """The force is at most mu u, and all of it, against the slip, where there is slip."""
    for seed in range(40, 70):
        system, q, v, _ = random_system(seed, in_space)
        scheme = SCHEMES[int(system.restitution == 0.0)]
        run = system.simulate(q, v, (0.0, 0.5), method=steps(scheme, 0.02))
        if run.bounded_steps:
            continue
        force, slip, bound = run.friction_force[1:], run.slip[1:], system.friction * run.u[1:]
        size = 1e-7 * (1.0 + bound.max())
        if in_space:
            assert force.min() >= 0.0
            total = force.sum(axis=2)
            speed = (-slip).max(axis=2)  # along the direction that opposes it best
            power = (force * slip).sum(axis=2)
        else:
            total, speed, power = np.abs(force), np.abs(slip), force * slip
        assert (total - bound).max() <= size
        touching = run.u[1:] > size
        assert np.abs((power + bound * speed)[touching]).max(initial=0.0) <= size * (1.0 + np.abs(slip).max())


def test_without_friction_both_are_what_they_were():
    smooth = ball(0.0, 0.6)
    bare = MechanicalSystem(
        smooth.mass, smooth.damping, smooth.stiffness, smooth.F, [0.0, -G, 0.0], restitution=0.6
    )
    runs = [
        system.simulate([0.0, 1.0, 0.0], [1.0, 0.0, 2.0], (0.0, 2.0), method=steps("moreau", 0.01))
        for system in (smooth, bare)
    ]
    assert runs[0].x == pytest.approx(runs[1].x, abs=1e-13)
    assert (runs[1].friction_force.shape, runs[0].friction_force.shape) == ((201, 0), (201, 1))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"friction": None}, "friction is missing: tangents needs it"),
        ({"tangents": None}, "tangents is missing: friction needs it"),
        ({"friction": [-0.1]}, "friction = .-0.1.: must be coefficients >= 0"),
        ({"friction": [0.1, 0.2]}, "friction = 'shape .2,.': must be a vector of length 1"),
        ({"tangents": [[1.0]]}, r"tangents = shape \(1, 1\): must be of shape \(1, 2\) in the plane, or"),
        (
            {"tangents": [[[1.0, 0.0]]]},
            r"tangents\[0\] = .*: must be two or more directions of which a positive",
        ),
        ({"tangents": [[[1.0, 0.0], [2.0, 0.0]]]}, r"tangents\[0\] = .*: must be two or more directions"),
        ({"tangents": [["a", 0.0]]}, "tangents = .*: must be real numbers"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(change, sentence):
    given = {"tangents": [[1.0, 0.0]], "friction": [0.5], **change}
    with pytest.raises(InvalidInputError, match=sentence):
        MechanicalSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), [[0.0, 1.0]], **given)


@pytest.mark.parametrize(
    ("method", "sentence"),
    [
        ("event-driven", 'method = .event-driven.: must be "time-stepping" or a TimeStepping'),
        (EventDriven(), 'method = .event-driven.: must be "time-stepping" or a TimeStepping'),
        (
            TimeStepping("implicit-euler"),
            'scheme = \'implicit-euler\': must be "moreau" or "stewart-trinkle"',
        ),
        (TimeStepping("moreau", multipliers="least-norm"), "multipliers = 'least-norm': must be \"any\""),
    ],
)
def test_a_method_that_knows_no_friction_is_refused(method, sentence):
    with pytest.raises(InvalidInputError, match=sentence):
        block(0.5).simulate([0.0, 0.0], [1.0, 0.0], (0.0, 1.0), method=method)


def test_stewart_and_trinkle_know_no_rebound_and_friction_is_no_lcs():
    with pytest.raises(InvalidInputError, match="scheme = 'stewart-trinkle': must be \"moreau\""):
        ball(0.1, 0.5).simulate([0.0] * 3, [0.0] * 3, (0.0, 1.0), method=steps("stewart-trinkle", 0.1))
    with pytest.raises(
        InvalidInputError, match=r"friction = .* must be left out for a linear complementarity"
    ):
        block(0.5).to_lcs()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (([], [], [], []), "mass = .*: must be one or more numbers > 0"),
        (([1.0], [0.0], [1.0], [0.1]), "width = .*: must be one or more numbers > 0"),
        (([1.0], [1.0], [1.0, 1.0], [0.1]), "height = 'shape .2,.': must be a vector of length 1"),
        (([1.0], [1.0], [1.0], [-0.1]), "friction = .*: must be coefficients >= 0"),
    ],
)
def test_boxes_have_sizes(arguments, sentence):
    with pytest.raises(InvalidInputError, match=sentence):
        box_stack(*arguments)
    with pytest.raises(InvalidInputError, match=r"slope = 2\.0: must be between"):
        box_stack([1.0], [1.0], [1.0], [0.5], slope=2.0)
    with pytest.raises(InvalidInputError, match="m = 2: must be a whole number from 3 to 360"):
        friction_directions([1, 0], [0, 1], 2)
    assert friction_directions([Fraction(1), 0], [0, 1], 3).shape == (3, 2)
