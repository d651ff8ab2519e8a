import itertools
import sys

import numpy as np
import pytest
from flint import fmpq, fmpq_mat, fmpq_poly
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, RayTerminationError
from pricing_core.lcp import LCP, enumerate_solutions
from pricing_core.lcs import LCS, rational_complementarity, transfer_matrix
from pricing_core.lcs.modes import all_modes
from tests.problems.lcs_systems import (
    bridge,
    filtered_bridge,
    integrators,
    oscillator,
    random_system,
    two_carts,
    two_integrators,
)


def answer(system, x0):
    found = rational_complementarity(system, x0)
    return found.solution_sets, found.unique_state, found.unique_input


# (system, x0, S(x0), unique state, unique input), closed forms; index sets from 0
KNOWN = [
    (two_integrators([[1, 2], [2, 1]]), (-1, -1), ((0,), (1,), (0, 1)), False, False),
    (two_integrators([[1, 2], [2, 1]]), (1, 1), ((),), True, True),
    (oscillator(-1), (0, 1), ((), (0,)), False, False),
    (oscillator(-1), (0, -1), (), True, True),
    (oscillator(), (0, -1), ((0,),), True, True),
    (integrators(3), (0, -1, 0), ((0,),), True, True),
    (two_carts(), (0, 0, -2, 1), ((0, 1),), True, True),
    # the bridge at v > 0, v < 0 and, with i > 0, at v = 0 on its way to v < 0: diodes F1 and R2, or R1 and F2
    (bridge(), (10, 0), ((0, 2),), True, True),
    (bridge(), (-10, 0), ((1, 3),), True, True),
    (bridge(), (0, 0.01), ((1, 3),), True, True),
    (bridge(), (0, 0), tuple(all_modes(4)), True, True),
    # the bridge with a filter: off, where u2 may be anything from 0 to vf - v; and the start that shares the charge
    (filtered_bridge(1, 1, 1, 1), (0.5, 0, 1), ((), (1,), (1, 2)), True, False),
    (filtered_bridge(), (10, 0, 0), ((2,),), True, True),
]


@pytest.mark.parametrize(("system", "x0", "sets", "state", "inputs"), KNOWN)
def test_solution_sets_of_known_systems(system, x0, sets, state, inputs):
    assert answer(system, x0) == (sets, state, inputs)


def test_the_multiplier_of_the_triple_integrator_is_the_derivative_of_delta():
    (u,) = rational_complementarity(integrators(3), (0, -1, 0)).multipliers
    assert (u.numerators, u.denominator) == ((fmpq_poly([0, 1]),), fmpq_poly([1]))


@pytest.mark.parametrize("system", [two_carts(), bridge(), filtered_bridge(), integrators(2)])
def test_every_index_set_solves_from_the_origin(system):
    n, k = system.shape
    assert rational_complementarity(system, np.zeros(n)).solution_sets == tuple(all_modes(k))


def test_an_offset_acts_from_the_first_moment():
    """x' = u - 1, y = x: from x = 0 only y = 0 goes on; with x' = u + 1 only u = 0."""
    assert answer(LCS([[0]], [[1]], [[1]], f=[-1]), [0]) == (((0,),), True, True)
    assert answer(LCS([[0]], [[1]], [[1]], f=[1]), [0]) == (((),), True, True)
    assert answer(LCS([[0]], [[1]], [[1]], g=[-2]), [1]) == (((0,),), True, True)


def test_three_ways_out_of_the_origin_of_a_relay_system():
    """x' = -B sgn x with B = [[1, -3], [-2, 1]]: x = 0, x = (2t, t), x = (-2t, -t).

    sgn x_i = 1 - u_i, u_i = z_i: 0 <= x_i + v_i _|_ u_i >= 0, 0 <= 2 - u_i _|_ v_i >= 0.
    """
    B = np.array([[1, -3], [-2, 1]])
    system = LCS(
        np.zeros((2, 2), dtype=int),
        np.hstack([B, np.zeros((2, 2), dtype=int)]),
        np.vstack([np.eye(2, dtype=int), np.zeros((2, 2), dtype=int)]),
        np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]]),
        f=-B @ [1, 1],
        g=[0, 0, 2, 2],
    )
    found = rational_complementarity(system, [0, 0])
    rates = {
        tuple(round(float(v), 12) for v in system.f.after(0.0) + system.B @ u.initial_value())
        for u in found.multipliers
    }
    assert rates == {(0.0, 0.0), (2.0, 1.0), (-2.0, -1.0)}
    assert not found.unique_state


LARGE = 10**40  # beyond every root of these systems' numerators
seeds = st.integers(0, 10**6)


@given(seeds, st.integers(1, 4), st.integers(1, 3), st.booleans())
@settings(max_examples=60, deadline=None)
def test_the_sets_agree_with_linear_complementarity_problems_at_large_numbers(seed, n, k, feedthrough):
    """The signs of all solutions of LCP(q(s), G(s)) at one large s, in fractions (theorem 11.5)."""
    rng = np.random.default_rng(seed)
    system, x0 = random_system(rng, n, k, feedthrough=feedthrough), rng.integers(-3, 4, n)
    found = set(rational_complementarity(system, x0).solution_sets)
    resolvent = fmpq_mat(n, n, [LARGE * (i == j) - int(a) for (i, j), a in np.ndenumerate(system.A)])
    B, C, D = (
        fmpq_mat(*matrix.shape, [int(entry) for entry in matrix.ravel()])
        for matrix in (system.B, system.C, system.D)
    )
    M = np.array((C * resolvent.solve(B) + D).tolist(), dtype=object).reshape(k, k)
    q = np.array((C * resolvent.solve(fmpq_mat(n, 1, [int(x) for x in x0]))).tolist(), dtype=object).ravel()
    for mode in all_modes(k):
        inside = list(mode)
        MII = fmpq_mat(len(inside), len(inside), M[np.ix_(inside, inside)].ravel().tolist())
        if inside and MII.det() == 0:
            continue
        u = np.full(k, fmpq(0))
        if inside:
            u[inside] = np.array(MII.solve(fmpq_mat(len(inside), 1, (-q[inside]).tolist())).tolist()).ravel()
        admitted = all(value >= 0 for value in (*u, *(M @ u + q)))
        assert (mode in found) == admitted


@given(seeds, st.integers(1, 3), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_singular_modes_agree_with_an_enumeration_at_a_large_number(seed, n, k):
    """G of rank 1: most modes are singular. Solutions at s = 1000 exist where S(x0) is not empty."""
    rng = np.random.default_rng(seed)
    system = LCS(
        rng.integers(-2, 3, (n, n)),
        rng.integers(-2, 3, (n, 1)) @ rng.integers(-1, 3, (1, k)),
        rng.integers(-2, 3, (k, n)),
    )
    x0 = rng.integers(-3, 4, n)
    found = rational_complementarity(system, x0)
    s = 1e3
    q = system.C @ np.linalg.solve(s * np.eye(n) - system.A, x0)
    q = np.where(np.abs(q) > 1e-15, q, 0.0)  # a zero that was rounded leaves no solution
    M = transfer_matrix(system)(s)
    solutions = enumerate_solutions(LCP(s * M, s * q))
    assert bool(solutions.isolated or solutions.faces) == bool(found.solution_sets)
    if solutions.faces:
        assert not found.unique_input


@given(seeds, st.integers(1, 4), st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_lemkes_path_ends_in_one_of_the_sets(seed, n, k):
    """G = D + C (sI - A)^-1 B with D = H H^T + I: a P-matrix for large s."""
    rng = np.random.default_rng(seed)
    H = rng.integers(-2, 3, (k, k))
    system = LCS(
        rng.integers(-3, 4, (n, n)),
        rng.integers(-3, 4, (n, k)),
        rng.integers(-3, 4, (k, n)),
        H @ H.T + np.eye(k, dtype=int),
    )
    x0 = rng.integers(-3, 4, n)
    one = rational_complementarity(system, x0, complete=False)
    found = rational_complementarity(system, x0)
    assert one.solution_sets[0] in found.solution_sets
    assert (one.complete, one.unique_state, one.unique_input) == (False, None, None)
    assert found.unique_input


def test_degenerate_pivots_do_not_cycle():
    """Kostreva's matrix, on which complementary pivoting without a lexicographic rule cycles."""
    system = LCS(np.zeros((3, 3)), [[1, 2, 0], [0, 1, 2], [2, 0, 1]], np.eye(3))
    (u,) = rational_complementarity(system, [-1, -1, -1], complete=False).multipliers
    assert u.polynomial_part() == pytest.approx(np.full((1, 3), 1 / 3))


def test_more_than_sixteen_pairs_need_a_word():
    system = LCS(np.zeros((17, 17)), np.eye(17), np.eye(17))
    x0 = np.array([-1, 1] * 8 + [-1])
    with pytest.raises(InvalidInputError, match="complete=False"):
        rational_complementarity(system, x0)
    assert rational_complementarity(system, x0, complete=False).solution_sets == (tuple(range(0, 17, 2)),)


def test_a_ray_proves_nothing_and_says_so():
    with pytest.raises(RayTerminationError):
        rational_complementarity(oscillator(-1), (0, -1), complete=False)


@pytest.mark.parametrize("x0", [(1.0,), (np.nan, 0.0), ((1.0, 2.0),)])
def test_states_that_do_not_fit_are_refused(x0):
    with pytest.raises(InvalidInputError, match="x0"):
        rational_complementarity(oscillator(), x0)


def test_the_order_of_the_pairs_does_not_matter():
    rng = np.random.default_rng(7)
    for _ in range(10):
        system, x0 = random_system(rng, 2, 3), rng.integers(-2, 3, 2)
        sets = rational_complementarity(system, x0).solution_sets
        for order in itertools.permutations(range(3)):
            mixed = LCS(system.A, system.B[:, order], system.C[list(order)])
            renamed = {
                tuple(sorted(order[i] for i in mode))
                for mode in rational_complementarity(mixed, x0).solution_sets
            }
            assert renamed == set(sets)


@pytest.mark.parametrize("seed", range(10))
def test_one_path_finds_what_all_modes_have_where_the_multiplier_is_unique(seed, monkeypatch):
    """With C = B^T and D of definite symmetric part, of few pairs both ways, and of 16 by the one path."""
    rng = np.random.default_rng(seed)

    def system(n, k):
        B, K = rng.integers(-2, 3, (n, k)), rng.integers(-1, 2, (k, k))
        return LCS(rng.integers(-2, 3, (n, n)), B, B.T, np.eye(k, dtype=int) + K - K.T)

    small, x0 = system(3, 4), rng.integers(-2, 3, 3)
    by_modes = rational_complementarity(small, x0)
    monkeypatch.setattr(sys.modules["pricing_core.lcs.rational_complementarity"], "LARGEST_PAIRS", 0)
    by_path = rational_complementarity(small, x0)
    assert by_path.solution_sets == by_modes.solution_sets
    assert by_path.unique_input
    assert by_modes.unique_input
    large, x0 = system(6, 16), rng.integers(-3, 4, 6)
    found = rational_complementarity(large, x0)
    assert found.solution_sets
    assert found.unique_state
