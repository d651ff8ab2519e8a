"""x = A x + b: the least solution is A* b, in every storage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import add, exact, least_solution, multiply, sparse, star
from pricing_core.max_plus.matrices import rows_of
from tests.problems.max_plus_problems import E, whole_matrices


@given(whole_matrices(), st.integers(0, 2**32 - 1))
@settings(max_examples=150, deadline=None)
def test_the_least_solution_is_the_star_times_b(A, seed):
    b = np.random.default_rng(seed).choice([E, -3.0, 0.0, 4.0, np.inf], len(A))
    found = least_solution(A, b)
    np.testing.assert_array_equal(found, multiply(star(A), b))
    np.testing.assert_array_equal(found, add(multiply(A, found), b))
    np.testing.assert_array_equal(least_solution(exact(A), exact(b)), found)
    np.testing.assert_array_equal(least_solution(sparse(A), b), found)


def test_a_divergent_circuit_that_does_not_hear_of_b_stays_silent():
    np.testing.assert_array_equal(least_solution([[2.0, E], [E, -1.0]], [E, 0.0]), [E, 0.0])
    np.testing.assert_array_equal(least_solution([[2.0, 3.0], [E, -1.0]], [E, 0.0]), [np.inf, 0.0])


def test_rounding_does_not_run_round_a_circuit_of_weight_zero():
    A = np.array([[E, 0.1 + 0.2], [-0.3, E]])
    np.testing.assert_allclose(least_solution(A, [0.0, E]), [0.0, -0.3], rtol=1e-15)


def test_b_of_another_length_is_refused():
    with pytest.raises(InvalidInputError, match="a vector of length 1"):
        least_solution([[1.0]], [1.0, 2.0])


def test_large_weights_elsewhere_do_not_shorten_a_path():
    A = np.full((4, 4), E)
    A[1, 0], A[2, 0], A[2, 3] = 1e16, 1.0, 3e-9
    np.testing.assert_array_equal(least_solution(A, [0.0, E, 0.5, 1.0]), [0.0, 1e16, 1.0 + 3e-9, 1.0])
    A[3, 3] = -1e16
    np.testing.assert_array_equal(least_solution(A, [0.0, E, 0.5, 1.0]), [0.0, 1e16, 1.0 + 3e-9, 1.0])


def test_a_path_through_twenty_thousand_nodes_is_the_sum_of_its_weights():
    n = 20_000
    weight = np.random.default_rng(4).integers(-9, 10, n - 1).astype(float)
    chain = rows_of((n, n), np.arange(1, n), np.arange(n - 1), weight)
    start = np.where(np.arange(n) == 0, 2.0**50, E)
    np.testing.assert_array_equal(least_solution(chain, start), 2.0**50 + np.append(0, np.cumsum(weight)))
