"""Every solver on every named problem of its class."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from pricing_core.errors import InfeasibleError, RayTerminationError
from pricing_core.lcp import (
    LCP,
    LCPSolution,
    enumerate_solutions,
    infeasibility_certificate,
    natural_residual,
    solve,
    solve_block_pivoting,
    solve_brennan_schwartz,
    solve_double_sweep,
    solve_exact,
    solve_lemke,
    solve_multigrid,
    solve_murty,
    solve_policy_iteration,
    solve_psor,
    solve_tridiagonal_m_matrix,
)
from tests.problems.lcp_problems import INFEASIBLE, NO_SOLUTION, PROBLEMS, KnownProblem, of_class

Solver = Callable[[LCP], LCPSolution]

SOLVERS: dict[str, tuple[Solver, tuple[str, ...]]] = {
    "murty": (solve_murty, ("P",)),
    "psor, symmetric": (partial(solve_psor, relaxation=1.4), ("positive definite", "symmetric")),
    "psor, H+": (partial(solve_psor, relaxation=1.0), ("H+",)),
    "policy iteration": (solve_policy_iteration, ("M",)),
    "brennan-schwartz first": (
        partial(solve_brennan_schwartz, contact="first"),
        ("tridiagonal", "contact first"),
    ),
    "brennan-schwartz last": (
        partial(solve_brennan_schwartz, contact="last"),
        ("tridiagonal", "contact last"),
    ),
    "double sweep": (solve_double_sweep, ("tridiagonal", "one run")),
    "tridiagonal M-matrix": (solve_tridiagonal_m_matrix, ("tridiagonal", "M")),
    "multigrid, symmetric": (solve_multigrid, ("positive definite", "symmetric")),
    "multigrid, H+": (solve_multigrid, ("H+",)),
    "block pivoting": (solve_block_pivoting, ("P",)),
    "exact": (solve_exact, ("P",)),
    "solve, tridiagonal": (partial(solve, method="tridiagonal"), ("tridiagonal", "M")),
    "solve, exact": (partial(solve, method="exact"), ("P",)),
    "solve, lemke": (partial(solve, method="lemke"), ("P",)),
    "solve, murty": (partial(solve, method="murty"), ("P",)),
    "solve, psor": (partial(solve, method="psor"), ("H+",)),
    "solve, policy": (partial(solve, method="policy"), ("M",)),
    "solve, multigrid": (partial(solve, method="multigrid"), ("H+",)),
    "solve, block pivoting": (partial(solve, method="block-pivoting"), ("P",)),
}
UNIQUE_CASES = [
    pytest.param(solver, problem, id=f"{name}: {problem}")
    for name, (solver, classes) in SOLVERS.items()
    for problem in of_class(*classes)
]
LEMKE_CASES = [problem for problem in PROBLEMS if "ray" not in problem.classes]


def is_known_solution(problem: KnownProblem, solution: LCPSolution) -> bool:
    close = [np.allclose(solution.z, z, rtol=1e-12, atol=1e-12) for z in problem.isolated]
    return any(close) or (bool(problem.faces) and natural_residual(problem.lcp, solution.z) <= 1e-12)


@pytest.mark.parametrize(("solver", "problem"), UNIQUE_CASES)
def test_the_unique_solution_is_found(solver: Solver, problem: KnownProblem) -> None:
    solution = solver(problem.lcp)
    np.testing.assert_allclose(solution.z, problem.solution, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(solution.w, problem.lcp.slack(solution.z))
    assert solution.residual == natural_residual(problem.lcp, solution.z) <= 1e-9
    assert (solution.z >= 0.0).all()


@pytest.mark.parametrize("problem", LEMKE_CASES, ids=str)
def test_lemke_finds_a_solution_to_rounding(problem: KnownProblem) -> None:
    solution = solve_lemke(problem.lcp)
    assert is_known_solution(problem, solution)
    assert solution.residual <= 1e-13


@pytest.mark.parametrize("problem", PROBLEMS, ids=str)
@pytest.mark.parametrize("method", ["auto", "enumeration", "exact"])
def test_the_front_door_finds_a_solution(problem: KnownProblem, method: str) -> None:
    solution = solve(problem.lcp, method=method)  # type: ignore[arg-type]
    assert is_known_solution(problem, solution)
    assert solution.residual <= 1e-12


@pytest.mark.parametrize("problem", PROBLEMS, ids=str)
def test_enumeration_finds_exactly_the_known_solutions(problem: KnownProblem) -> None:
    found = enumerate_solutions(problem.lcp)
    n = problem.lcp.size
    points = np.array([solution.z for solution in found.isolated]).reshape(-1, n)
    np.testing.assert_allclose(points, np.reshape(problem.isolated, (-1, n)), rtol=1e-12, atol=1e-12)
    assert len(found.faces) == len(problem.faces)
    for vertices, rays in problem.faces:
        assert any(
            np.shape(vertices) == face.vertices.shape
            and np.shape(rays) == face.rays.shape
            and np.allclose(face.vertices, vertices, atol=1e-12)
            and np.allclose(face.rays, rays, atol=1e-12)
            for face in found.faces
        )


def test_lemke_ends_on_a_ray_in_the_bimatrix_game_and_says_that_nothing_is_proved() -> None:
    (problem,) = of_class("ray")
    with pytest.raises(RayTerminationError, match="proves nothing"):
        solve_lemke(problem.lcp)
    assert solve(problem.lcp).method == "exact"


@pytest.mark.parametrize("problem", INFEASIBLE, ids=str)
@pytest.mark.parametrize("method", ["auto", "lemke", "enumeration", "exact"])
def test_an_infeasible_problem_is_answered_as_such(problem: KnownProblem, method: str) -> None:
    with pytest.raises(InfeasibleError):
        solve(problem.lcp, method=method)  # type: ignore[arg-type]


@pytest.mark.parametrize("problem", INFEASIBLE, ids=str)
def test_the_certificate_of_infeasibility_holds_exactly(problem: KnownProblem) -> None:
    y = infeasibility_certificate(problem.lcp)
    assert y is not None
    # The data and these y are small integers, whose products are exact.
    assert (y >= 0.0).all()
    assert (problem.lcp.dense().T @ y <= 0.0).all()
    assert problem.lcp.q @ y < 0.0


@pytest.mark.parametrize("problem", [*PROBLEMS, *NO_SOLUTION], ids=str)
def test_a_feasible_problem_has_no_certificate_of_infeasibility(problem: KnownProblem) -> None:
    assert infeasibility_certificate(problem.lcp) is None


@pytest.mark.parametrize("problem", NO_SOLUTION, ids=str)
def test_a_feasible_problem_without_solution_is_a_ray_for_lemke_and_infeasible_by_enumeration(
    problem: KnownProblem,
) -> None:
    with pytest.raises(RayTerminationError):
        solve_lemke(problem.lcp)
    with pytest.raises(InfeasibleError, match="complete enumeration"):
        solve(problem.lcp)
    found = enumerate_solutions(problem.lcp)
    assert found.isolated == found.faces == ()
