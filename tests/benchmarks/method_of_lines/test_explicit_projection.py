import numpy as np
import pytest

from benchmarks.method_of_lines.explicit_projection import ExplicitProjection
from benchmarks.method_of_lines.stepping_methods import Method, semidiscretise, span_of
from benchmarks.problems.classic_sets import Problem, classic_problems
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import OptionState, TridiagonalStage, start_state

EXACT = Method("exact", "implicit-euler", "uniform")
PROJECTED = Method("projected", "implicit-euler", "uniform", "projection")


@pytest.fixture
def problem() -> Problem:
    (problem,) = classic_problems(("A",))
    return problem


@pytest.fixture
def semidiscrete(problem: Problem) -> tuple[SegmentForm, OptionState]:
    form, values = semidiscretise(problem, span_of(problem), 64)
    return form, start_state(form, values)


def test_projection_keeps_the_value_on_the_payoff_but_leaves_a_residual(
    semidiscrete: tuple[SegmentForm, OptionState],
) -> None:
    form, start = semidiscrete
    end = ExplicitProjection(form).solve(0.1, start.value, 0.1, start)
    exact = TridiagonalStage(form).solve(0.1, start.value, 0.1, start)
    assert np.all(end.slack >= 0.0)
    assert np.any(end.contact)
    assert np.all(end.multiplier >= 0.0)
    assert exact.residual < 1e-14
    assert end.residual > 1e-4
    assert np.all(end.value <= exact.value + 1e-15)  # exercise inside the step is missed


def test_projection_tends_to_the_exact_solution_with_first_order(problem: Problem) -> None:
    span = span_of(problem)
    differences = [
        np.max(np.abs(projected - exact))
        for steps in (32, 64, 128)
        for projected, exact in [
            [method.solve(problem, span, 64, steps).now().values for method in (PROJECTED, EXACT)]
        ]
    ]
    ratios = np.array(differences[:-1]) / np.array(differences[1:])
    assert np.all((ratios > 1.7) & (ratios < 2.3))
