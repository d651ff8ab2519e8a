"""What is a max-plus matrix, and what is refused."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, dia_array, dok_array, lil_array

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.max_plus import (
    critical_graph,
    cycle_ratio,
    cycle_time,
    dense,
    eigenvectors,
    exact,
    identity,
    least_solution,
    min_plus,
    multiply,
    plus,
    power,
    residuate_left,
    simulate,
    solution_of_equation,
    sparse,
    star,
    transient,
)

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
        (np.ma.masked_array([[1.0]], [[True]]), "without a mask"),
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


@pytest.mark.parametrize("make", [bsr_array, dia_array, dok_array, lil_array])
def test_sparse_formats_that_lose_or_make_zeros_are_refused(make):
    with pytest.raises(InvalidInputError, match="CSR, CSC or COO format"):
        star(make([[1.0, 0.0], [2.0, 3.0]]))


@pytest.mark.parametrize("make", [csr_array, csc_array, coo_array])
def test_the_formats_that_are_taken_keep_a_stored_zero(make):
    A = make(coo_array(([0.0, 3.0], ([0, 1], [1, 1])), shape=(2, 2)))
    np.testing.assert_array_equal(dense(A), [[E, 0.0], [E, 3.0]])


@pytest.mark.parametrize("call", [dense, cycle_time, min_plus.star])
@pytest.mark.parametrize(
    ("A", "words"),
    [
        (csr_array(np.array([[2**53 + 1]])), r"2\*\*53"),
        ([[1e151]], r"1e\+151 in it: must be numbers up to 1e\+150 in size"),
        (csr_array([[-1e308]]), r"1e\+308 in it"),
        ([[10**400]], r"up to 1e\+150 in size"),
        ([[Fraction(10) ** 400]], r"up to 1e\+150 in size"),
        (np.array([["1e1000"]]).astype(np.longdouble), r"1e\+1000 in it"),
    ],
)
def test_numbers_that_floats_do_not_hold_are_refused(call, A, words):
    with pytest.raises(InvalidInputError, match=words):
        call(A)


@pytest.mark.parametrize(
    "call",
    [
        lambda: multiply([[1e150]], [[1e150]]),
        lambda: power([[2.0]], 2**1000),
        lambda: power(sparse([[2.0]]), 2**1000),
        lambda: power(exact([[2]]), 2**1000),
        lambda: star([[E, E, E], [9e149, E, E], [E, 9e149, E]]),
        lambda: least_solution([[E, E], [9e149, E]], [9e149, E]),
        lambda: simulate([[9e149]], [0.0], 4),
        lambda: cycle_ratio([[1.0]], [[1e-150]]) + cycle_ratio([[2.0]], [[1e-150]]),
        lambda: min_plus.multiply([[-1e150]], [-1e150]),
        lambda: residuate_left([[-1e150]], [1e150]),
    ],
)
def test_a_result_on_its_way_to_infinity_is_an_error_and_no_top(call):
    with pytest.raises(NumericalError, match=r"beyond 1e\+150"):
        call()


def test_floats_of_less_digits_are_taken_as_they_are():
    np.testing.assert_array_equal(star(np.array([[-0.5, 1.5], [E, E]], dtype=np.float32)), [[0, 1.5], [E, 0]])


def test_exact_rows_of_different_lengths_are_refused():
    with pytest.raises(InvalidInputError, match="rows of one length"):
        exact([[1], [1, 2]])


@pytest.mark.parametrize("tolerance", [np.nan, np.inf, -1.0, "x", True, [1.0]])
@pytest.mark.parametrize(
    "call",
    [
        lambda t: star([[1.0]], tolerance=t),
        lambda t: plus([[1.0]], tolerance=t),
        lambda t: least_solution([[1.0]], [1.0], tolerance=t),
        lambda t: critical_graph([[1.0]], tolerance=t),
        lambda t: solution_of_equation([[1.0]], [1.0], tolerance=t),
        lambda t: min_plus.star([[1.0]], tolerance=t),
    ],
)
def test_what_is_no_tolerance_is_refused(call, tolerance):
    with pytest.raises(InvalidInputError, match="finite number >= 0") as caught:
        call(tolerance)
    assert caught.value.field == "tolerance"


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: identity(-1), "n"),
        (lambda: identity(2.0), "n"),
        (lambda: transient([[1.0]], max_steps=1.5), "max_steps"),
        (lambda: eigenvectors([[1.0]], "x"), "value"),
        (lambda: eigenvectors([[1.0]], E), "value"),
        (lambda: eigenvectors([[1.0]], np.nan), "value"),
        (lambda: cycle_ratio([[1.0]], [[5e-324]]), "holding"),
    ],
)
def test_what_is_no_number_is_refused_by_name(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field


@pytest.mark.parametrize(("value", "words"), [("railway.json", "A = 'railway.json'"), (None, "A = None")])
def test_what_is_no_array_at_all_is_shown_as_it_is(value, words):
    with pytest.raises(InvalidInputError, match=f"{words}: must be a matrix"):
        sparse(value)
