import math

import pytest

from benchmarks.method_of_lines.accuracy import OUTPUTS, Error
from benchmarks.method_of_lines.accuracy_study import CRANK_NICOLSON_METHODS, LCS_METHODS, Run
from benchmarks.method_of_lines.findings import (
    Best,
    Verdict,
    best,
    mesh_sentence,
    projection_sentences,
    relaxation_sentences,
    verdicts,
    winner_sentences,
)
from benchmarks.method_of_lines.lcp_study import ELIMINATION, PROJECTION, RelaxationRun, SolverRun
from benchmarks.method_of_lines.order_study import Level, Refinement

SDIRK2, NICOLSON = LCS_METHODS[1].label, CRANK_NICOLSON_METHODS[2].label


def run(method: str, milliseconds: float, error: float) -> Run:
    return Run(
        method, 64, 16, 1000.0 * milliseconds, milliseconds, {name: Error(error, error) for name in OUTPUTS}
    )


RUNS = [run(SDIRK2, 1.0, 1e-3), run(SDIRK2, 10.0, 1e-5), run(NICOLSON, 2.0, 1e-3), run(NICOLSON, 8.0, 1e-4)]


def test_the_best_method_is_the_cheapest_that_reaches_the_error() -> None:
    assert best(RUNS, "price", 1e-3, {SDIRK2, NICOLSON}, lambda run: run.milliseconds) == Best(SDIRK2, 1.0)
    assert best(RUNS, "price", 1e-7, {SDIRK2, NICOLSON}, lambda run: run.milliseconds).cost is None


def test_verdicts_compare_the_best_of_either_family_by_the_cost_asked_for() -> None:
    by_work = {
        (verdict.output, verdict.rmse): verdict for verdict in verdicts(RUNS, lambda run: run.node_steps)
    }
    assert by_work["price", 1e-3].ratio == pytest.approx(2.0)
    between = by_work["price", 1e-4]
    assert between.lcs.cost == pytest.approx(1000.0 * math.sqrt(10.0))
    assert by_work["price", 1e-5].crank_nicolson == Best(None, None)
    assert by_work["price", 1e-5].ratio is None


def test_who_wins_is_said_for_every_output() -> None:
    found = [
        Verdict("price", 1e-3, Best(SDIRK2, 3.0), Best(NICOLSON, 1.5)),
        Verdict("price", 1e-4, Best(SDIRK2, 3.0), Best(NICOLSON, 3.1)),
        Verdict("price", 1e-5, Best(SDIRK2, 3.0), Best(None, None)),
        Verdict("price", 1e-6, Best(None, None), Best(None, None)),
        Verdict("delta", 1e-3, Best(SDIRK2, 1.0), Best(NICOLSON, 2.5)),
    ]
    price, delta, *_ = winner_sentences(found)
    assert price == (
        "Price: at 1e-03 Crank-Nicolson is 2 times as fast; at 1e-04 both are even; "
        "at 1e-05 only the LCS method of lines gets there; at 1e-06 neither gets there."
    )
    assert delta == "Delta: at 1e-03 the LCS method of lines is 2.5 times as fast."


def refinement(method: str, errors: tuple[float, ...]) -> Refinement:
    return Refinement(
        method,
        tuple(
            Level(10.0 * 2**k, {name: Error(error, error) for name in OUTPUTS})
            for k, error in enumerate(errors)
        ),
    )


def test_step_meshes_are_compared_by_the_solves_they_need() -> None:
    refinements = [
        refinement("SDIRK2, uniform steps", (1e-4, 1e-5)),
        refinement("SDIRK2, square-root steps", (1e-5, 1e-6)),
        refinement("SDIRK2, adaptive steps", (1e-5, 1e-6, 1e-7)),
    ]
    assert mesh_sentence(refinements, "SDIRK2", "price") == (
        "SDIRK2 needs this many solves for an error of 1e-06 of price: 20 with square-root steps, "
        "more than were tried with uniform steps, 20 with adaptive steps."
    )


def test_projection_and_relaxation_are_held_against_elimination() -> None:
    solvers = [
        SolverRun(ELIMINATION, 64, 16, 2.0, 1.0, 0.0, 0.0),
        SolverRun(PROJECTION, 64, 16, 3.0, 1.0, 1e-3, 1e-3),
    ]
    exact, projected = CRANK_NICOLSON_METHODS[1].label, CRANK_NICOLSON_METHODS[0].label
    runs = [run(exact, 1.0, 1e-4), run(projected, 4.0, 1e-4)]
    orders = [refinement(exact, (4e-4, 1e-4)), refinement(projected, (2e-4, 1e-4))]
    sentences = " ".join(projection_sentences(solvers, runs, orders))
    assert "On 64 cells one step costs 2 microseconds by elimination" in sentences
    assert "1.0 with projection and 2.0 with the exact problem" in sentences
    assert "For a price error of 1e-04 projection takes 4 times as long." in sentences
    sweeps = [RelaxationRun(64, 16, omega, count, count) for omega, count in ((1.0, 40.0), (1.3, 20.0))]
    assert relaxation_sentences(sweeps, solvers) == [
        "PSOR needs the fewest sweeps on 64 cells, 20 a step, with the relaxation parameter 1.3.",
        "It then takes 10 times as long as elimination.",
    ]
