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
