"""The min-plus twin against shortest paths from SciPy and against hand-made minima."""

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse import csr_array
from scipy.sparse.csgraph import floyd_warshall

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import exact, min_plus
from pricing_core.max_plus.matrices import rows_of
from tests.problems.max_plus_problems import E, simple_circuits, whole_matrices

T = np.inf


@given(whole_matrices())
@settings(max_examples=60, deadline=None)
def test_the_star_holds_the_shortest_paths(A):
    lengths = np.where(A == E, T, 1.0 + np.abs(A))  # SciPy takes a zero for no arc
    expected = floyd_warshall(np.ascontiguousarray(lengths.T)).T  # its arcs go from row to column
    np.fill_diagonal(expected, 0.0)
    np.testing.assert_array_equal(min_plus.star(lengths), expected)
    np.testing.assert_array_equal(min_plus.star(exact(lengths)), expected)


@given(whole_matrices())
@settings(max_examples=60, deadline=None)
def test_the_eigenvalue_is_the_least_circuit_mean(A):
    costs = np.where(A == E, T, -A)
    means = [-weight / len(nodes) for weight, nodes in simple_circuits(A)]
    assert min_plus.eigenvalue(costs) == pytest.approx(min(means, default=T), abs=1e-14)
    assert min(min_plus.cycle_time(costs)) == min_plus.eigenvalue(costs)


def test_sums_products_and_powers_take_the_minimum():
    A, B = np.array([[1.0, T], [0.0, 3.0]]), np.array([[2.0, 5.0], [T, 1.0]])
    np.testing.assert_array_equal(min_plus.add(A, B), np.minimum(A, B))
    product = [[min(A[i, k] + B[k, j] for k in range(2)) for j in range(2)] for i in range(2)]
    np.testing.assert_array_equal(min_plus.multiply(A, B), product)
    np.testing.assert_array_equal(min_plus.power(A, 3), min_plus.multiply(A, min_plus.multiply(A, A)))
    np.testing.assert_array_equal(min_plus.multiply(A, np.array([0.0, T])), [1.0, 0.0])
    np.testing.assert_array_equal(min_plus.plus([[-1.0]]), [[E]])


def test_infinity_absorbs_and_a_sparse_matrix_holds_it_where_nothing_is_stored():
    stored = rows_of((2, 2), np.array([0, 1]), np.array([1, 1]), np.array([4.0, 1.0]))
    product = min_plus.multiply(stored, np.array([E, 2.0]))
    np.testing.assert_array_equal(product, [6.0, 3.0])
    np.testing.assert_array_equal(min_plus.add(stored, stored).data, [4.0, 1.0])


@pytest.mark.parametrize("A", [[[True]], [[1j]], csr_array([[True]]), csr_array([[1j]]), [["1"]]])
@pytest.mark.parametrize(
    "call", [min_plus.star, min_plus.eigenvalue, lambda A: min_plus.add(A, A), lambda A: min_plus.power(A, 2)]
)
def test_what_are_no_real_numbers_is_refused(call, A):
    with pytest.raises(InvalidInputError, match="real numbers"):
        call(A)


@pytest.mark.parametrize("call", [min_plus.eigenvalue, min_plus.cycle_time])
@pytest.mark.parametrize("A", [[[E]], csr_array([[E]])])
def test_the_message_speaks_of_the_infinity_that_was_given(call, A):
    with pytest.raises(InvalidInputError, match="-inf in it: must be numbers and \\+inf"):
        call(A)
