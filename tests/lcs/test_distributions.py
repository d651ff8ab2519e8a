import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from pricing_core.errors import InfeasibleError, InvalidInputError
from pricing_core.lcs import LCS, initial_solution, mode_geometry, rational_complementarity
from pricing_core.linalg.polynomials import is_initially_nonnegative
from tests.problems.lcs_systems import (
    filtered_bridge,
    integrators,
    oscillator,
    random_system,
    two_carts,
    two_integrators,
)


def test_the_triple_integrator_is_stopped_by_the_derivative_of_delta():
    start = initial_solution(integrators(3), (0, -1, 0))
    assert start.impulses.tolist() == [[0.0], [1.0]]
    assert start.x_after.tolist() == [0.0, 0.0, 0.0]
    assert is_initially_nonnegative(start.input_transform)


def test_the_filtered_bridge_shares_its_charge():
    """Charge C * 10 on C + Cf: v = vf = 100/13, carried by the diode of the third pair (closed form)."""
    start = initial_solution(filtered_bridge(), (10, 0, 0))
    assert start.x_after == pytest.approx([100 / 13, 0.0, 100 / 13], abs=1e-13)
    assert start.impulses == pytest.approx(np.array([[0, 0, 3e-7 * 100 / 13, 0]]), rel=1e-13)
    assert start.mode == (2,)


def test_two_solution_sets_with_one_state_need_no_choice():
    start = initial_solution(filtered_bridge(1, 1, 1, 1), (0.5, 0, 1))
    assert start.x_after.tolist() == [0.5, 0.0, 1.0]
    assert start.impulses.shape == (0, 4)
    assert not start.unique_input


@pytest.mark.parametrize(
    ("before", "mode", "after"),
    [
        ((0, 0, -2, 1), (0, 1), (0, 0, 0, 0)),
        ((0, -1, -2, 1), (0,), (0, -1, 0, 1)),
        ((1, 1, -2, 1), (1,), (1, 1, -0.5, -0.5)),
    ],
)
def test_jumps_of_the_two_carts(before, mode, after):
    """Schumacher, example 11.3: both stops hit at once, the wall alone, the carts alone."""
    start = initial_solution(two_carts(), before)
    assert start.mode == mode
    assert start.x_after == pytest.approx(after, abs=1e-15)


def test_states_that_differ_need_a_choice():
    system = two_integrators([[1, 2], [2, 1]])
    with pytest.raises(InvalidInputError, match="their states differ"):
        initial_solution(system, (-1, -1))
    assert initial_solution(system, (-1, -1), (0,)).x_after == pytest.approx([0.0, 1.0])
    assert initial_solution(system, (-1, -1), (1,)).x_after == pytest.approx([1.0, 0.0])
    assert initial_solution(system, (-1, -1), (0, 1)).x_after == pytest.approx([0.0, 0.0])


def test_a_mode_outside_the_solution_sets_is_refused():
    with pytest.raises(InvalidInputError, match="element of S"):
        initial_solution(two_integrators([[1, 2], [2, 1]]), (-1, -1), ())


def test_a_mode_without_a_unique_state_is_refused():
    with pytest.raises(InvalidInputError, match="unique"):
        initial_solution(LCS([[0]], [[1]], [[0]]), [1], (0,))


def test_no_admissible_jump_is_infeasible():
    with pytest.raises(InfeasibleError, match="empty"):
        initial_solution(oscillator(-1), (0, -1))


def test_an_offset_takes_part_in_the_jump():
    """x' = u - 1, y = x - 2, from 0: an impulse of 2, then u = 1."""
    start = initial_solution(LCS([[0]], [[1]], [[1]], f=[-1], g=[-2]), [0])
    assert start.x_after.tolist() == [2.0]
    assert start.impulses.tolist() == [[2.0]]
    assert start.smooth_input(3.0) == pytest.approx([1.0])
    assert start.smooth_state(3.0) == pytest.approx([2.0])


@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3), st.booleans())
@settings(max_examples=60, deadline=None)
def test_the_jump_is_the_projection_and_the_motion_the_flow_of_the_mode(seed, n, k, offset):
    """P_I x0 by subspaces against the impulses of the Laplace transform, for every index set of S(x0)."""
    rng = np.random.default_rng(seed)
    system, x0 = random_system(rng, n, k, feedthrough=seed % 3 == 0), rng.integers(-3, 4, n)
    if offset:
        system = LCS(system.A, system.B, system.C, system.D, rng.integers(-2, 3, n), rng.integers(-2, 3, k))
    for mode in rational_complementarity(system, x0).solution_sets:
        geometry = mode_geometry(system, mode)
        if geometry.projection is None or geometry.particular is None:
            continue
        start = initial_solution(system, x0, mode)
        P, F, p = geometry.projection, geometry.feedback, geometry.particular
        scale = 1.0 + np.abs(P).max() + np.abs(F).max(initial=0.0)
        assert start.x_after == pytest.approx(p + P @ (x0 - p), abs=1e-9 * scale**2)
        # x(0+) = x0 + sum over A^j B times the coefficients of delta^(j)
        jumped, power = x0.astype(float), np.eye(n)
        for impulse in start.impulses:
            jumped = jumped + power @ system.B @ impulse
            power = power @ system.A
        assert start.x_after == pytest.approx(jumped, rel=1e-9, abs=1e-9 * scale)
        held = np.zeros(k)
        held[list(mode)] = geometry.particular_input + F @ (start.x_after - p)
        assert start.smooth_input(0.0) == pytest.approx(held, rel=1e-7, abs=1e-7 * scale**2)
        constant = np.zeros((n + 1, n + 1))
        closed = system.A + system.B[:, list(mode)] @ F
        constant[:n, :n] = closed
        constant[:n, n] = system.f.after(0.0) + system.B[:, list(mode)] @ (geometry.particular_input - F @ p)
        moved = (expm(0.1 * constant) @ [*start.x_after, 1.0])[:n]
        assert start.smooth_state(0.1) == pytest.approx(moved, rel=1e-6, abs=1e-6 * scale**3)
        assert is_initially_nonnegative(start.input_transform)
