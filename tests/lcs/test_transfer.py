import numpy as np
import pytest

from pricing_core.lcs import LCS, relative_degree
from pricing_core.lcs.exact_degree import exact_degree
from pricing_core.obstacle import as_lcs
from tests.obstacle.problems import PUT, option
from tests.problems.lcs_problems import problems


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
def test_relative_degree_of_known_systems(problem):
    assert relative_degree(problem.system) == problem.relative_degree


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_relative_degree_of_integrator_chains(degree):
    A = np.eye(degree, k=1)
    B, C = np.zeros((degree, 1)), np.zeros((1, degree))
    B[-1], C[0, 0] = 1.0, 1.0
    assert relative_degree(LCS(A, B, C)) == degree
    assert relative_degree(LCS(A - 3 * np.eye(degree), 1e-3 * B, 1e3 * C)) == degree


def test_a_mode_can_have_a_higher_degree_than_its_parts():
    """G = [[1/s, 1/s], [1/s, 1/s + 1/s**3]]: entries of degree 1, determinant 1/s**4, inverse of degree 3."""
    A = np.zeros((4, 4))
    A[1, 2] = A[2, 3] = 1.0
    B = [[1.0, 1.0], [0, 0], [0, 0], [0, 1.0]]
    C = [[1.0, 0, 0, 0], [1.0, 1.0, 0, 0]]
    assert relative_degree(LCS(A, B, C)) == 3


# Found with rational arithmetic, where a floating-point inverse at large s loses or invents a power of s.
SCALED = [
    (
        [[0] * 5, [0] * 5, [2, 0, 0, 0, 0], [0, 0, 0, -1, 2], [0] * 5],
        [[1, 0, 0], [-2, 0, 0], [0, 2, 2], [2, 0, 2], [0, 0, -2]],
        [[-2, -1, 1, 2, 1], [2, -1, 0, -1, 0], [0] * 5],
        [[-1, -1, 1], [-1, -1, 0], [0, -1, 1]],
        3,
    ),
    ([[0, 1000], [0, 0]], [[0, 2], [-1, 0]], [[0, -2], [1, 0]], [[-1, 1], [-1, 1]], 2),
    # G = 1e-6 / s**2 + 1 / s**3
    ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [1e-6], [1]], [[1, 0, 0]], [[0]], 2),
    ([[0]], [[1e6]], [[1]], [[1e-3]], 0),
    ([[0]], [[1e-200]], [[1e-200]], [[0]], 1),
    # D has the determinant 1 - (1 + 2**-52)(1 - 2**-52) = 2**-104.
    ([[0]], [[0, 0]], [[0], [0]], [[1, 1 + 2**-52], [1 - 2**-52, 1]], 0),
]


@pytest.mark.parametrize(("A", "B", "C", "D", "degree"), SCALED)
def test_bad_scales_do_not_change_the_degree(A, B, C, D, degree):
    assert relative_degree(LCS(A, B, C, D)) == degree


@pytest.mark.parametrize("k", [2, 8])
def test_a_multiplier_without_effect_is_passed_over(k):
    """Column 0 of G is zero; the other pairs are integrators."""
    B = np.eye(k)
    B[0, 0] = 0.0
    C = np.eye(k)
    C[0, 1] = 1.0
    assert relative_degree(LCS(np.zeros((k, k)), B, C)) == 1


def test_exact_and_floating_point_degrees_agree_on_well_scaled_systems(monkeypatch):
    rng = np.random.default_rng(5)
    for _ in range(20):
        A, B, C = rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
        D = np.diag(rng.integers(0, 2, 2))
        exact = relative_degree(LCS(A, B, C, D))
        with monkeypatch.context() as patch:
            patch.setattr("pricing_core.lcs.transfer.LARGEST_EXACT", 0)
            assert relative_degree(LCS(A, B, C, D)) == exact


def test_numbers_too_long_for_exact_arithmetic_are_declined():
    n = 12
    A = np.diag(10.0 ** np.arange(-20 * n, 20 * n, 40))
    assert exact_degree(LCS(A, np.ones((n, 6)), np.ones((6, n))), [(0,)]) is None


def test_hundreds_of_pairs_are_settled_by_the_leading_markov_parameter():
    system = as_lcs(option(PUT), 300).system
    assert system.shape[1] == 300
    assert relative_degree(system) == 1


def test_a_positive_definite_feedthrough_has_relative_degree_zero():
    rng = np.random.default_rng(1)
    k, n = 40, 10
    half = rng.standard_normal((k, k))
    D = half @ half.T + np.eye(k)
    system = LCS(-np.eye(n), rng.standard_normal((n, k)), rng.standard_normal((k, n)), D)
    assert relative_degree(system) == 0
