from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.linalg.rational import (
    exact_image,
    exact_kernel,
    exact_rank,
    exact_solution,
    rational,
    rational_array,
    rounded,
)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.1, Fraction(1, 10)),
        (1e-6, Fraction(1, 10**6)),
        (-2.5e30, Fraction(-25 * 10**29)),
        (0.123456789012345, Fraction(123456789012345, 10**15)),
        (1 / 3, Fraction(1 / 3)),
        (0.1 + 0.2, Fraction(0.1 + 0.2)),
        (2**53 + 2.0, Fraction(2**53 + 2)),
        (Fraction(1, 3), Fraction(1, 3)),
        (10**30, Fraction(10**30)),
        (np.int64(-4), Fraction(-4)),
    ],
)
def test_a_number_stands_for_its_short_decimal_or_for_itself(value, expected):
    exact = rational(value)
    assert Fraction(int(exact.p), int(exact.q)) == expected


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_the_rational_rounds_back_to_the_float(value):
    assert float(rational(value)) == value


def integer_matrix(seed, m, n):
    return rational_array(np.random.default_rng(seed).integers(-2, 3, (m, n)))


@pytest.mark.parametrize("seed", range(20))
def test_kernel_and_image_have_complementary_dimensions(seed):
    M = integer_matrix(seed, 4, 5)
    kernel, image = exact_kernel(M), exact_image(M)
    assert not (M @ kernel).any()
    assert kernel.shape[1] + image.shape[1] == 5
    assert exact_rank(M) == image.shape[1] == np.linalg.matrix_rank(rounded(M))


@pytest.mark.parametrize("seed", range(20))
def test_a_solution_holds_exactly_and_is_found_where_there_is_one(seed):
    M = integer_matrix(seed, 4, 3)
    R = M @ integer_matrix(seed + 100, 3, 2)
    assert ((M @ exact_solution(M, R)) == R).all()
    outside = np.hstack([R, integer_matrix(seed + 200, 4, 1)])
    solvable = exact_rank(np.hstack([M, outside])) == exact_rank(M)
    assert (exact_solution(M, outside) is not None) == solvable


def test_matrices_without_rows_or_columns():
    empty = rational_array(np.zeros((0, 3)))
    assert exact_kernel(empty).shape == (3, 3)
    assert exact_image(empty.T).shape == (3, 0)
    assert exact_rank(empty) == 0
