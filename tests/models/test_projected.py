import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InfeasibleError, InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcs import EventDriven, TimeStepping, simulate
from pricing_core.models import ProjectedSystem
from pricing_core.models.nearest_point import nearest_point
from tests.problems.nightly import nightly


def steady(x):
    return pytest.approx(x, abs=1e-10)


def quadrant() -> ProjectedSystem:
    """F(x) = x - (-1, -2) on x >= 0."""
    return ProjectedSystem((np.eye(2), [1.0, 2.0]), np.eye(2), np.zeros(2))


def disc() -> ProjectedSystem:
    """Pushed to the right in the unit disc, without gradients."""
    return ProjectedSystem(lambda x: [-1.0, 0.0], constraints=lambda x: [1 - x @ x])


def cournot() -> ProjectedSystem:
    """Three firms, unit costs 10, 20, 60, capacities 30, 50, 50, price 100 - Q; F_i = -d profit_i / d q_i."""
    H = np.vstack([np.eye(3), -np.eye(3)])
    return ProjectedSystem((np.eye(3) + 1.0, [-90.0, -80.0, -40.0]), H, [0, 0, 0, -30, -50, -50])


def profit(i: int, q: np.ndarray) -> float:
    return (100.0 - q.sum() - (10.0, 20.0, 60.0)[i]) * q[i]


def random_monotone(seed: int) -> tuple[ProjectedSystem, np.ndarray]:
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    N = rng.normal(size=(n, n))
    matrix = N @ N.T + 0.3 * np.eye(n) + (N - N.T)
    system = ProjectedSystem(
        (matrix, 2.0 * rng.normal(size=n)), rng.normal(size=(k, n)), -np.abs(rng.normal(size=k))
    )
    return system, system.projection(2.0 * rng.normal(size=n))


def test_the_quadrant_is_reached_at_its_exact_times():
    run = quadrant().simulate([1.0, 1.0], (0.0, 2.0), t_eval=[0.2, 0.5, 2.0])
    assert [event.time for event in run.events] == pytest.approx([math.log(1.5), math.log(2.0)], rel=1e-13)
    assert [switch.after for switch in run.switches] == [(0, 1), (1, 1)]
    assert run.x == steady(
        np.array([[2 * math.exp(-0.2) - 1, 3 * math.exp(-0.2) - 2], [2 * math.exp(-0.5) - 1, 0], [0, 0]])
    )
    assert run.u == steady(np.array([[0, 0], [0, 2], [1, 2]]))


def test_the_equilibrium_of_the_quadrant_is_where_the_motion_ends():
    found = quadrant().equilibrium()
    assert found.x == steady([0.0, 0.0])
    assert found.u == steady([1.0, 2.0])
    assert quadrant().velocity(found.x).v == steady([0.0, 0.0])


def test_an_oligopoly_settles_in_its_nash_equilibrium():
    """The first firm at its capacity, the third out of the market: (30, 25, 0) at the price 45."""
    system = cournot()
    found = system.equilibrium()
    assert found.x == steady([30.0, 25.0, 0.0])
    assert found.u == steady([0.0, 0.0, 15.0, 5.0, 0.0, 0.0])
    run = system.simulate([10.0, 10.0, 10.0], (0.0, 30.0))
    assert run.x[-1] == pytest.approx([30.0, 25.0, 0.0], abs=1e-9)
    for i, capacity in enumerate((30.0, 50.0, 50.0)):
        for quantity in np.linspace(0.0, capacity, 101):
            other = np.where(np.arange(3) == i, quantity, found.x)
            assert profit(i, other) <= profit(i, found.x) + 1e-9


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 100_000))
def test_stationary_points_are_the_solutions_of_the_variational_inequality(seed):
    system, x0 = random_monotone(seed)
    found = system.equilibrium()
    matrix, vector = system.affine
    F = matrix @ found.x + vector
    assert system.K.H.T @ found.u == pytest.approx(F, abs=1e-8)
    assert system.velocity(found.x).v == pytest.approx(np.zeros(F.size), abs=1e-7)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        assert F @ (system.projection(3.0 * rng.normal(size=F.size)) - found.x) >= -1e-8
    assert system.simulate(x0, (0.0, 60.0)).x[-1] == pytest.approx(found.x, abs=1e-6)
    newton = ProjectedSystem(lambda x: matrix @ x + vector, system.K.H, system.K.h).equilibrium(x0)
    assert newton.x == pytest.approx(found.x, abs=1e-8)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 100_000))
def test_projected_dynamics_are_the_complementarity_system(seed):
    """(11.39), stepped through projections, and (11.44), driven by events, have the same states and multipliers."""
    system, x0 = random_monotone(seed)
    times = np.linspace(0.0, 2.0, 9)
    lcs = system.simulate(x0, (0.0, 2.0), t_eval=times)
    stepped = system.simulate(x0, (0.0, 2.0), t_eval=times, method=TimeStepping(tolerance=1e-4))
    assert stepped.x == pytest.approx(lcs.x, abs=2e-3)
    for x, u in zip(lcs.x, lcs.u, strict=True):
        direction, multipliers = system.velocity(x)
        assert direction == pytest.approx(-system.F(x) + system.K.H.T @ u, abs=1e-6)
        assert system.K.H.T @ multipliers == pytest.approx(system.K.H.T @ u, abs=1e-6)
    backward = simulate(system.to_lcs(), x0, (0.0, 2.0), method=TimeStepping(step=1e-2), t_eval=times)
    assert backward.x == pytest.approx(lcs.x, abs=0.1)


def test_a_constraint_may_be_left_again():
    """A rotation x' = (x2, -x1) presses against x1 <= 1 while x2 > 0: along it to (1, 0), then on the unit circle."""
    system = ProjectedSystem(([[0, -1], [1, 0]], [0, 0]), [[-1, 0]], [-1])
    run = system.simulate([0.0, 2.0], (0.0, math.pi), t_eval=[math.pi])
    assert [event.time for event in run.events] == pytest.approx(
        [math.pi / 6, math.pi / 6 + math.sqrt(3.0)], rel=1e-12
    )
    left = math.pi - math.pi / 6 - math.sqrt(3.0)
    assert run.x[-1] == steady([math.cos(left), -math.sin(left)])


def test_more_constraints_than_dimensions_may_meet_in_a_corner():
    system = ProjectedSystem((np.eye(2), [1, 1]), [[1, 0], [0, 1], [1, 1], [2, 1]], [0, 0, 0, 0])
    run = system.simulate([1.0, 1.0], (0.0, 2.0))
    assert run.x[-1] == steady([0.0, 0.0])
    assert run.events[0].time == pytest.approx(math.log(2.0), rel=1e-12)
    assert system.equilibrium().x == steady([0.0, 0.0])


@pytest.mark.parametrize(
    ("rtol", "error"), [(1e-4, 1e-3), (1e-6, 2e-5), pytest.param(1e-8, 1e-6, marks=pytest.mark.nightly)]
)
def test_a_smooth_boundary_is_slid_along(rtol, error):
    """Straight to the circle, and on it theta' = -sin theta: tan(theta/2) = tan(theta0/2) e^{-t}."""
    theta = math.pi - 2.5
    method = TimeStepping(tolerance=rtol, absolute_tolerance=rtol / 100)
    run = disc().simulate([math.cos(2.5), math.sin(2.5)], (0.0, 3.0), method=method)
    left = 3.0 - 2.0 * math.cos(theta)
    end = 2 * math.atan(math.tan(theta / 2) * math.exp(-left))
    assert run.x[-1] == pytest.approx([math.cos(end), math.sin(end)], abs=error)
    assert run.switches[-1].after == (1,)
    assert run.y.min() > -1e-9


def test_general_motions_have_their_equilibria():
    """Newton on the disc, whose curvature matters, and where F is not affine."""
    far = ProjectedSystem(lambda x: x - np.array([3.0, 4.0]), constraints=lambda x: [1 - x @ x])
    found = far.equilibrium([0.0, 0.0])
    assert found.x == pytest.approx([0.6, 0.8], abs=1e-9)
    assert found.u == pytest.approx([2.0], abs=1e-8)  # F = x - (3, 4) = -4 x = H^T u with H = -2 x^T
    cubic = ProjectedSystem(lambda x: x**3 - [8.0, -1.0], np.eye(2), np.zeros(2)).equilibrium([5.0, 5.0])
    assert cubic.x == pytest.approx([2.0, 0.0], abs=1e-9)


def test_a_game_without_equilibrium_is_reported():
    with pytest.raises(NumericalError):
        ProjectedSystem((np.zeros((1, 1)), [-1.0]), [[1.0]], [0.0]).equilibrium()
    with pytest.raises(IterationLimitError, match="try another start"):
        ProjectedSystem(lambda x: -1.0 - np.exp(-x), [[1.0]], [0.0]).equilibrium([0.0])


def test_normals_and_projections_of_a_corner():
    assert quadrant().inward_normals([0.0, 0.0]).tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert quadrant().inward_normals([1.0, 1.0]).shape == (0, 2)
    assert quadrant().projection([-1.0, 2.0]).tolist() == [0.0, 2.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: quadrant().simulate([1.0, -0.5], (0, 1)), r"x0 = .*constraint 1 is -0.5 < 0"),
        (lambda: disc().simulate([1.0, 1.0], (0, 1)), r"x0 = .*constraint 0 is -1 < 0"),
        (lambda: disc().to_lcs(), r"F = .*\(matrix, vector\)"),
        (lambda: disc().equilibrium(), "start"),
        (lambda: quadrant().simulate([1.0, 1.0], (0, 1), method="euler"), "method = 'euler'"),
        (lambda: disc().simulate([0.0, 0.0], (0, 1), t_eval=[2.0]), "t_eval"),
        (lambda: ProjectedSystem((np.eye(2), [0, 0])), "H = None"),
        (lambda: ProjectedSystem((np.eye(2), [0, 0]), np.eye(2)), "together with h"),
        (lambda: ProjectedSystem((np.eye(2), [0, 0]), np.eye(3), np.zeros(3)), "H = .*3 columns"),
        (lambda: ProjectedSystem(np.eye(2), np.eye(2), np.zeros(2)), r"(?s)F = .*pair"),
        (lambda: disc().simulate([0.0, 0.0], (0, 1), method="event-driven"), "F = "),
        *(
            (
                lambda method=method: disc().simulate([0.0, 0.0], (0, 1), method=method),
                f"{field} = .*left out",
            )
            for field, method in (
                ("scheme", TimeStepping("implicit-euler")),
                ("lcp_method", TimeStepping(lcp_method="psor")),
                ("multipliers", TimeStepping(multipliers="least-norm")),
                ("on_nonunique", EventDriven("first")),
                ("rebound", EventDriven(rebound=lambda before, after, contacts: (after, []))),
            )
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call()


def test_an_empty_polyhedron_is_refused():
    with pytest.raises(InfeasibleError, match=r"row 0.*row 1"):
        ProjectedSystem((np.eye(1), [0]), [[1], [-1]], [1, 0])


@pytest.mark.parametrize("method", [EventDriven(), TimeStepping(tolerance=1e-2)])
def test_a_motion_without_bound_overflows_at_a_time(method):
    """x' = 4 x from 1: 1e140 at t = 80.6, with loose steps somewhat later."""
    system = ProjectedSystem((-4.0 * np.eye(1), [0.0]), np.eye(1), [0.0])
    with pytest.raises(NumericalError, match=r"the state overflows at t = (79|8[0-2])[.:]"):
        system.simulate([1.0], (0.0, 200.0), method=method)


def test_functions_without_a_value_on_the_way_are_named():
    start = [0.1, 0.1]
    with pytest.raises(NumericalError, match=r"F\(x\) has no finite value"):
        ProjectedSystem(lambda x: [np.nan, 0.0], constraints=lambda x: [1 - x @ x]).velocity(start)
    with pytest.raises(NumericalError, match=r"constraints\(x\) has no finite value"):
        ProjectedSystem(lambda x: x, constraints=lambda x: [np.inf]).velocity(start)
    with pytest.raises(NumericalError, match=r"constraint_gradients\(x\) has no finite value"):
        ProjectedSystem(
            lambda x: x, constraints=lambda x: [1 - x @ x], constraint_gradients=lambda x: [[np.nan, 0.0]]
        ).projection([2.0, 2.0])


def test_a_constant_step_is_as_long_as_told():
    """Along x2 = 0 towards (1, 0) with x1' = 1 - x1: Heun's error falls with the square of the step."""
    slide = ProjectedSystem((np.eye(2), [-1.0, 1.0]), np.eye(2), [0.0, 0.0])
    errors = []
    for count in (10, 20, 40):
        run = slide.simulate([0.0, 0.0], (0.0, 1.0), method=TimeStepping(step=1.0 / count))
        assert run.t == pytest.approx(np.linspace(0.0, 1.0, count + 1), abs=1e-12)
        errors.append(abs(run.x[-1, 0] - (1.0 - math.exp(-1.0))))
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(2.0, abs=0.1)


def test_automatic_is_by_steps_where_no_flow_is_exact():
    automatic, stepped = (
        disc().simulate([0.0, 0.0], (0.0, 3.0), method=method) for method in ("auto", "time-stepping")
    )
    assert np.array_equal(automatic.x, stepped.x)
    assert automatic.lcs.scheme == "projected-heun"


@pytest.mark.parametrize("T", [0.5, 1.0, 3.0])
def test_steps_pass_a_corner_and_rest_there(T):
    """From (0, 1) the corner (0, 0) is met at ln 2, and the motion rests there."""
    system = ProjectedSystem((np.eye(2), [1, 2]), [[1, 1], [0, 1]], [0, 0])
    exact = system.simulate([0, 1.0], (0.0, T)).x[-1]
    run = system.simulate([0, 1.0], (0.0, T), method=TimeStepping(tolerance=1e-4))
    assert run.x[-1] == pytest.approx(exact, abs=3e-3)
    assert run.lcs.accepted + run.lcs.rejected < 1000


@pytest.mark.parametrize("seed", [*range(6), *nightly(range(6, 12))])
def test_the_error_at_the_end_is_within_30_tolerances(seed):
    """Against the exact flow from event to event, on random polyhedra."""
    rng = np.random.default_rng(seed)
    system, x0 = random_monotone(seed)
    tolerance = 10.0 ** -int(rng.integers(3, 7))
    times = np.linspace(0.0, 3.0, 7)
    exact = system.simulate(x0, (0.0, 3.0), t_eval=times)
    method = TimeStepping(tolerance=tolerance, absolute_tolerance=tolerance)
    run = system.simulate(x0, (0.0, 3.0), t_eval=times, method=method)
    assert np.abs(run.x - exact.x).max() <= 30.0 * tolerance * (1.0 + np.abs(exact.x).max())


@pytest.mark.parametrize("seed", [0, 1, 2, *nightly([3, 4, 5])])
def test_corners_of_ellipsoids_are_passed(seed):
    """Two ellipsoids and a plane through the interior of both, against closer steps."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    shapes = [M @ M.T + 0.2 * np.eye(n) for M in rng.normal(size=(2, n, n))]
    centres = 0.2 * rng.normal(size=(2, n))
    N, v = rng.normal(size=(n, n)), 3.0 * rng.normal(size=n)
    system = ProjectedSystem(
        lambda x: N @ N.T @ x + v,
        constraints=lambda x: [1 - (x - c) @ P @ (x - c) for P, c in zip(shapes, centres, strict=True)],
        constraint_gradients=lambda x: [-2 * P @ (x - c) for P, c in zip(shapes, centres, strict=True)],
    )
    x0 = system.projection(centres.mean(axis=0))
    ends = [
        system.simulate(x0, (0.0, 2.0), method=TimeStepping(tolerance=t, absolute_tolerance=t)).x[-1]
        for t in (1e-3, 1e-5)
    ]
    assert ends[0] == pytest.approx(ends[1], abs=3e-2)
    assert system.K.slack(ends[1]).min() > -1e-9


@pytest.mark.parametrize("seed", range(40))
def test_equilibria_are_checked_on_the_data(seed):
    """Monotone F on polyhedra of every size, K a single point among them: the answer satisfies (11.36)."""
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(1, 5)), 10.0 ** rng.integers(-6, 7)
    N = rng.normal(size=(n, n))
    matrix, vector = N @ N.T + 0.1 * np.eye(n) + N - N.T, size * rng.normal(size=n)
    H = np.round(rng.normal(size=(int(rng.integers(1, 6)), n)))
    point = size * rng.integers(-2, 3, n)
    h = H @ point - size * np.abs(rng.normal(size=len(H)))
    if seed % 2:
        H, h = np.vstack([np.eye(n), -np.eye(n), H]), np.concatenate([point, -point, h])
    found = ProjectedSystem((matrix, vector), H, h).equilibrium()
    if seed % 2:
        assert found.x == pytest.approx(point, abs=1e-9 * size)
    F = matrix @ found.x + vector
    assert (H @ found.x >= h - 1e-8 * size).all()
    for _ in range(10):
        z = nearest_point(H, h, point + 3.0 * size * rng.normal(size=n)).point
        assert F @ (z - found.x) >= -1e-6 * size**2


@pytest.mark.parametrize("seed", range(60))
def test_no_equilibrium_is_far_beyond_the_data(seed):
    """Rotations on random polyhedra: an answer of moderate size that satisfies (11.36), or none."""
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(2, 2))
    system = ProjectedSystem(
        (N - N.T, 3 * rng.normal(size=2)), rng.normal(size=(2, 2)), -np.abs(rng.normal(size=2))
    )
    try:
        found = system.equilibrium()
    except NumericalError:
        return
    assert np.abs(found.x).max() < 1e8
    assert found.residual < 1e-6


def test_known_equilibria_and_their_absence():
    rotation = ProjectedSystem(
        ([[0, -0.46], [0.46, 0]], [2.0, -3.0]), [[-0.54, 1.75], [-1.05, -0.91]], [-0.44, -0.51]
    )
    with pytest.raises(NumericalError):
        rotation.equilibrium()
    point = ProjectedSystem(([[-1.0982186136401193]], [-2.0]), [[0.0], [1.0], [0.0], [-1.0]], [0.0] * 4)
    assert point.equilibrium().x.tolist() == [0.0]
    nowhere = ProjectedSystem((np.zeros((1, 1)), [-1.0]), [[1.0]], [0.0])
    with pytest.raises(InfeasibleError, match="proved for the numbers as given"):
        nowhere.equilibrium()


@pytest.mark.parametrize("method", ["event-driven", "time-stepping", TimeStepping(tolerance=1e-6)])
@pytest.mark.parametrize("seed", range(30))
def test_a_set_of_a_single_point_holds_the_state_there(seed, method):
    """Boxes of no width, simplices and up to ten half-spaces through one point, at every scale."""
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(1, 6)), 10.0 ** rng.integers(-6, 7)
    point = size * rng.integers(-3, 4, n)
    if seed % 3 == 0:
        H = np.vstack([np.eye(n), -np.eye(n)])
    elif seed % 3 == 1:
        G = np.triu(rng.integers(-3, 4, (n, n)), 1) + np.diag(rng.integers(1, 4, n))
        H = np.vstack([G, -G.sum(axis=0)])
    else:
        G = rng.normal(size=(2 * n, n))
        H = np.vstack([G, -(rng.uniform(0.1, 1.0, 2 * n) @ G)])
    system = ProjectedSystem((rng.normal(size=(n, n)), size * rng.normal(size=n)), H, H @ point)
    run = system.simulate(point, (0.0, 1.0), method=method)
    assert run(1.0) == pytest.approx(point, abs=1e-9 * size)
    assert run.u.min() >= 0.0
    assert H.T @ run.u[-1] == pytest.approx(system.F(point), abs=1e-7 * size)
