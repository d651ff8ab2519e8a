import numpy as np
import pytest
from flint import fmpq_poly
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcs import LCS, singular_modes, transfer_matrix
from pricing_core.lcs.modes import all_modes
from tests.problems.lcs_systems import (
    bridge,
    coupled_integrators,
    filtered_bridge,
    integrators,
    oscillator,
    random_system,
)


def test_transfer_functions_are_in_lowest_terms():
    G = transfer_matrix(oscillator())
    assert (G.numerators, G.denominator) == (((fmpq_poly([0, 1]),),), fmpq_poly([1, 0, 1]))
    assert transfer_matrix(integrators(3)).denominator == fmpq_poly([0, 0, 0, 1])
    hidden = LCS([[0, 0], [0, 5]], [[1], [0]], [[1, 1]])  # the pole at 5 does not reach y
    assert transfer_matrix(hidden).denominator == fmpq_poly([0, 1])


def test_a_submatrix_belongs_to_its_mode():
    G = transfer_matrix(coupled_integrators())
    assert G(2.0).tolist() == [[0.5, 0.25], [0.0, 0.5]]
    assert G.submatrix((1,))(2.0).tolist() == [[0.5]]


@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_evaluation_agrees_with_a_linear_solve(seed, n, k):
    system = random_system(np.random.default_rng(seed), n, k, feedthrough=True)
    for s in (30.5, 25.0 - 3.5j):
        direct = system.C @ np.linalg.solve(s * np.eye(n) - system.A, system.B) + system.D
        assert transfer_matrix(system)(s) == pytest.approx(direct, rel=1e-10, abs=1e-12)


def test_a_pole_is_refused():
    with pytest.raises(NumericalError, match="pole"):
        transfer_matrix(oscillator())(1j)


def test_modes_of_the_bridges_with_singular_transfer_matrices():
    """Diode bridge: {1, 2} and {3, 4}; with a filter: {2} and {1, 3, 4}, counted from 1 (closed form)."""
    assert singular_modes(bridge()) == ((0, 1), (2, 3))
    assert singular_modes(filtered_bridge()) == ((1,), (0, 2, 3))


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_singular_modes_agree_with_determinants_at_one_large_number(seed, n, k):
    system = random_system(np.random.default_rng(seed), n, k, feedthrough=seed % 2 == 0)
    G = transfer_matrix(system)(1.0e3)
    rows = np.abs(G).max(axis=1)
    scaled = G / np.where(rows > 0, rows, 1.0)[:, None]
    for mode in all_modes(k):
        if mode in singular_modes(system):
            assert np.linalg.det(scaled[np.ix_(mode, mode)]) == pytest.approx(0.0, abs=1e-12)


def test_too_many_modes_are_refused():
    with pytest.raises(InvalidInputError, match="at most 12"):
        singular_modes(LCS(np.eye(13), np.eye(13), np.eye(13)))
