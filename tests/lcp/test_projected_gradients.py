"""Problems that are known by products alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from benchmarks.problems.sparse_complementarity import PROBLEMS
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcp import (
    LCP,
    MixedLCP,
    scaled_residual,
    solve,
    solve_lemke,
    solve_murty,
    solve_projected_gradients,
)


@given(st.integers(1, 15), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_products_find_what_pivots_find(n, seed):
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    M, q = A @ A.T + 0.1 * np.eye(n), random.normal(size=n)
    lower = np.where(random.random(n) < 0.3, -np.inf, -random.random(n))
    upper = np.where(random.random(n) < 0.3, np.inf, random.random(n))
    for problem in (LCP(M, q), MixedLCP(M, q, lower, upper)):
        expected = solve(problem, method="block-pivoting").z
        found = solve_projected_gradients(problem)
        assert scaled_residual(problem, found.z) <= 1e-10
        np.testing.assert_allclose(found.z, expected, rtol=1e-6, atol=1e-7 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize(("name", "side"), [("obstacle", 60), ("torsion", 60), ("elastic contact", 42)])
def test_a_large_operator_is_solved_by_its_products(name, side):
    problem = PROBLEMS[name](side)
    M = aslinearoperator(problem.M)
    given = MixedLCP(M, problem.q, problem.lower, problem.upper)
    found = solve(given)
    assert (found.method, found.reason) == ("projected-gradients", "large linear operator")
    expected = solve(problem).z
    np.testing.assert_allclose(found.z, expected, atol=1e-7 * np.abs(expected).max())
    assert solve(given, start=found.z).iterations <= 60


def test_a_small_operator_is_made_dense_and_goes_wherever_a_matrix_goes():
    problem = LCP(aslinearoperator(np.array([[0.0, -1.0], [1.0, 0.0]])), [1.0, -2.0])
    assert solve(problem).method == "lemke"
    assert solve(problem, method="exact").residual == 0.0
    definite = LCP(aslinearoperator(np.array([[2.0, 1.0], [1.0, 2.0]])), [-4.0, 1.0])
    for solver in (solve_lemke, solve_murty):
        assert solver(definite).z.tolist() == [2.0, 0.0]


def test_what_is_not_definite_or_too_large_for_a_method_is_said():
    with pytest.raises(IterationLimitError, match="curvature") as caught:
        solve_projected_gradients(LCP([[-1.0]], [-1.0]))
    assert caught.value.best is not None
    large = LCP(LinearOperator((4000, 4000), matvec=lambda x: 2.0 * x, dtype=np.float64), -np.ones(4000))
    np.testing.assert_allclose(solve(large).z, 0.5)
    with pytest.raises(InvalidInputError, match="method"):
        solve(large, method="lemke")
    with pytest.raises(IterationLimitError, match="callback"):
        solve_projected_gradients(PROBLEMS["obstacle"](20), callback=lambda iteration, residual: True)
    with pytest.raises(IterationLimitError, match="5 iterations"):
        solve_projected_gradients(PROBLEMS["obstacle"](20), max_iterations=5)
    with pytest.raises(InvalidInputError, match="M"):
        LCP(LinearOperator((2, 3), matvec=lambda x: x[:2], dtype=np.float64), [1.0, 1.0])
