"""What is a max-plus matrix, and what is refused."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import dense, exact, multiply, sparse, star

E = -np.inf


@pytest.mark.parametrize(
    ("A", "words"),
    [
        ([[np.nan]], "A = NaN in it"),
        ([[1.0, 2.0]], "a square matrix"),
        ([], "a matrix"),
        (np.zeros((0, 0)), "at least one entry"),
        ([[1.0], [1.0, 2.0]], "rows of one length"),
        ([["1"]], "real numbers"),
        ([[True]], "real numbers"),
        ([[Fraction(1), 0.5], [1, 2]], "int, Fraction, -inf or inf"),
        ([[None]], "int, Fraction, -inf or inf"),
        ([[2**53 + 1]], r"2\*\*53"),
        (csr_array([[np.nan]]), "NaN"),
        (csr_array((0, 0)), "not empty"),
        (csr_array([[1j]]), "real numbers"),
    ],
)
def test_what_is_no_matrix_is_refused_with_its_name(A, words):
    with pytest.raises(InvalidInputError, match=words) as caught:
        star(A)
    assert caught.value.field == "A"


def test_a_stored_zero_is_a_zero_and_what_is_not_stored_is_epsilon():
    A = csr_array(([0.0, 3.0], ([0, 1], [1, 1])), shape=(2, 2))
    np.testing.assert_array_equal(dense(A), [[E, 0.0], [E, 3.0]])
    assert sparse(dense(A)).nnz == 2


def test_of_two_sparse_entries_at_one_place_the_larger_counts():
    A = coo_array(([1.0, 4.0, 2.0], ([0, 0, 0], [0, 0, 0])), shape=(1, 1))
    np.testing.assert_array_equal(dense(A), [[4.0]])


def test_whole_numbers_too_long_for_a_float_are_kept_by_exact():
    long = 2**60 + 1
    assert multiply(exact([[long]]), exact([[1]]))[0, 0] == 2**60 + 2


def test_an_exact_float_is_the_binary_number_that_it_is():
    assert exact([0.1])[0] == Fraction(3602879701896397, 2**55)


def test_no_call_changes_its_arguments():
    A = np.array([[1.0, E], [2.0, 3.0]])
    before = A.copy()
    star(A)
    multiply(A, A)
    np.testing.assert_array_equal(A, before)
