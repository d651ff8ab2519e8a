import itertools

import numpy as np
import pytest

from pricing_core.errors import StepSizeError
from pricing_core.lcp import solve
from pricing_core.lcs import LCS, one_step_problem


def test_matrix_of_the_step_is_the_transfer_matrix_at_one_over_h():
    rng = np.random.default_rng(3)
    A, B, C, D = (rng.standard_normal(s) for s in ((4, 4), (4, 2), (2, 4), (2, 2)))
    system = LCS(A, B, C, D)
    h = 0.05
    G = D + C @ np.linalg.solve(np.eye(4) / h - A, B)
    assert pytest.approx(G, abs=1e-12) == one_step_problem(system, h).M


def test_the_solution_satisfies_the_three_equations_of_the_step():
    """(11.65a)-(11.65c), with inputs."""
    A, B, C, D = [[-1.0, 1.0], [0.0, -2.0]], np.eye(2), np.eye(2), np.zeros((2, 2))
    f, g, h = np.array([-9.0, 1.0]), np.array([0.5, -0.2]), 0.1
    x = np.array([0.1, 0.4])
    problem = one_step_problem(LCS(A, B, C, D, f, g), h)
    free = problem.free_state(x, h)
    solution = solve(problem.lcp(free, h))
    after = free + problem.response @ solution.z
    assert (after - x) / h == pytest.approx(A @ after + B @ solution.z + f, abs=1e-12)
    assert solution.w == pytest.approx(C @ after + g, abs=1e-12)
    assert np.all(solution.z >= 0)
    assert np.all(solution.w >= -1e-15)
    assert solution.z @ solution.w == pytest.approx(0.0, abs=1e-15)
    assert solution.z.max() > 0


def test_a_step_for_which_the_matrix_is_singular_is_refused():
    with pytest.raises(StepSizeError, match="take another step"):
        one_step_problem(LCS([[2.0]], [[1.0]], [[1.0]]), 0.5)


@pytest.mark.parametrize("seed", range(40))
def test_the_step_in_a_known_mode_is_the_solution_of_its_problem(seed):
    """Random passive systems in units up to 1e4 apart, and every mode offered."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    S, C, K = rng.normal(size=(n, n)), rng.normal(size=(k, n)), rng.normal(size=(k, k))
    x, u = 10.0 ** rng.uniform(-4.0, 4.0, n), 10.0 ** rng.uniform(-4.0, 4.0, k)
    A = (S - S.T - rng.uniform(0.0, 2.0) * np.eye(n)) * x / x[:, None]
    B, C, D = C.T * u / x[:, None], C * x * u[:, None], (K - K.T + np.eye(k)) * u * u[:, None]
    f, g = rng.normal(size=n) / x, rng.normal(size=k) * u
    h = 10.0 ** rng.uniform(-4.0, -1.0)
    problem = one_step_problem(LCS(A, B, C, D, f, g), h)
    base = rng.normal(size=n) / x
    free = problem.free_state(base, h)
    solution = solve(problem.lcp(free, h))
    met = 0
    for count in range(k + 1):
        for index in itertools.combinations(range(k), count):
            mode = np.isin(np.arange(k), index)
            found = problem.solved_in(mode, base, h)
            if found is None:
                assert not np.array_equal(mode, solution.z > 0.0)
                continue
            met += 1
            after, held, slack = found
            assert held * u == pytest.approx(
                solution.z * u, rel=1e-9, abs=1e-9 * float(np.abs(held * u).max())
            )
            size = (
                np.abs(after) + np.abs(base) + h * (np.abs(A) @ np.abs(after) + np.abs(B) @ held + np.abs(f))
            )
            assert (np.abs(after - base - h * (A @ after + B @ held + f)) <= 1e-11 * size).all()
            terms = np.abs(C) @ np.abs(after) + np.abs(D) @ held + np.abs(g)
            assert (np.abs(C @ after + D @ held + g - slack) <= 1e-11 * terms).all()
            assert held.min() >= 0.0
            assert slack.min() >= 0.0
            assert not (held * slack).any()
    assert met == 1


def test_a_step_whose_matrix_is_nearly_singular_is_left_to_its_problem():
    everything = np.ones(2, dtype=bool)
    for D, known in ((np.eye(2), True), ([[1.0, 1.0], [1.0, 1.00001]], False)):
        system = LCS(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)), D, g=[-1.0, -1.0])
        assert (one_step_problem(system, 0.1).solved_in(everything, np.zeros(2), 0.0) is not None) == known
