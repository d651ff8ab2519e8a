import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError
from pricing_core.models.convex_set import Polyhedron, SmoothSet, active_set, check_inside
from pricing_core.models.nearest_point import nearest_direction, nearest_point
from pricing_core.models.tangent_cone import project_velocity, steepest_normal

seeds = st.integers(0, 100_000)


def random_polyhedron(rng: np.random.Generator) -> Polyhedron:
    """A polyhedron around the origin, or touching it."""
    n, k = int(rng.integers(1, 5)), int(rng.integers(1, 6))
    return Polyhedron(rng.normal(size=(k, n)), -np.maximum(rng.normal(size=k), 0.0))


@settings(max_examples=80, deadline=None)
@given(seeds)
def test_the_projection_is_the_nearest_point(seed):
    """<x - P(x), z - P(x)> <= 0 for all z in K."""
    rng = np.random.default_rng(seed)
    K = random_polyhedron(rng)
    x = 3.0 * rng.normal(size=K.H.shape[1])
    nearest = K.project(x)
    assert K.slack(nearest).min() >= -1e-10
    for _ in range(20):
        z = K.project(3.0 * rng.normal(size=x.size))
        assert (x - nearest) @ (z - nearest) <= 1e-9


@settings(max_examples=80, deadline=None)
@given(seeds)
def test_the_projected_velocity_has_its_three_descriptions(seed):
    """The limit (11.38), taken from the right, the steepest normal (11.41)-(11.42), and the problem (11.43)."""
    rng = np.random.default_rng(seed)
    K = random_polyhedron(rng)
    x = K.project(3.0 * rng.normal(size=K.H.shape[1]))
    v0 = rng.normal(size=x.size)
    H = K.H[active_set(K, x)]
    v, u = project_velocity(H, v0)
    delta = 1e-4 * min(1.0, *K.slack(x)[K.slack(x) > 1e-6], 1.0)
    assert (K.project(x + delta * v0) - x) / delta == pytest.approx(v, abs=1e-8)
    assert min(u.min(initial=0.0), (H @ v).min(initial=0.0)) >= -1e-10
    assert u @ (H @ v) == pytest.approx(0.0, abs=1e-9)
    gamma = steepest_normal(H, v0)
    pushed = v0 if gamma is None else v0 + max(0.0, -v0 @ gamma) * gamma
    assert pushed == pytest.approx(v, abs=1e-9)
    for row in H:  # no inward normal is steeper
        assert -v0 @ row / np.linalg.norm(row) <= (0.0 if gamma is None else -v0 @ gamma) + 1e-9


@pytest.mark.parametrize("x", [[3.0, 0.1], [0.5, 4.0], [-2.0, -3.0], [20.0, 30.0], [0.3, 0.2]])
def test_an_ellipse_is_projected_on_along_its_normal(x):
    K = SmoothSet(lambda z: [1 - (z[0] / 2) ** 2 - z[1] ** 2], lambda z: [[-z[0] / 2, -2 * z[1]]])
    nearest = K.project(np.array(x))
    off, normal = np.array(x) - nearest, K.gradients(nearest)[0]
    assert K.slack(nearest)[0] >= -1e-12
    assert abs(off[0] * normal[1] - off[1] * normal[0]) < 1e-9 * np.linalg.norm(x)


def test_corners_of_smooth_sets_are_found():
    lens = SmoothSet(lambda z: [4 - (z[0] - 1) ** 2 - z[1] ** 2, 4 - (z[0] + 1) ** 2 - z[1] ** 2])
    assert lens.project(np.array([0.1, 5.0])) == pytest.approx([0.0, np.sqrt(3.0)], abs=1e-9)
    assert len(active_set(lens, np.array([0.0, np.sqrt(3.0)]))) == 2


def test_an_empty_polyhedron_is_refused_with_the_rows_that_prove_it():
    with pytest.raises(InfeasibleError, match=r"1 x row 0, 1 x row 1 says 0 >= 1"):
        Polyhedron([[1, 0], [-1, 0], [0, 1]], [1, 0, 0])


def test_an_empty_smooth_set_is_noticed():
    K = SmoothSet(lambda z: [-1 - z @ z])
    with pytest.raises(NumericalError):
        K.project(np.array([1.0, 2.0]))


def test_the_violated_constraint_is_named():
    with pytest.raises(InvalidInputError, match=r"x0 = \[ 1. -1.\].*constraint 1 is -1 < 0"):
        check_inside("x0", Polyhedron(np.eye(2), np.zeros(2)), np.array([1.0, -1.0]))


@pytest.mark.parametrize("seed", range(25))
def test_ellipsoids_without_gradients_are_projected_on_as_closely_as_with_them(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    M, c = rng.normal(size=(n, n)), rng.normal(size=n) * rng.choice([0.0, 1.0, 5.0])
    P, x = M @ M.T + 0.1 * np.eye(n), c + rng.normal(size=n) * rng.choice([1.0, 5.0, 50.0])
    h = lambda z: [1 - (z - c) @ P @ (z - c)]  # noqa: E731
    nearest, known = SmoothSet(h).project(x), SmoothSet(h, lambda z: [-2 * P @ (z - c)]).project(x)
    assert nearest == pytest.approx(known, abs=1e-7)
    assert SmoothSet(h).slack(nearest)[0] >= -1e-9


@pytest.mark.parametrize("seed", range(60))
def test_nearest_points_at_every_scale_satisfy_their_conditions(seed):
    """Redundant, dependent and opposite constraints, a single point among them: H z >= h, u >= 0, u (H z - h) = 0."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 6)), int(rng.integers(1, 15))
    H, z0 = rng.integers(-3, 4, (k, n)).astype(float), rng.integers(-3, 4, n).astype(float)
    h = H @ z0 - rng.integers(0, 2, k)
    if seed % 3 == 0:
        H, h = np.vstack([H, np.eye(n), -np.eye(n)]), np.concatenate([h, z0, -z0])
    units = 10.0 ** rng.integers(-6, 7, len(H))
    far = 10.0 ** rng.integers(0, 7)
    x = far * rng.normal(size=n)
    z, u = nearest_point(H * units[:, None], h * units, x)
    assert (H @ z - h).min(initial=0.0) >= -1e-11 * far
    assert u.min(initial=0.0) >= 0.0
    assert z - x == pytest.approx(H.T @ (units * u), abs=1e-9 * far)
    assert (units * u) @ (H @ z - h) == pytest.approx(0.0, abs=1e-8 * far**2)
    v, u = nearest_direction(H * units[:, None], x)
    assert (H @ v).min(initial=0.0) >= -1e-11 * far
    assert v @ (v - x) == pytest.approx(0.0, abs=1e-10 * far**2)
