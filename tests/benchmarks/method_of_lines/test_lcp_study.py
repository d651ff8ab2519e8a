import pytest

from benchmarks.method_of_lines.lcp_study import (
    ELIMINATION,
    LEMKE,
    PROJECTION,
    SOLVERS,
    compare_solvers,
    sweep_relaxation,
)
from benchmarks.problems.classic_sets import Problem, classic_problems


@pytest.fixture
def problem() -> Problem:
    (problem,) = classic_problems(("A",))
    return problem


def test_exact_solvers_agree_in_all_steps_and_projection_does_not(problem: Problem) -> None:
    runs = compare_solvers(problem, [(32, 8)], turns=1)
    assert [run.solver for run in runs] == list(SOLVERS)
    for run in runs:
        exact = run.solver != PROJECTION
        assert (run.difference < 1e-11) == exact
        assert (run.residual < 1e-11) == exact
        assert run.microseconds > 0.0


def test_lemke_is_left_out_on_fine_grids(problem: Problem) -> None:
    solvers = [run.solver for run in compare_solvers(problem, [(300, 4)], turns=1)]
    assert LEMKE not in solvers
    assert ELIMINATION in solvers


def test_relaxation_saves_sweeps_up_to_a_point(problem: Problem) -> None:
    runs = sweep_relaxation(problem, [(64, 16)], (1.0, 1.3, 1.9), turns=1)
    plain, relaxed, over = (run.sweeps for run in runs)
    assert relaxed < plain < over
