"""Star and plus: known values, laws, and divergence."""

import numpy as np
import pytest
from hypothesis import given, settings

from pricing_core.errors import NumericalError
from pricing_core.max_plus import (
    ImplicitSystem,
    add,
    dense,
    exact,
    identity,
    least_solution,
    multiply,
    plus,
    power,
    sparse,
    star,
)
from tests.problems.max_plus_problems import E, simple_circuits, whole_matrices

T = np.inf

# Tests of MaxPlus.jl
KNOWN = [
    ([[E, 2, 3], [-2, -10, -1], [-5, -2, 0]], [[0, 2, 3], [-2, 0, 1], [-4, -2, 0]]),
    ([[-1, 2], [E, -3]], [[0, 2], [E, 0]]),
    ([[1, 2], [3, 4]], [[T, T], [T, T]]),
    ([[2, 3], [E, -1]], [[T, T], [E, 0]]),
]


@pytest.mark.parametrize(("A", "expected"), KNOWN)
@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_the_star_of_known_matrices(A, expected, storage):
    np.testing.assert_array_equal(dense(star(storage(A))), expected)


@given(whole_matrices())
@settings(max_examples=100, deadline=None)
def test_the_star_is_idempotent_and_solves_its_equations(A):
    found = star(A)
    np.testing.assert_array_equal(multiply(found, found), found)
    np.testing.assert_array_equal(star(found), found)
    np.testing.assert_array_equal(add(identity(len(A)), multiply(A, found)), found)
    np.testing.assert_array_equal(plus(A), multiply(A, found))
    np.testing.assert_array_equal(star(exact(A)), found)


@given(whole_matrices())
@settings(max_examples=100, deadline=None)
def test_top_stands_exactly_where_a_path_meets_a_circuit_of_positive_weight(A):
    n = len(A)
    reach = np.array([[i == j or A[i, j] != E for j in range(n)] for i in range(n)])
    reach = np.linalg.matrix_power(reach.astype(int), n) > 0
    expected = identity(n)
    for k in range(1, n):
        expected = add(expected, power(A, k))
    for weight, nodes in simple_circuits(A):
        if weight > 0:
            expected[np.outer(reach[:, nodes[0]], reach[nodes[0]])] = T
    np.testing.assert_array_equal(star(A), expected)


def test_a_circuit_of_weight_zero_that_rounding_made_positive_does_not_diverge():
    A = [[E, 0.1 + 0.2], [-0.3, E]]
    assert 0.1 + 0.2 - 0.3 > 0.0
    np.testing.assert_array_equal(star(A), [[0.0, 0.1 + 0.2], [-0.3, 0.0]])
    assert (star(A, tolerance=0.0) == T).all()
    assert (star(exact(A)) == T).all()


@pytest.mark.parametrize(
    ("A", "expected"),
    [
        ([[0.5, -1e16], [-1e16, -1.0]], [[T, T], [T, T]]),
        ([[0.5, E], [-1e16, -1.0]], [[T, E], [T, 0.0]]),
        # The circuit of the large weights is 2, which is rounding; the one of the small weights is not.
        ([[E, 1e16, 1e-4], [2.0 - 1e16, E, E], [1e-4, E, E]], [[T, T, T], [T, T, T], [T, T, T]]),
        ([[-1.0, 1e16], [-1e16, -1.0]], [[0.0, 1e16], [-1e16, 0.0]]),
    ],
)
def test_large_weights_elsewhere_hide_no_circuit_of_positive_weight(A, expected):
    np.testing.assert_array_equal(star(A), expected)
    np.testing.assert_array_equal(dense(star(sparse(A))), expected)
    np.testing.assert_array_equal(least_solution(A, [0.0] * len(A)), np.max(expected, axis=1))
    if T in np.ravel(expected):
        with pytest.raises(NumericalError, match="has a positive weight"):
            ImplicitSystem([A, np.zeros_like(A)]).explicit()
