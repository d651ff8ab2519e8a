import numpy as np
import pytest

from benchmarks.classic_sets import Problem, classic_problems
from benchmarks.explicit_projection import ExplicitProjection, ImplicitSystem
from benchmarks.stepping_methods import Method, domain_of
from pricing_core.american.flat.grid import make_grid
from pricing_core.american.flat.semidiscrete import ValueForm
from pricing_core.american.flat.tridiagonal_step import TridiagonalStage, start_state
from pricing_core.lcp import solve

EXACT = Method("exact", "implicit-euler", "uniform")
PROJECTED = Method("projected", "implicit-euler", "uniform", peer="explicit projection")


@pytest.fixture
def problem() -> Problem:
    (problem,) = classic_problems(("A",))
    return problem


@pytest.fixture
def form(problem: Problem) -> ValueForm:
    domain = domain_of(problem)
    return ValueForm.discretise(problem.option, problem.market, domain, make_grid(domain, 64))


def test_the_complementarity_problem_is_that_of_the_engine_s_stage(form: ValueForm) -> None:
    start = start_state(form)
    expected = TridiagonalStage(form).solve(0.1, start.value, 0.1, start)
    problem = ImplicitSystem.of(form, 0.1, start.value[0], 0.1).complementarity_problem()
    assert solve(problem).z == pytest.approx(expected.slack, abs=1e-14)


def test_the_linear_solution_satisfies_the_system_without_the_payoff(form: ValueForm) -> None:
    system = ImplicitSystem.of(form, 0.1, start_state(form).value[0], 0.1)
    value = system.linear_solution()
    assert system.M.times(value) == pytest.approx(system.rhs, abs=1e-14)
    assert np.any(value < system.obstacle)


def test_projection_keeps_the_value_on_the_payoff_but_leaves_a_residual(form: ValueForm) -> None:
    start = start_state(form)
    end = ExplicitProjection(form).solve(0.1, start.value, 0.1, start)
    exact = TridiagonalStage(form).solve(0.1, start.value, 0.1, start)
    assert np.all(end.slack >= 0.0)
    assert np.all(end.multiplier >= 0.0)
    assert exact.residual < 1e-14
    assert end.residual > 1e-4
    assert np.all(end.value[0] <= exact.value[0] + 1e-15)  # exercise inside the step is missed


def test_projection_tends_to_the_exact_solution_with_first_order(problem: Problem) -> None:
    domain = domain_of(problem)
    differences = [
        np.max(np.abs(PROJECTED.solve(problem, domain, 64, steps).last.value - exact.last.value))
        for steps in (32, 64, 128)
        for exact in [EXACT.solve(problem, domain, 64, steps)]
    ]
    ratios = np.array(differences[:-1]) / np.array(differences[1:])
    assert np.all((ratios > 1.7) & (ratios < 2.3))
