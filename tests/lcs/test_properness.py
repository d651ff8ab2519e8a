import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.lcs import (
    LCS,
    is_column_proper,
    is_row_proper,
    leading_column_coefficients,
    leading_row_coefficients,
    transfer_matrix,
)
from tests.problems.lcs_systems import coupled_integrators, random_system, two_carts


def test_coupled_integrators_are_row_and_column_proper_with_leading_matrix_one():
    """The example to theorem 11.3: G = [[1/s, 1/s**2], [0, 1/s]]."""
    for leading in (
        leading_row_coefficients(coupled_integrators()),
        leading_column_coefficients(coupled_integrators()),
    ):
        assert leading.degrees == (-1, -1)
        assert leading.matrix.tolist() == [[1, 0], [0, 1]]
    assert is_row_proper(coupled_integrators())
    assert is_column_proper(coupled_integrators())


def test_the_two_carts_have_the_leading_matrix_of_their_masses():
    """y1 = x1, y2 = x1 - x2: F M^-1 F^T = [[1, 1], [1, 2]], degree -2."""
    leading = leading_row_coefficients(two_carts())
    assert leading.degrees == (-2, -2)
    assert leading.matrix.tolist() == [[1, 1], [1, 2]]


def test_a_row_of_zeros_has_no_degree_and_is_not_proper():
    system = LCS([[0]], [[1, 1]], [[1], [0]])
    assert leading_row_coefficients(system).degrees == (-1, None)
    assert not is_row_proper(system)


@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_leading_coefficients_are_limits_of_the_transfer_matrix(seed, n, k):
    system = random_system(np.random.default_rng(seed), n, k)
    G = transfer_matrix(system)(1e9)
    leading = leading_row_coefficients(system)
    for i, degree in enumerate(leading.degrees):
        if degree is None:
            assert not G[i].any()
        else:
            assert np.allclose(G[i] * 1e9**-degree, leading.matrix[i], atol=1e-4)
