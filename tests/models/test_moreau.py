"""Moreau's time stepping of mechanical systems: against closed forms, event-driven runs and the laws of impact."""

from itertools import product

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, PiecewiseConstant, TimeStepping, simulate
from pricing_core.models import MechanicalSystem
from tests.problems.nightly import nightly, nightly_rows

GRAVITY = 9.81


def moreau(step=None, **choices):
    return TimeStepping("moreau", step=step, **choices)


def bounced(height, restitution, t):
    """Return the height at time t of a ball dropped from `height`, flight by flight."""
    speed, landed = np.sqrt(2.0 * GRAVITY * height), np.sqrt(2.0 * height / GRAVITY)
    if t <= landed:
        return height - 0.5 * GRAVITY * t**2
    while True:
        speed *= restitution
        flight = 2.0 * speed / GRAVITY
        if t <= landed + flight or flight < 1e-12:
            return max(speed * (t - landed) - 0.5 * GRAVITY * (t - landed) ** 2, 0.0)
        landed += flight


def ball(restitution):
    return MechanicalSystem([[1.0]], [[0.0]], [[0.0]], [[1.0]], force=[-GRAVITY], restitution=restitution)


QUICK_COLUMNS = [(1, 0.6), (2, 0.3), (5, 0.0)]  # beads and their restitution


def column(beads, restitution):
    """Return beads of mass 1 above each other; the lowest one may touch the floor."""
    gaps, nothing = np.eye(beads) - np.eye(beads, k=-1), np.zeros((beads, beads))
    weight = np.full(beads, -GRAVITY)
    return MechanicalSystem(np.eye(beads), nothing, nothing, gaps, weight, restitution=restitution)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5, 0.8, 0.95, 1.0])
def test_a_ball_bounces_as_the_closed_form_says(restitution):
    times = [0.2, 0.6, 1.1, 1.9]
    wanted = [bounced(1.0, restitution, t) for t in times]
    for step in (1e-2, 1e-3):
        found = ball(restitution).simulate([1.0], [0.0], (0.0, 1.9), method=moreau(step), t_eval=times)
        np.testing.assert_allclose(found.x[:, 0], wanted, atol=6.0 * step)
    found = ball(restitution).simulate([1.0], [0.0], (0.0, 1.9), method=moreau(tolerance=1e-7), t_eval=times)
    np.testing.assert_allclose(found.x[:, 0], wanted, atol=2e-6)


@pytest.mark.parametrize(
    ("beads", "restitution"),
    [
        *QUICK_COLUMNS,
        *nightly_rows(
            pair for pair in product((1, 2, 5, 12, 30), (0.0, 0.3, 0.6)) if pair not in QUICK_COLUMNS
        ),
    ],
)
def test_a_column_of_beads_comes_to_rest_on_the_floor(beads, restitution):
    heights = 0.1 * np.arange(1, beads + 1)
    system = column(beads, restitution)
    found = system.simulate(heights, np.zeros(beads), (0.0, 6.0), method=moreau(5e-3), t_eval=[3.0, 6.0])
    assert found.y.min() >= 0.0
    np.testing.assert_allclose(found.x[-1], 0.0, atol=2e-3)
    # Each contact carries the beads above it.
    carried = GRAVITY * np.arange(beads, 0, -1)
    np.testing.assert_allclose(found.u[-1], carried, rtol=1e-6)


def random_system(rng):
    """Return a spring-mass system with a symmetric positive definite stiffness, and a state that it may start from."""
    n, k = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    root, stiff, F = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((k, n))
    mass = root @ root.T + np.eye(n)
    stiffness = 5.0 * (stiff @ stiff.T)
    q, offset = rng.standard_normal(n), rng.uniform(0.05, 1.0, k)
    offset = np.maximum(offset, offset - F @ q)
    restitution = float(rng.choice([0.0, 0.3, 0.7, 1.0]))
    system = MechanicalSystem(mass, 0.0 * mass, stiffness, F, offset=offset, restitution=restitution)
    return system, q, rng.standard_normal(n)


@pytest.mark.parametrize("seed", [*range(8), *nightly(range(8, 40))])
def test_energy_does_not_grow_but_by_what_vanishes_with_the_step(seed):
    system, q, v = random_system(np.random.default_rng(seed))
    n = q.size
    start, gained = system.energy(q, v), []
    for step in (4e-3, 1e-3):
        found = system.simulate(q, v, (0.0, 2.0), method=moreau(step))
        assert found.y.min() >= 0.0
        assert found.u.min() >= 0.0
        gained.append(max(system.energy(x[:n], x[n:]) for x in found.x) - start)
    assert gained[0] <= 0.05 * start
    assert gained[1] <= max(0.6 * gained[0], 1e-4 * start)


@pytest.mark.parametrize("seed", range(20))
def test_without_contact_it_is_of_second_order_and_with_one_impact_of_first(seed):
    rng = np.random.default_rng(seed)
    stiffness, speed = float(rng.uniform(2.0, 30.0)), float(rng.uniform(0.5, 2.0))
    restitution, rate = float(rng.uniform(0.0, 1.0)), np.sqrt(stiffness)
    spring = MechanicalSystem([[1.0]], [[0.0]], [[stiffness]], [[1.0]], offset=[0.0], restitution=restitution)
    end = 1.5 * np.pi / rate  # in the middle of the second flight, after the impact at pi/rate
    errors = []
    for steps in (200, 800):
        found = spring.simulate([0.0], [speed], (0.0, end), method=moreau(end / steps))
        errors.append(abs(found.x[-1, 0] - restitution * speed / rate))
        before = found.t <= 0.99 * np.pi / rate
        off = np.abs(found.x[before, 0] - speed / rate * np.sin(rate * found.t[before])).max()
        assert off <= 15.0 * speed / rate / steps**2
    assert errors[0] <= 0.05 * speed / rate
    assert errors[1] <= 0.0125 * speed / rate


def test_time_stepping_by_name_takes_restitution_too():
    found = ball(0.5).simulate([1.0], [0.0], (0.0, 1.0), method="time-stepping")
    assert found.scheme == "moreau"
    assert found.x[-1, 0] == pytest.approx(bounced(1.0, 0.5, 1.0), abs=1e-4)
    assert ball(0.0).simulate([1.0], [0.0], (0.0, 1.0), method="time-stepping").scheme == "implicit-euler"


def test_a_force_that_jumps_and_an_interrupt():
    force = PiecewiseConstant([0.5, 1.0], [[-1.0], [3.0]])
    lifted = MechanicalSystem([[1.0]], [[0.0]], [[0.0]], [[1.0]], force=force)
    found = lifted.simulate([0.0], [0.0], (0.0, 1.0), method=moreau(0.0625))
    assert found.x[-1] == pytest.approx([3.0 * 0.5**2 / 2.0, 1.5])
    assert 0.5 in found.t
    stopped = lifted.simulate([0.0], [0.0], (0.0, 1.0), method=moreau(0.1), interrupt=lambda: True)
    assert stopped.status == "interrupted"


def test_what_does_not_fit_is_refused():
    with pytest.raises(InvalidInputError, match="scheme = 'moreau': must be another one"):
        simulate(LCS([[0.0]], [[1.0]], [[1.0]]), [1.0], (0.0, 1.0), method=moreau(0.1))
    with pytest.raises(InvalidInputError, match='"moreau" where the restitution is > 0'):
        ball(0.5).simulate([1.0], [0.0], (0.0, 1.0), method=TimeStepping("implicit-euler"))
    with pytest.raises(InvalidInputError, match="theta"):
        TimeStepping("sdirk2", theta=0.7)
