"""The laws of the algebra, in every storage."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import issparse

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import add, dense, exact, identity, multiply, power, sparse
from tests.problems.max_plus_problems import E, whole_matrices

T = np.inf


@st.composite
def triples(draw):
    n = draw(st.integers(1, 5))
    return tuple(draw(whole_matrices(rows=n)) for _ in range(3))


@given(triples())
@settings(max_examples=50, deadline=None)
def test_the_product_is_associative_and_distributes_over_the_sum(matrices):
    A, B, C = matrices
    np.testing.assert_array_equal(multiply(multiply(A, B), C), multiply(A, multiply(B, C)))
    np.testing.assert_array_equal(multiply(A, add(B, C)), add(multiply(A, B), multiply(A, C)))
    np.testing.assert_array_equal(add(A, A), A)
    np.testing.assert_array_equal(multiply(A, identity(len(A))), A)


@given(triples(), st.integers(0, 9))
@settings(max_examples=50, deadline=None)
def test_sparse_exact_and_float_storage_give_the_same(matrices, k):
    A, B, C = matrices
    x = np.where(C[0] == E, 0.0, C[0])
    for operation in (add, multiply):
        expected = operation(A, B)
        assert issparse(operation(sparse(A), sparse(B)))
        for left in (A, sparse(A), exact(A)):
            for right in (B, sparse(B), exact(B)):
                np.testing.assert_array_equal(dense(operation(left, right)).astype(float), expected)
        np.testing.assert_array_equal(operation(exact(A), exact(B)), expected)
    for left in (sparse(A), exact(A)):
        np.testing.assert_array_equal(multiply(left, x), multiply(A, x))
        np.testing.assert_array_equal(dense(power(left, k)), power(A, k))


@given(whole_matrices(most=4), st.integers(0, 8))
@settings(max_examples=40, deadline=None)
def test_a_power_by_squaring_is_the_repeated_product(A, k):
    expected = identity(len(A))
    for _ in range(k):
        expected = multiply(expected, A)
    np.testing.assert_array_equal(power(A, k), expected)


def test_epsilon_absorbs_top_and_there_is_no_nan():
    np.testing.assert_array_equal(multiply([[T, E]], [[E], [T]]), [[E]])
    np.testing.assert_array_equal(multiply([[T, E]], [[1.0], [T]]), [[T]])
    np.testing.assert_array_equal(multiply(exact([[T, E]]), exact([[E], [T]])), [[E]])
    np.testing.assert_array_equal(add([[T, E]], [[E, E]]), [[T, E]])
    np.testing.assert_array_equal(dense(multiply(sparse([[T]]), sparse([[E]]))), [[E]])


def test_exact_beside_float_gives_float():
    product = multiply(exact([[Fraction(1, 3)]]), [[1.0]])
    assert product.dtype == np.float64


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: multiply([[1.0, 2.0]], [[1.0, 2.0]]), "B"),
        (lambda: add([[1.0, 2.0]], [[1.0]]), "B"),
        (lambda: power([[1.0]], -1), "k"),
        (lambda: power([[1.0]], 0.5), "k"),
        (lambda: power([[1.0, 2.0]], 2), "A"),
        (lambda: multiply([[1.0]], 3.0), "B"),
        (lambda: add([[1.0], [1.0, 2.0]], [[1.0]]), "A"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field
