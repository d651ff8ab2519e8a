import numpy as np
import pytest

from benchmarks.method_of_lines.accuracy import Error, errors, extrapolated, outputs_of
from benchmarks.method_of_lines.stepping_methods import Method, span_of
from benchmarks.problems.classic_sets import Outputs, Problem, classic_problems
from pricing_core.american import Resolution, price


@pytest.fixture
def problem() -> Problem:
    (problem,) = classic_problems(("A",))
    return problem


@pytest.mark.parametrize(
    ("method", "solves"),
    [
        (Method("", "implicit-euler", "uniform"), 8),
        (Method("", "implicit-euler", "square-root", "projection"), 8),
        (Method("", "sdirk2", "square-root", "cell"), 16),
        (Method("", "crank-nicolson", "square-root"), 10),
        (Method("", "crank-nicolson", "uniform", "projection"), 10),
        (Method("", "crank-nicolson", "uniform", damped=False), 8),
    ],
)
def test_eight_prescribed_steps_take_this_many_implicit_solves(
    problem: Problem, method: Method, solves: int
) -> None:
    solution = method.solve(problem, span_of(problem), 32, 8)
    assert solution.integration.accepted == 8
    assert method.implicit_solves(solution) == solves


def test_step_doubling_is_counted_threefold(problem: Problem) -> None:
    method = Method("", "sdirk2", "adaptive")
    solution = method.solve(problem, span_of(problem), 32, 8)
    attempts = solution.integration.accepted + solution.integration.rejected
    assert method.implicit_solves(solution) == 6 * attempts


def test_a_method_finds_what_the_engine_finds_at_that_resolution(problem: Problem) -> None:
    found = outputs_of(
        Method("", "sdirk2", "square-root", "cell").solve(problem, span_of(problem), 128, 32), problem
    )
    valuation = price(
        problem.option,
        problem.market,
        method="lcs",
        resolution=Resolution(128, 32),
        tolerance=1e-3,
    )
    (at_strike,) = [i for i, spot in enumerate(problem.spots) if spot == 1.0]
    assert found.price[at_strike] == pytest.approx(valuation.price, abs=2e-5)
    assert found.delta[at_strike] == pytest.approx(valuation.delta, abs=2e-4)


@pytest.mark.parametrize("name", ["A", "D", "Ju call 2"])
def test_every_output_is_near_its_true_value(name: str) -> None:
    (problem,) = classic_problems((name,))
    solution = Method("", "sdirk2", "square-root", "cell").solve(problem, span_of(problem), 256, 64)
    measured = errors([outputs_of(solution, problem)], [problem.true])
    for output, allowed in {"price": 5e-5, "delta": 1e-4, "gamma": 5e-3, "boundary": 1e-3}.items():
        assert measured[output].largest < allowed


def outputs(price: float, gamma: float, boundary: float) -> Outputs:
    return Outputs(np.array([price, 0.0]), np.zeros(1), np.array([gamma, 2.0]), np.array([boundary]))


def test_errors_are_root_mean_square_and_largest_and_the_boundary_s_is_relative() -> None:
    measured = errors([outputs(3.0, 1.0, 5.5)], [outputs(0.0, 1.5, 5.0)])
    assert measured["price"] == pytest.approx(Error((9.0 / 2.0) ** 0.5, 3.0))
    assert measured["boundary"] == pytest.approx(Error(0.1, 0.1))


def test_what_has_no_reference_is_not_compared() -> None:
    assert errors([outputs(0.0, 1.0, 1.0)], [outputs(0.0, np.nan, 1.0)])["gamma"] == Error(0.0, 0.0)


def test_an_output_that_was_not_found_is_an_error_that_shows() -> None:
    assert np.isnan(errors([outputs(0.0, 1.0, np.nan)], [outputs(0.0, 1.0, 1.0)])["boundary"].rmse)


def test_extrapolation_removes_an_error_that_falls_fourfold_and_leaves_the_boundary() -> None:
    combined = extrapolated(outputs(1.4, 0.8, 7.0), outputs(1.1, 0.95, 6.0))
    assert combined.price[0] == pytest.approx(1.0)
    assert combined.gamma[0] == pytest.approx(1.0)
    assert combined.boundary[0] == 6.0
