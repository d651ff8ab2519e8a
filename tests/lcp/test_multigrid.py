"""Large sparse problems by active sets and multigrid, against other methods and known solutions."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from benchmarks.problems.sparse_complementarity import PROBLEMS, journal_bearing, laplacian, obstacle, torsion
from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcp import (
    LCP,
    MixedLCP,
    natural_residual,
    scaled_residual,
    solve,
    solve_block_pivoting,
    solve_multigrid,
)
from pricing_core.linalg import Tridiagonal
from pricing_core.linalg.multigrid import Multigrid, near_null_vectors

SIDES = {"obstacle in space": 16, "elastic contact": 42}


@pytest.mark.parametrize("name", PROBLEMS)
def test_large_problems_are_solved_as_direct_methods_solve_them(name):
    problem = PROBLEMS[name](SIDES.get(name, 60))
    found = solve_multigrid(problem)
    assert found.method in {"multigrid", "projected-sweeps"}
    assert found.iterations <= 40
    assert scaled_residual(problem, found.z) <= 1e-12
    assert found.residual <= 1e-8 * np.abs(problem.q).max()
    peer = solve_block_pivoting(problem)
    np.testing.assert_allclose(found.z, peer.z, rtol=0.0, atol=1e-9 * np.abs(peer.z).max())


@pytest.mark.parametrize("name", ["obstacle", "torsion", "elastic contact", "drifting obstacle"])
def test_the_front_door_takes_it_from_three_thousand_unknowns_on(name):
    problem = PROBLEMS[name](SIDES.get(name, 60))
    found = solve(problem)
    assert found.method == "multigrid"
    assert "sparse" in found.reason


def test_a_start_near_the_solution_saves_iterations():
    problem = obstacle(80)
    cold = solve(problem)
    nearby = LCP(problem.M, problem.q + 1e-6)
    assert solve(nearby, start=cold.z).iterations <= 2
    assert solve(problem, start=cold.z).residual <= 1e-8 * np.abs(problem.q).max()


def test_the_torsion_of_an_elastic_bar_is_that_of_a_membrane():
    """With a small twist no bound is met, and the stress function solves a linear equation: its Fourier series."""
    side = 63
    problem = torsion(side)
    small = MixedLCP(problem.M, 1e-3 * problem.q, problem.lower, problem.upper)
    z = solve(small).z.reshape(side, side)
    odd = np.arange(1, 200, 2)
    signs = np.where((odd // 2) % 2 == 0, 1.0, -1.0)
    weights = 16.0 / (np.pi**4 * np.outer(odd, odd) * (odd[:, None] ** 2 + odd**2)) * np.outer(signs, signs)
    assert z[side // 2, side // 2] == pytest.approx(5e-3 * weights.sum(), rel=2e-3)


def test_the_energy_of_the_pressure_in_a_bearing_converges_of_second_order():
    energies = []
    for side in (31, 63, 127):
        problem = journal_bearing(side)
        z = solve(problem).z
        cell = 2.0 * np.pi / (side + 1) * 20.0 / (side + 1)
        energies.append(cell * (0.5 * z @ (problem.M @ z) + problem.q @ z))
    first, second = np.diff(energies)
    assert 3.0 < first / second < 5.0


def test_positive_entries_off_the_diagonal_are_coarsened_by_what_is_nearly_taken_to_zero():
    assert near_null_vectors(laplacian(60)) is None
    elastic = PROBLEMS["elastic contact"](42).M
    vectors = near_null_vectors(elastic)
    assert vectors is not None
    assert vectors.shape == (elastic.shape[0], 2)
    signs = diags_array(np.where(np.arange(3600) % 3 == 0, -1.0, 1.0))
    flipped = csr_array(signs @ laplacian(60) @ signs)  # positive entries without a translation
    vectors = near_null_vectors(flipped)
    assert vectors is not None
    assert vectors.shape == (3600, 6)
    problem = LCP(flipped, np.cos(np.arange(3600.0)))
    found = solve_multigrid(problem)
    np.testing.assert_allclose(found.z, solve_block_pivoting(problem).z, atol=1e-11)


def test_answers_do_not_depend_on_what_was_drawn_at_random_before():
    problem = PROBLEMS["elastic contact"](42)
    np.random.seed(1)  # noqa: NPY002  # the state that a library might use
    first = solve_multigrid(problem).z
    np.random.seed(2)  # noqa: NPY002
    np.testing.assert_array_equal(solve_multigrid(problem).z, first)


def test_what_is_in_none_of_its_classes_is_refused_or_ends_with_the_best_point():
    with pytest.raises(InvalidInputError, match="positive diagonal"):
        solve_multigrid(LCP(csr_array((2, 2)), [1.0, 1.0]))
    M = csr_array(Tridiagonal(np.full(9, -3.0), np.ones(10), np.full(9, -3.0)).dense())
    problem = LCP(M, -np.ones(10))  # w <= -1 for the sum of all rows: no solution
    with pytest.raises(NumericalError):
        solve_multigrid(problem)
    with pytest.raises(IterationLimitError, match="callback") as caught:
        solve_multigrid(obstacle(60), callback=lambda iteration, residual: iteration == 1)
    assert natural_residual(obstacle(60), caught.value.best.z) == caught.value.best.residual
    with pytest.raises(IterationLimitError, match="time_limit"):
        solve_multigrid(obstacle(60), time_limit=1e-6)


def test_a_hierarchy_halves_the_order_and_its_cycle_is_symmetric():
    M = laplacian(60)
    hierarchy = Multigrid.of(M, None)
    orders = [level.shape[0] for level in hierarchy.matrices]
    assert all(2 * coarse <= fine for fine, coarse in pairwise(orders))
    x, y = np.random.default_rng(0).normal(size=(2, 3600))
    assert x @ (hierarchy.inverse @ y) == pytest.approx(y @ (hierarchy.inverse @ x), rel=1e-10)
    finer = hierarchy.transfers[0]
    unit = csr_array(finer.prolongation[finer.points])
    np.testing.assert_array_equal(unit.toarray(), np.eye(orders[1]))


def grid(conductivity):
    """Return the matrix of a square grid whose links conduct by the geometric means of their ends, order n."""
    n = conductivity.size
    index = np.arange(n).reshape(-1, round(n**0.5))
    one = np.concatenate([index[:-1].ravel(), index[:, :-1].ravel()])
    other = np.concatenate([index[1:].ravel(), index[:, 1:].ravel()])
    links = np.sqrt(conductivity[one] * conductivity[other])
    W = csr_array((links, (one, other)), shape=(n, n))
    W = W + W.T
    return csr_array(diags_array(np.asarray(W.sum(axis=1)).ravel()) - W)


def hard(name):
    random, n = np.random.default_rng(7), 3600
    q, membrane = random.normal(size=n), csr_array(laplacian(60) / 3721.0)
    scales = 10.0 ** random.uniform(-4.0, 4.0, n)
    contrast = np.where(random.random(n) < 0.5, 1.0, 1e8)
    return {
        "conductivities that differ by 1e8": lambda: LCP(grid(contrast) + 1e-3 * diags_array(np.ones(n)), q),
        "no boundary that holds": lambda: LCP(grid(np.ones(n)), q - q.mean() + 0.01),
        "a plate": lambda: LCP(csr_array(membrane @ membrane), q),
        "a plate between bounds": lambda: MixedLCP(csr_array(membrane @ membrane), 0.01 * q, -1.0, 1.0),
        "rows in many units": lambda: LCP(csr_array(diags_array(scales) @ membrane), scales * q),
        "rows and columns in many units": lambda: LCP(
            csr_array(diags_array(scales) @ membrane @ diags_array(scales)), scales * q
        ),
    }[name]()


@pytest.mark.parametrize(
    "name",
    [
        "conductivities that differ by 1e8",
        "no boundary that holds",
        "a plate",
        "a plate between bounds",
        "rows in many units",
        "rows and columns in many units",
    ],
)
def test_ill_conditioned_problems_are_solved(name):
    problem = hard(name)
    found = solve(problem)
    assert found.method == "multigrid"
    assert scaled_residual(problem, found.z) <= 1e-12


@pytest.mark.nightly
def test_an_indefinite_problem_ends_with_its_best_point_before_long():
    M = csr_array(laplacian(60) / 3721.0 - 0.5 * diags_array(np.ones(3600)))
    problem = LCP(M, np.cos(np.arange(3600.0)))
    with pytest.raises(IterationLimitError, match="stopped falling") as caught:
        solve_multigrid(problem)
    assert caught.value.best.residual == natural_residual(problem, caught.value.best.z) <= 1.0
