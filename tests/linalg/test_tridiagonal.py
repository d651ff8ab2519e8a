"""The tridiagonal matrix against its dense form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.linalg import Tridiagonal


def random_tridiagonal(n: int, seed: int) -> Tridiagonal:
    random = np.random.default_rng(seed)
    return Tridiagonal(random.normal(size=n - 1), 3.0 + random.uniform(size=n), random.normal(size=n - 1))


@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_product_and_solution_are_those_of_the_dense_matrix(n: int, seed: int) -> None:
    T = random_tridiagonal(n, seed)
    x = np.random.default_rng(seed).normal(size=n)
    np.testing.assert_allclose(T @ x, T.dense() @ x, atol=1e-12)
    np.testing.assert_allclose(T.solve(x), np.linalg.solve(T.dense(), x), atol=1e-9)


def test_several_right_hand_sides_are_solved_at_once() -> None:
    T, rhs = random_tridiagonal(5, 0), np.arange(10.0).reshape(5, 2)
    np.testing.assert_allclose(T.dense() @ T.solve(rhs), rhs, atol=1e-12)


def test_a_multiple_of_the_identity_is_added() -> None:
    T = random_tridiagonal(4, 1)
    np.testing.assert_allclose(T.plus_identity(2.0, -3.0).dense(), 2.0 * np.eye(4) - 3.0 * T.dense())


@pytest.mark.parametrize(("lower", "diagonal"), [([], [0.0]), ([-1.0], [1.0, 1.0])])
def test_a_singular_matrix_is_named_as_such(lower: list[float], diagonal: list[float]) -> None:
    with pytest.raises(NumericalError, match="singular"):
        Tridiagonal(lower, diagonal, lower).solve(np.ones(len(diagonal)))


@pytest.mark.parametrize("bands", [([], [], []), ([1.0], [1.0], []), ([1.0], [1.0, np.inf], [1.0])])
def test_bands_that_do_not_fit_are_refused(bands: tuple[list[float], ...]) -> None:
    with pytest.raises(InvalidInputError):
        Tridiagonal(*bands)
