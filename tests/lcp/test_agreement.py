"""All methods agree on random problems, in any storage and any units."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix, csr_array, kron

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InfeasibleError, NumericalError
from pricing_core.kernel import brennan_schwartz
from pricing_core.lcp import (
    LCP,
    enumerate_solutions,
    scaled_residual,
    solve,
    solve_double_sweep,
    solve_lemke,
    solve_murty,
    solve_policy_iteration,
    solve_psor,
)
from pricing_core.linalg import Tridiagonal

sizes = st.integers(1, 12)
seeds = st.integers(0, 2**32 - 1)


def p_matrix(n: int, random: np.random.Generator) -> Matrix:
    """Return a positive definite matrix, in general not symmetric and no H-matrix."""
    A, B = random.normal(size=(2, n, n))
    return np.asarray(A @ A.T + 0.1 * np.eye(n) + B - B.T)


def m_matrix_bands(n: int, random: np.random.Generator) -> Tridiagonal:
    """Return a strictly diagonally dominant tridiagonal M-matrix."""
    lower, upper = -random.uniform(0.0, 1.0, (2, n - 1))
    diagonal = random.uniform(0.05, 1.0, n)
    diagonal[1:] -= lower
    diagonal[:-1] -= upper
    return Tridiagonal(lower, diagonal, upper)


def degenerate(M: Matrix, random: np.random.Generator) -> tuple[Vector, Vector]:
    """Return (z, q) with z the solution and z_i = w_i = 0 for about a third of the indices."""
    kind = random.integers(0, 3, len(M))
    z = np.where(kind == 0, random.uniform(0.5, 2.0, len(M)), 0.0)
    return z, np.where(kind == 1, random.uniform(0.5, 2.0, len(M)), 0.0) - M @ z


@given(sizes, seeds)
@settings(max_examples=30, deadline=None)
def test_lemke_murty_and_enumeration_agree_for_p_matrices(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    problem = LCP(p_matrix(n, random), random.normal(size=n))
    lemke, murty = solve_lemke(problem), solve_murty(problem)
    (only,) = enumerate_solutions(problem).isolated
    for solution in (lemke, murty, only):
        assert scaled_residual(problem, solution.z) <= 1e-13
        np.testing.assert_allclose(solution.z, lemke.z, rtol=1e-8, atol=1e-8 * (1.0 + lemke.z.max()))


@given(st.integers(1, 40), seeds)
@settings(max_examples=60, deadline=None)
def test_all_methods_agree_for_tridiagonal_m_matrices(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    problem = LCP(m_matrix_bands(n, random), random.normal(size=n))
    expected = solve_lemke(problem).z
    storages = [problem, LCP(problem.dense(), problem.q), LCP(csr_array(problem.dense()), problem.q)]
    for stored in storages:
        for solution in (
            solve(stored),
            solve(stored, method="tridiagonal"),
            solve_policy_iteration(stored),
            solve_murty(stored),
            solve_psor(stored, relaxation=1.0),
        ):
            np.testing.assert_allclose(solution.z, expected, rtol=1e-9, atol=1e-9)


@given(st.integers(3, 60), seeds)
@settings(max_examples=60, deadline=None)
def test_the_double_sweep_is_exact_for_one_contact_run_anywhere(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = m_matrix_bands(n, random)
    first, end = np.sort(random.integers(0, n + 1, 2))
    contact = (np.arange(n) >= first) & (np.arange(n) < end)
    z = np.where(contact, 0.0, random.uniform(0.5, 2.0, n))
    problem = LCP(M, np.where(contact, random.uniform(0.0, 1.0, n), 0.0) - M @ z)
    np.testing.assert_allclose(solve_double_sweep(problem).z, z, rtol=1e-10, atol=1e-10)


@given(st.integers(3, 60), seeds)
@settings(max_examples=60, deadline=None)
def test_each_sweep_is_a_lower_bound_of_the_solution(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = m_matrix_bands(n, random)
    problem = LCP(M, random.normal(size=n))
    solution = solve_policy_iteration(problem).z
    for contact_first in (True, False):
        bound = brennan_schwartz(M.lower, M.diagonal, M.upper, problem.q, contact_first)
        assert (bound <= solution + 1e-10 * (1.0 + solution)).all()


@given(sizes, seeds)
@settings(max_examples=15, deadline=None)
def test_degenerate_problems_are_solved(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = p_matrix(n, random)
    z, q = degenerate(M, random)
    for method in ("auto", "lemke", "murty", "enumeration"):
        found = solve(LCP(M, q), method=method)  # type: ignore[arg-type]
        np.testing.assert_allclose(found.z, z, rtol=1e-8, atol=1e-8)


@given(sizes, seeds)
@settings(max_examples=15, deadline=None)
def test_units_of_rows_and_columns_do_not_matter(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M, q = p_matrix(n, random), random.normal(size=n)
    expected = solve_lemke(LCP(M, q)).z
    row, column = 10.0 ** random.uniform(-6.0, 6.0, (2, n))  # entries from 1e-12 to 1e12
    scaled = LCP(row[:, None] * M * column, row * q)
    for method in ("auto", "lemke", "murty", "enumeration"):
        found = solve(scaled, method=method)  # type: ignore[arg-type]
        np.testing.assert_allclose(column * found.z, expected, rtol=1e-6, atol=1e-7 * (1.0 + expected.max()))


@given(st.integers(1, 4), seeds)
@settings(max_examples=60, deadline=None)
def test_small_integer_problems_are_solved_or_refused_as_enumeration_says(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    problem = LCP(random.integers(-2, 3, (n, n)), random.integers(-2, 3, n))
    found = enumerate_solutions(problem)
    if found.isolated or found.faces:
        solution = solve(problem)
        assert solution.residual <= 1e-12
        try:
            lemke = solve_lemke(problem)
        except InfeasibleError:
            pytest.fail("Lemke claims a proof that a solvable problem is infeasible")
        except NumericalError:
            return
        assert lemke.residual <= 1e-12
    else:
        with pytest.raises(InfeasibleError):
            solve(problem)


@pytest.mark.parametrize("seed", range(3))
def test_a_bimatrix_game_too_large_for_enumeration_is_solved(seed: int) -> None:
    half = 15
    payoffs = np.random.default_rng(seed).uniform(1.0, 2.0, (2, half, half))
    M = np.block([[np.zeros((half, half)), payoffs[0]], [payoffs[1], np.zeros((half, half))]])
    solution = solve(LCP(M, -np.ones(2 * half)))
    assert solution.method == "lemke-pivoted"
    assert solution.residual <= 1e-12


def test_a_large_sparse_m_matrix_goes_to_policy_iteration() -> None:
    side = 30
    line = csr_array(Tridiagonal(-np.ones(side - 1), np.full(side, 2.0), -np.ones(side - 1)).dense())
    eye = csr_array(np.eye(side))
    M = kron(line, eye) + kron(eye, line)
    q = np.cos(np.arange(side * side))
    solution = solve(LCP(csc_matrix(M), q))
    assert solution.method == "policy-iteration"
    assert solution.residual <= 1e-12
    np.testing.assert_allclose(solution.z, solve_psor(LCP(M, q), relaxation=1.5).z, rtol=1e-8, atol=1e-9)
