import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.grid import exercise_domain, make_grid
from pricing_core.american.semidiscrete import ValueForm
from pricing_core.lcs import LCS, relative_degree
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


def test_hundreds_of_pairs_are_settled_by_the_leading_markov_parameter():
    option, market = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)
    domain = exercise_domain(option, market, 1e-6)
    system, _ = ValueForm.discretise(option, market, domain, make_grid(domain, 301)).as_lcs()
    assert system.shape[1] == 300
    assert relative_degree(system) == 1


def test_a_positive_definite_feedthrough_has_relative_degree_zero():
    rng = np.random.default_rng(1)
    k, n = 40, 10
    half = rng.standard_normal((k, k))
    D = half @ half.T + np.eye(k)
    system = LCS(-np.eye(n), rng.standard_normal((n, k)), rng.standard_normal((k, n)), D)
    assert relative_degree(system) == 0
