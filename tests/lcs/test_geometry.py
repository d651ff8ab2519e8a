import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, mode_geometry, singular_modes
from pricing_core.lcs.modes import all_modes
from tests.problems.lcs_systems import bridge, coupled_integrators, integrators, random_system, two_carts


def same_space(basis, columns):
    columns = np.array(columns, dtype=float).T.reshape(basis.shape[0], -1)
    if basis.shape[1] != columns.shape[1]:
        return False
    return np.allclose(basis @ (basis.T @ columns), columns, atol=1e-12)


# Schumacher, example 11.3: mode, vectors that span V, vectors that span T
CARTS = [
    ((), np.eye(4), []),
    ((0,), [[0, 1, 0, 0], [0, 0, 0, 1]], [[1, 0, 0, 0], [0, 0, 1, 0]]),
    ((1,), [[1, 1, 0, 0], [0, 0, 1, 1]], [[1, -1, 0, 0], [0, 0, 1, -1]]),
    ((0, 1), [], np.eye(4)),
]


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("mode", "V", "T"), CARTS)
def test_spaces_of_the_two_carts(mode, V, T, exact):
    geometry = mode_geometry(two_carts(), mode, exact=exact)
    assert same_space(geometry.consistent_space, V)
    assert same_space(geometry.jump_space, T)
    assert geometry.exact is exact


@pytest.mark.parametrize(
    ("mode", "before", "after"),
    [
        ((0, 1), (0, 0, -2, 1), (0, 0, 0, 0)),
        ((0,), (0, 0, -2, 1), (0, 0, 0, 1)),
        ((1,), (0, 0, 0, 1), (0, 0, 0.5, 0.5)),
        ((1,), (0, 0, -2, 1), (0, 0, -0.5, -0.5)),
        ((0,), (0, 0, -0.5, -0.5), (0, 0, 0, -0.5)),
    ],
)
def test_jumps_of_the_two_carts(mode, before, after):
    assert mode_geometry(two_carts(), mode).projection @ before == pytest.approx(after, abs=1e-15)


def test_the_triple_integrator_held_at_zero_has_no_consistent_state_but_zero():
    geometry = mode_geometry(integrators(3), (0,))
    assert geometry.consistent_space.shape == (3, 0)
    assert geometry.jump_space.shape == (3, 3)
    assert not geometry.projection.any()


@pytest.mark.parametrize("exact", [True, False])
def test_the_bridge_has_no_projection_exactly_in_its_singular_modes(exact):
    without = {mode for mode in all_modes(4) if mode_geometry(bridge(), mode, exact=exact).projection is None}
    assert without == {(0, 1), (2, 3)}
    assert set(singular_modes(bridge())) == without


def test_without_an_input_there_is_no_projection():
    """B = 0, C != 0: V = {x = 0}, T = {0}."""
    geometry = mode_geometry(LCS([[0]], [[0]], [[1]]), (0,))
    assert geometry.consistent_space.shape == (1, 0)
    assert geometry.jump_space.shape == (1, 0)
    assert geometry.projection is None
    assert geometry.feedback is None


def test_a_nearly_singular_feedthrough_is_told_from_zero_in_exact_arithmetic_only():
    """D = [[1, 1], [1, 1 + 2**-40]]: without the 2**-40 the inputs are not unique."""
    system = LCS([[0]], [[0, 0]], [[0], [0]], [[1, 1], [1, 1 + 2**-40]])
    assert mode_geometry(system, (0, 1), exact=True).projection is not None
    assert mode_geometry(system, (0, 1), exact=False).projection is None


@pytest.mark.parametrize("exact", [True, False])
def test_an_offset_moves_the_consistent_set(exact):
    """x' = u - 1, y = x - 2: held at x = 2 by u = 1."""
    geometry = mode_geometry(LCS([[0]], [[1]], [[1]], f=[-1], g=[-2]), (0,), exact=exact)
    assert geometry.particular == pytest.approx([2.0], abs=1e-14)
    assert geometry.particular_input == pytest.approx([1.0], abs=1e-14)


def test_an_offset_that_cannot_be_compensated_leaves_no_consistent_state():
    geometry = mode_geometry(LCS([[0]], [[0]], [[0]], g=[-1]), (0,))
    assert geometry.particular is None
    assert geometry.particular_input is None


systems = st.builds(
    lambda seed, n, k, feedthrough: random_system(np.random.default_rng(seed), n, k, feedthrough=feedthrough),
    st.integers(0, 10**6),
    st.integers(1, 4),
    st.integers(1, 3),
    st.booleans(),
)


@given(systems)
@settings(max_examples=40, deadline=None)
def test_the_spaces_split_the_state_space_in_every_mode_of_a_totally_invertible_system(system):
    n, k = system.shape
    singular = set(singular_modes(system))
    for mode in all_modes(k):
        geometry = mode_geometry(system, mode)
        if not singular:
            assert geometry.consistent_space.shape[1] + geometry.jump_space.shape[1] == n
        assert (geometry.projection is None) == (mode in singular)


@given(systems, st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_the_feedback_keeps_the_state_in_the_consistent_set(system, seed):
    """x0 in particular + V_I: y_I stays zero under u_I = particular_input + F (x - particular)."""
    rng = np.random.default_rng(seed)
    n, k = system.shape
    system = LCS(system.A, system.B, system.C, system.D, rng.integers(-2, 3, n), rng.integers(-2, 3, k))
    for mode in all_modes(k):
        geometry = mode_geometry(system, mode)
        if geometry.projection is None or geometry.particular is None:
            continue
        P, F, p = geometry.projection, geometry.feedback, geometry.particular
        scale = 1.0 + np.abs(P).max() + np.abs(F).max(initial=0.0)
        assert np.allclose(P @ P, P, atol=1e-10 * scale**2)
        x = p + P @ rng.standard_normal(n)
        u = np.zeros(k)
        u[list(mode)] = geometry.particular_input + F @ (x - p)
        slack = system.C @ x + system.D @ u + system.g.after(0.0)
        assert slack[list(mode)] == pytest.approx(0.0, abs=1e-9 * scale**2)
        rate = system.A @ x + system.B @ u + system.f.after(0.0)
        assert (rate - P @ rate) == pytest.approx(0.0, abs=1e-8 * scale**3)


@given(systems)
@settings(max_examples=40, deadline=None)
def test_floating_point_and_rational_arithmetic_agree(system):
    for mode in all_modes(system.shape[1]):
        exact, floating = (mode_geometry(system, mode, exact=kind) for kind in (True, False))
        assert exact.consistent_space.shape == floating.consistent_space.shape
        assert exact.jump_space.shape == floating.jump_space.shape
        if exact.projection is not None and floating.projection is not None:
            scale = 1.0 + np.abs(exact.projection).max()
            assert floating.projection == pytest.approx(exact.projection, abs=1e-8 * scale**2)


def test_the_flow_in_a_mode_is_a_matrix_exponential():
    """Two carts in contact: x1 = x2 = (a sqrt 2) sin(t / sqrt 2) from (0, 0, a, a)."""
    geometry = mode_geometry(two_carts(), (1,))
    flow = expm((two_carts().A + two_carts().B[:, [1]] @ geometry.feedback) * 0.7)
    a = 0.5
    assert (flow @ [0, 0, a, a])[:2] == pytest.approx([a * 2**0.5 * np.sin(0.7 / 2**0.5)] * 2, abs=1e-14)


@pytest.mark.parametrize("mode", [(2,), (-1,), (0, 0), ("a",), (0.5,)])
def test_index_sets_that_are_none_are_refused(mode):
    with pytest.raises(InvalidInputError, match="mode"):
        mode_geometry(coupled_integrators(), mode)


def test_a_rank_tolerance_of_one_or_more_is_refused():
    with pytest.raises(InvalidInputError, match="rank_tolerance"):
        mode_geometry(coupled_integrators(), (0,), exact=False, rank_tolerance=1.0)
