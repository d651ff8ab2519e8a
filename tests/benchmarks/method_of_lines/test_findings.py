import math

import pytest

from benchmarks.method_of_lines.accuracy import OUTPUTS, Error
from benchmarks.method_of_lines.accuracy_study import CRANK_NICOLSON_METHODS, LCS_METHODS, Run
from benchmarks.method_of_lines.findings import LCS, Best, Verdict, best, verdicts, winner_sentences

SDIRK2, NICOLSON = LCS_METHODS[1].label, CRANK_NICOLSON_METHODS[2].label


def run(method: str, milliseconds: float, error: float) -> Run:
    return Run(
        method, 64, 16, 1000.0 * milliseconds, milliseconds, {name: Error(error, error) for name in OUTPUTS}
    )


RUNS = [run(SDIRK2, 1.0, 1e-3), run(SDIRK2, 10.0, 1e-5), run(NICOLSON, 2.0, 1e-3), run(NICOLSON, 8.0, 1e-4)]


def test_the_best_method_is_the_cheapest_that_reaches_the_error() -> None:
    assert best(RUNS, "price", 1e-3, LCS, lambda run: run.milliseconds) == Best(SDIRK2, 1.0)
    assert best(RUNS, "price", 1e-7, LCS, lambda run: run.milliseconds) == Best()


def test_verdicts_compare_the_best_of_either_family_by_the_cost_asked_for() -> None:
    by_work = {
        (verdict.output, verdict.rmse): verdict for verdict in verdicts(RUNS, lambda run: run.node_steps)
    }
    assert by_work["price", 1e-3].ratio == pytest.approx(2.0)
    between = by_work["price", 1e-4]
    assert between.lcs.cost == pytest.approx(1000.0 * math.sqrt(10.0))
    assert by_work["price", 1e-5].crank_nicolson == Best()
    assert by_work["price", 1e-5].ratio is None


def test_who_wins_is_said_for_every_output() -> None:
    found = [
        Verdict("price", 1e-3, Best(SDIRK2, 3.0), Best(NICOLSON, 1.5)),
        Verdict("price", 1e-4, Best(SDIRK2, 3.0), Best(NICOLSON, 3.1)),
        Verdict("price", 1e-5, Best(SDIRK2, 3.0), Best()),
        Verdict("price", 1e-6, Best(), Best()),
        Verdict("delta", 1e-3, Best(SDIRK2, 1.0), Best(NICOLSON, 2.5)),
    ]
    price, delta, *_ = winner_sentences(found)
    assert price == (
        "Price: at 1e-03 Crank-Nicolson is 2 times as fast; at 1e-04 both are even; "
        "at 1e-05 only the LCS method of lines gets there; at 1e-06 neither gets there."
    )
    assert delta == "Delta: at 1e-03 the LCS method of lines is 2.5 times as fast."
