"""The principal pivot transform keeps solutions and is its own inverse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import NumericalError
from pricing_core.lcp import LCP, solve_lemke
from pricing_core.lcp.principal_pivot import principal_pivot


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_z_and_w_change_places_on_the_pivot_set(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(2, n, n))
    problem = LCP(A @ A.T + np.eye(n) + B - B.T, random.normal(size=n))
    pivot_set = random.uniform(size=n) < 0.5
    transformed = principal_pivot(problem, pivot_set)
    solution, exchanged = solve_lemke(problem), solve_lemke(transformed)
    np.testing.assert_allclose(exchanged.z, np.where(pivot_set, solution.w, solution.z), atol=1e-9)
    np.testing.assert_allclose(exchanged.w, np.where(pivot_set, solution.z, solution.w), atol=1e-9)
    np.testing.assert_allclose(principal_pivot(transformed, pivot_set).dense(), problem.dense(), atol=1e-9)


def test_a_full_pivot_is_the_inverse() -> None:
    M = np.array([[2.0, 1.0], [1.0, 2.0]])
    transformed = principal_pivot(LCP(M, [3.0, 0.0]), np.array([True, True]))
    np.testing.assert_allclose(transformed.dense(), np.linalg.inv(M))
    np.testing.assert_allclose(transformed.q, [-2.0, 1.0])


def test_a_singular_pivot_set_is_refused() -> None:
    with pytest.raises(NumericalError, match="singular"):
        principal_pivot(LCP([[0.0, 1.0], [1.0, 0.0]], [1.0, 1.0]), np.array([True, False]))
