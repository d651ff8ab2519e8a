"""Claims of proof against rational arithmetic over all complementary cells, and what rational Lemke adds."""

import numpy as np
import pytest

from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError
from pricing_core.lcp import LCP, enumerate_solutions, scaled_residual, solve, solve_lemke
from tests.lcp.rational_reference import lcp_has_solution


def test_two_opposite_rows_are_solved_at_every_ratio() -> None:
    """z = (1/a, 0), or (1, 0): the sum of the rows is zero, so that all solutions have w = 0."""
    for a in np.concatenate([np.arange(1, 1000, 37), np.arange(1, 1000, 41) / 1000.0]):
        for M in ([[-a, 1.0], [a, -1.0]], [[-1.0, a], [1.0, -a]]):
            problem = LCP(M, [1.0, -1.0])
            assert scaled_residual(problem, solve(problem).z) <= 1e-14


def test_no_proof_is_claimed_where_there_is_a_solution_and_none_is_missed() -> None:
    """Rank-deficient matrices with rows and columns in powers of two, nearly singular ones among them."""
    counts = {True: 0, False: 0}
    for seed in range(80):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 5))
        M = random.integers(-3, 4, (n, n)).astype(float)
        if n > 1 and random.random() < 0.7:
            M[-1] = random.integers(-2, 3) * M[0]
        if random.random() < 0.3:
            M[0, 0] += 2.0**-40
        row, column = 2.0 ** random.integers(-20, 21, (2, n))
        problem = LCP(row[:, None] * M * column, row * random.integers(-3, 4, n))
        solvable = lcp_has_solution(problem.dense(), problem.q)
        counts[solvable] += 1
        for method in ("auto", "exact", "enumeration"):
            if solvable:
                found = solve(problem, method=method)  # type: ignore[arg-type]
                assert scaled_residual(problem, found.z) <= 1e-10
            elif method == "exact":
                with pytest.raises(InfeasibleError):
                    solve(problem, method=method)
            else:  # a point may solve the problem to rounding
                try:
                    found = solve(problem, method=method)  # type: ignore[arg-type]
                    assert scaled_residual(problem, found.z) <= 1e-10
                except InfeasibleError:
                    pass
        if solvable:
            try:
                solve_lemke(problem)
            except InfeasibleError:
                pytest.fail("a proof is claimed where there is a solution")
            except NumericalError:
                pass
    assert min(counts.values()) > 15


@pytest.mark.parametrize("exponent", [10, 20, 30, 40, 50])
@pytest.mark.parametrize("method", ["auto", "exact", "enumeration"])
def test_nearly_singular_positive_definite_problems_are_solved(exponent: int, method: str) -> None:
    e = 2.0**-exponent  # [[1, -1], [-1, 1 + e]] z = (1, -1/2) has z = (1 + 1 / (2 e), 1 / (2 e))
    problem = LCP([[1.0, -1.0], [-1.0, 1.0 + e]], [-1.0, 0.5])
    found = solve(problem, method=method)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.z, [1.0 + 0.5 / e, 0.5 / e], rtol=1e-12)


def test_a_p_matrix_whose_path_rounding_turns_to_a_ray_is_solved() -> None:
    M = [[2.000000000003, -1, -3], [-1, 1.000000000002, 0], [-3, 0, 9.000000000003]]
    problem = LCP(M, (-3, -3, 1))
    assert scaled_residual(problem, solve(problem).z) <= 1e-15


@pytest.mark.parametrize("n", [5, 20, 40])
def test_rational_lemke_agrees_with_floating_point_on_p_matrices(n: int) -> None:
    random = np.random.default_rng(n)
    A, B = random.normal(size=(2, n, n))
    problem = LCP(A @ A.T + B - B.T + 0.1 * np.eye(n), random.normal(size=n))
    exact = solve(problem, method="exact")
    assert exact.method == "exact"
    np.testing.assert_allclose(exact.z, solve_lemke(problem).z, rtol=1e-8, atol=1e-10)


def test_exact_arithmetic_ends_at_order_sixty_and_at_the_range_of_floats() -> None:
    with pytest.raises(InvalidInputError, match="61"):
        solve(LCP(np.eye(61), np.ones(61)), method="exact")
    for method in ("auto", "exact"):
        with pytest.raises(NumericalError, match="range of floating-point numbers"):
            solve(LCP([[1e-300, 0.0], [0.0, 1.0]], [-1e300, -1.0]), method=method)  # type: ignore[arg-type]


def test_a_solution_far_below_the_others_in_size_is_enumerated() -> None:
    M = [[0, -0.001, 0.1], [0, -10, 100], [0.0001, 0.002, 0.0002]]
    found = enumerate_solutions(LCP(M, [20000, 0.2, 0.0002]))
    assert [solution.z.tolist() for solution in found.isolated] == [[0, 0, 0], [0, 0.02, 0]]
    assert found.complete


def test_an_enumeration_says_complete_and_misses_nothing() -> None:
    """Every cell that holds a solution, at any scale of the rows and columns, holds one of those found."""
    for seed in range(30):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 5))
        M = random.integers(-3, 4, (n, n)).astype(float)
        row, column = 2.0 ** random.integers(-15, 16, (2, n))
        problem = LCP(row[:, None] * M * column, row * random.integers(-3, 4, n))
        found = enumerate_solutions(problem)
        assert found.complete
        assert bool(found.isolated or found.faces) == lcp_has_solution(problem.dense(), problem.q)
