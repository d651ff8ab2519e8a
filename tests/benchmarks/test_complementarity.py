import numpy as np
import pytest

from benchmarks.complementarity import run
from benchmarks.lcs.large_problems import dense_runs, sparse_runs
from benchmarks.lcs.solver_table import by_us, cells
from benchmarks.problems.complementarity_sets import (
    SetProblem,
    all_sets,
    josephy,
    kojima_shindo,
    linearised,
    two_boxes_with_parallel_joints,
)
from benchmarks.problems.sparse_complementarity import elastic_contact, obstacle
from pricing_core.lcp import LCP, MixedLCP, natural_residual, solve


@pytest.mark.parametrize(
    ("function", "solutions"),
    [
        (kojima_shindo, [(1.0, 0.0, 3.0, 0.0), (1.5**0.5, 0.0, 0.0, 0.5)]),
        (josephy, [(1.5**0.5, 0.0, 0.0, 0.5)]),
    ],
)
def test_the_published_solutions_solve_the_nonlinear_problems_and_their_linearisations(function, solutions):
    for solution in solutions:
        x = np.array(solution)
        value, jacobian = function(x)
        assert np.abs(np.minimum(x, value)).max() < 1e-14
        assert natural_residual(linearised(function, x), x) < 1e-14
        step = 1e-6
        columns = [(function(x + step * e)[0] - function(x - step * e)[0]) / (2 * step) for e in np.eye(4)]
        np.testing.assert_allclose(jacobian, np.column_stack(columns), atol=1e-8)


@pytest.mark.parametrize("name", [name for name, _ in all_sets() if name != "Siconos"])
def test_solve_answers_all_problems_of_a_set_as_far_as_their_answers_are_known(name):
    for given in dict(all_sets())[name]:
        cell = by_us(name, given, "auto")
        assert cell.verdict in {"solved"} if given.is_solvable else {"solved", "refused"}, given.name


def test_parallel_joints_carry_no_load_that_counts():
    problem = two_boxes_with_parallel_joints()
    found = solve(problem)
    assert np.linalg.matrix_rank(problem.dense()) == 3
    np.testing.assert_allclose(found.w, 0.0, atol=1e-14)


def test_verdicts_follow_from_what_is_known():
    solvable, infeasible = LCP([[1.0]], [-1.0]), LCP([[-1.0]], [-1.0])
    assert by_us("", SetProblem("", "", solvable, True), "auto").verdict == "solved"
    assert by_us("", SetProblem("", "", infeasible, False), "auto").verdict == "refused"
    assert by_us("", SetProblem("", "", infeasible, True), "auto").verdict == "wrong"
    assert by_us("", SetProblem("", "", infeasible, False), "psor").verdict == "not for it"
    assert by_us("", SetProblem("", "", infeasible, False), "murty").verdict == "not found"


def test_sparse_problems_are_measured_beside_their_peers(monkeypatch):
    monkeypatch.delenv("PRICING_SICONOS_PYTHON", raising=False)
    runs = list(sparse_runs((400,)))
    for name in ("obstacle", "tridiagonal"):
        solvers = {run.solver for run in runs if run.problem == name}
        assert solvers == {"solve", "policy iteration, SuperLU", "Clarabel"}
    assert all(run.residual is not None and run.residual < 1e-6 for run in runs)
    assert [run.solver for run in dense_runs((20,), 20)] == ["solve", "Lemke"]


def test_an_elastic_square_that_touches_nothing_moves_as_a_whole():
    problem = elastic_contact(8)
    apart = MixedLCP(problem.M, problem.q, np.where(np.isinf(problem.lower), -np.inf, -1.0), np.inf)
    z = solve(apart).z
    np.testing.assert_allclose(z[::2], 0.0, atol=1e-12)
    np.testing.assert_allclose(z[1::2], -0.05, atol=1e-12)


def test_a_membrane_rests_on_the_obstacle_and_is_in_balance_elsewhere():
    problem = obstacle(20)
    found = solve(problem)
    assert 0.02 < (found.z == 0.0).mean() < 0.5
    assert (found.w[found.z == 0.0] >= 0.0).all()


def test_a_quick_run_counts_every_verdict_and_states_what_it_measured(monkeypatch):
    monkeypatch.delenv("PRICING_SICONOS_PYTHON", raising=False)
    monkeypatch.setattr("benchmarks.complementarity.QUICK_SETS", 1)
    monkeypatch.setattr("benchmarks.complementarity.SPARSE", {True: (400,)})
    monkeypatch.setattr("benchmarks.complementarity.DENSE", {True: (30,)})
    monkeypatch.setattr("benchmarks.complementarity.DEGENERATE", {True: (20,)})
    report = run(quick=True)
    solvers, large, dense, degenerate = report.sections
    totals, problems = solvers.tables
    assert all(sum(row[1:]) == len(problems.rows) for row in totals.rows)
    assert "0 answers are wrong" in solvers.text
    assert "400\n" in large.text or "400 " in large.text
    assert "Solve finds an answer to 1 of 1 problems" in dense.text
    assert "Solve finds an answer to 3 of 3 problems" in degenerate.text


def test_cells_of_a_set_name_every_method():
    _, problems = next(all_sets())
    assert {cell.solver for cell in cells("", problems[:1])} >= {"auto", "lemke", "exact"}
