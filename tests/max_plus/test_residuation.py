"""Greatest sub-solutions: known values, the Galois connection, edge cases of top and epsilon."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InfeasibleError, InvalidInputError
from pricing_core.max_plus import (
    exact,
    multiply,
    residuate_left,
    residuate_right,
    solution_of_equation,
    sparse,
)
from tests.problems.max_plus_problems import E, whole_matrices

T = np.inf
A = [[2, 3, 1], [4, 1, 5]]  # Tests of MaxPlus.jl


@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_a_known_residual_in_every_storage(storage):
    x = residuate_left(storage(A), [7, 6])
    assert x.tolist() == [2, 4, 1]
    assert multiply(storage(A), x).tolist() == [7, 6]
    assert residuate_right([7, 6], storage(np.transpose(A))).tolist() == [2, 4, 1]


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
@settings(max_examples=150, deadline=None)
def test_x_is_a_sub_solution_exactly_if_it_is_below_the_residual(n, m, seed):
    random = np.random.default_rng(seed)
    pool = np.array([E, T, *range(-4, 5)])
    A, b, x = random.choice(pool, (n, m)), random.choice(pool, n), random.choice(pool, m)
    residual = residuate_left(A, b)
    assert (multiply(A, residual) <= b).all()
    assert (multiply(A, x) <= b).all() == (x <= residual).all()
    np.testing.assert_array_equal(residuate_left(exact(A), exact(b)), residual)
    np.testing.assert_array_equal(residuate_left(sparse(A), b), residual)
    np.testing.assert_array_equal(residuate_right(b, A.T), residual)


@given(whole_matrices(rows=3, columns=4), whole_matrices(rows=3, columns=2))
@settings(max_examples=40, deadline=None)
def test_a_matrix_on_the_right_is_taken_column_by_column(A, B):
    found = residuate_left(A, B)
    for j in range(B.shape[1]):
        np.testing.assert_array_equal(found[:, j], residuate_left(A, B[:, j]))
    np.testing.assert_array_equal(residuate_right(B.T, A.T), found.T)


def test_the_row_that_makes_an_equation_unsolvable_is_named():
    with pytest.raises(InfeasibleError, match=r"row 1 of A x is at most 1.0 .* asks for 5"):
        solution_of_equation([[0.0], [1.0]], [0.0, 5.0])


@pytest.mark.parametrize("call", [residuate_left, residuate_right])
def test_sizes_that_differ_are_refused(call):
    with pytest.raises(InvalidInputError):
        call([[1.0, 2.0]], [1.0, 2.0, 3.0]) if call is residuate_left else call([1.0, 2.0, 3.0], [[1.0, 2.0]])


def test_rounding_makes_no_equation_unsolvable():
    """4.4 + x = -1.2 has x = -5.6; in floats 4.4 + (-1.2 - 4.4) is one rounding below -1.2."""
    assert 4.4 + (-1.2 - 4.4) < -1.2
    for matrix in ([[4.4]], sparse([[4.4]])):
        np.testing.assert_allclose(solution_of_equation(matrix, [-1.2]), [-5.6], rtol=1e-15)
        with pytest.raises(InfeasibleError, match="row 0"):
            solution_of_equation(matrix, [-1.2], tolerance=0.0)
    tenths = exact([[Fraction(22, 5)]])
    assert solution_of_equation(tenths, exact([Fraction(-6, 5)])).tolist() == [Fraction(-28, 5)]


def test_large_weights_elsewhere_solve_no_equation():
    with pytest.raises(InfeasibleError, match=r"row 2 of A x is at most 0.0 .* asks for 1e-09"):
        solution_of_equation([[1e16, E], [E, 0.0], [E, 0.0]], [0.0, 0.0, 1e-9])
