import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from pricing_core.lcp import LCP, least_norm_solution, solve
from tests.lcp.rational_reference import least_solution


def test_a_unique_solution_is_returned_as_it_is():
    problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
    solution = solve(problem).z
    assert least_norm_solution(problem, solution) is solution


def test_on_a_segment_it_is_the_point_nearest_the_origin():
    """Cottle, Pang, Stone 1992, 4.1.14: all z >= 0 with z1 + z2 = 1."""
    problem = LCP(np.ones((2, 2)), [-1.0, -1.0])
    assert least_norm_solution(problem, np.array([1.0, 0.0])) == pytest.approx([0.5, 0.5], abs=1e-12)


def test_kept_products_stay():
    problem = LCP(np.zeros((3, 3)), np.zeros(3))
    found = least_norm_solution(problem, np.array([3.0, 0.0, 1.0]), kept=np.array([[1.0, 2.0, 0.0]]))
    assert found == pytest.approx([0.6, 1.2, 0.0], abs=1e-12)


@example(seed=711)  # the least is zero
@example(seed=3678)  # parts that are zero, or nearly, by accident
@example(seed=3953)  # constraints that are orthogonal but for rounding
@example(seed=9384)  # slacks that are zero for every solution
@given(seed=st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_no_solution_is_shorter(seed):
    """M = F F^T of low rank: against a general minimiser on {z >= 0, F^T z = F^T z0, q^T z = q^T z0}."""
    rng = np.random.default_rng(seed)
    n, rank = 5, 2
    F = rng.integers(-2, 3, (n, rank)).astype(float)
    planted = np.where(rng.random(n) < 0.6, rng.integers(0, 3, n), 0).astype(float)
    slack = np.where(planted > 0.0, 0.0, rng.integers(0, 2, n)).astype(float)
    problem = LCP(F @ F.T, slack - F @ (F.T @ planted))
    found = least_norm_solution(problem, planted)
    w = problem.M @ found + problem.q
    assert found.min() >= 0.0
    assert w.min() >= -1e-9
    assert abs(found @ w) < 1e-9
    others = minimize(
        lambda z: z @ z,
        planted,
        jac=lambda z: 2.0 * z,
        bounds=[(0.0, 0.0 if s > 0.0 else None) for s in slack],
        constraints={"type": "eq", "fun": lambda z: F.T @ (z - planted), "jac": lambda z: F.T},
        method="SLSQP",
    )
    assert found @ found <= others.fun + 1e-6


@pytest.mark.parametrize("block", range(8))
def test_it_is_least_and_zero_where_it_is_zero_in_rational_arithmetic(block):
    """Positive semidefinite M of any rank, with and without a skew part, and solutions chosen first."""
    several = 0
    for seed in range(40 * block, 40 * block + 40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 5))
        F = rng.integers(-2, 3, (n, int(rng.integers(0, n)))).astype(float)
        K = rng.integers(-1, 2, (n, n)) * (rng.random() < 0.5)
        M = F @ F.T + K - K.T
        known = np.where(rng.random(n) < 0.6, rng.integers(0, 4, n), 0).astype(float)
        slack = np.where(known > 0.0, 0.0, rng.integers(0, 3, n))
        q = slack - M @ known
        expected = least_solution(M, q, known)
        several += not np.array_equal(expected, known)
        for unit in (1.0, 2.0**-33, 2.0**33):
            found = least_norm_solution(LCP(M, unit * q), unit * known) / unit
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
            np.testing.assert_array_equal(found == 0.0, expected == 0.0)
    assert several >= 10


def test_a_component_that_all_solutions_share_is_kept_beside_one_a_1e18_times_as_large():
    M = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    found = least_norm_solution(LCP(M, [-1e-9, -2e9, -2e9]), np.array([1e-9, 2e9, 0.0]))
    np.testing.assert_allclose(found, [1e-9, 1e9, 1e9], rtol=1e-14)


def test_parts_that_nothing_couples_keep_their_own_scale():
    """Two pairs of legs, one with loads 1e-18 times those of the other."""
    ones = np.ones((2, 2))
    M = np.block([[ones, 0.0 * ones], [0.0 * ones, ones]])
    found = least_norm_solution(LCP(M, [-2e-9, -2e-9, -2e9, -2e9]), np.array([2e-9, 0.0, 0.0, 2e9]))
    np.testing.assert_allclose(found, [1e-9, 1e-9, 1e9, 1e9], rtol=1e-14)
