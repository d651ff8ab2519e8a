"""Tridiagonal and sparse problems with any contact set, at any size, from cold and from warm starts."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from pricing_core import kernel
from pricing_core.arrays import Vector
from pricing_core.kernel_twin import growing_basic_set
from pricing_core.lcp import LCP, scaled_residual, solve, solve_lemke, solve_policy_iteration
from pricing_core.linalg import Tridiagonal

BASIC_SETS = [growing_basic_set, kernel.growing_basic_set]


def weakly_dominant(n: int, random: np.random.Generator, excess: float) -> tuple[Vector, Vector, Vector]:
    """Return bands of an M-matrix whose row sums are `excess`, times random row factors."""
    lower, upper = -random.uniform(0.1, 1.0, (2, n - 1))
    diagonal = np.full(n, excess)
    diagonal[1:] -= lower
    diagonal[:-1] -= upper
    factor = 10.0 ** random.uniform(-5.0, 5.0, n)
    return lower * factor[1:], diagonal * factor, upper * factor[:-1]


@pytest.mark.parametrize("excess", [1e-8, 1e-3, 1.0])
@pytest.mark.parametrize("basic_set_of", BASIC_SETS)
def test_one_pass_finds_the_basic_set_of_an_m_matrix(basic_set_of, excess: float) -> None:
    for seed in range(40):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 60))
        bands = weakly_dominant(n, random, excess)
        # Runs of contact of random lengths, so that neither side is zero anywhere.
        contact = np.repeat(random.random(n) < 0.5, random.integers(1, 6, n))[:n]
        z = np.where(contact, 0.0, random.uniform(0.5, 2.0, n))
        M = Tridiagonal(*bands)
        q = np.where(contact, random.uniform(0.5, 2.0, n) * M.diagonal, 0.0) - M @ z
        np.testing.assert_array_equal(basic_set_of(*bands, q), ~contact)


@pytest.mark.parametrize("n", [1_000, 100_000])
def test_an_obstacle_with_many_contact_runs_takes_a_few_systems(n: int) -> None:
    x = np.linspace(0.0, 1.0, n)
    string = Tridiagonal(-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1))
    for waves in (3, 20):
        for bow in (0.0, -4.0):  # without it all peaks are equally high, and touched in points
            wave = np.sin(2.0 * np.pi * waves * x) / (2.0 * waves)
            problem = LCP(string, string @ (2.0 + bow * (x - 0.5) ** 2 + wave))
            found = solve(problem)
            assert found.iterations <= 3
            assert found.method != "lemke"
            assert scaled_residual(problem, found.z) <= 1e-10
            if bow:
                assert np.count_nonzero(np.diff((found.z == 0.0).astype(int)) == 1) >= waves // 2


@pytest.mark.parametrize("n", [2, 30, 5_000])
@pytest.mark.parametrize("sparse", [False, True])
def test_h_matrices_with_signs_of_any_kind_are_solved(n: int, sparse: bool) -> None:
    for seed in range(5):
        random = np.random.default_rng(seed)
        lower, diagonal, upper = weakly_dominant(n, random, 1e-3)
        signs = np.where(random.random((2, n - 1)) < 0.5, -1.0, 1.0)
        M = Tridiagonal(lower * signs[0], diagonal, upper * signs[1])
        q = random.normal(size=n) * diagonal
        problem = LCP(
            csr_array(diags_array([M.lower, M.diagonal, M.upper], offsets=[-1, 0, 1])) if sparse else M, q
        )
        found = solve(problem)
        assert scaled_residual(problem, found.z) <= 1e-12
        if n <= 30:
            np.testing.assert_allclose(found.z, solve_lemke(problem).z, rtol=1e-6, atol=1e-9)


def test_sparse_matrices_that_fill_in_are_solved_by_sweeps() -> None:
    random, n = np.random.default_rng(0), 4_000
    places = random.integers(0, n, (2, 5 * n))
    off = csr_array((random.normal(size=5 * n), tuple(places)), shape=(n, n))
    sums = np.asarray(abs(off).sum(axis=1)).ravel()
    problem = LCP(
        csr_array(off - diags_array(off.diagonal()) + diags_array(1.2 * sums + 0.1)), random.normal(size=n)
    )
    found = solve(problem)
    assert found.method == "projected-sweeps"
    assert scaled_residual(problem, found.z) <= 1e-13


@pytest.mark.parametrize("n", [40, 200])
def test_a_start_that_is_nearly_right_is_mended(n: int) -> None:
    random = np.random.default_rng(n)
    A, B = random.normal(size=(2, n, n)) / np.sqrt(n)
    problem = LCP(A @ A.T + np.eye(n) + B - B.T, random.normal(size=n))
    cold = solve(problem)
    for wrong in (1, 2, n // 30):
        start = cold.z > 0.0
        start[random.choice(n, wrong, replace=False)] ^= True
        warm = solve(problem, start=start)
        assert warm.method == "start-mended"
        assert warm.iterations <= 4
        np.testing.assert_allclose(warm.z, cold.z, rtol=1e-9, atol=1e-12)
    assert solve(problem, start=cold.z).method == "start"
    assert solve(problem, start=cold.z.tolist()).method == "start"
    assert solve(problem, start=~(cold.z > 0.0)).method == cold.method
    assert solve_policy_iteration(problem, start=cold.z > 0.0).iterations == 1
