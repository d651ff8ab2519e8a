import math
from pathlib import Path

import pytest

from benchmarks.crank_nicolson import Sizes, compare
from benchmarks.method_of_lines.accuracy import OUTPUTS
from benchmarks.method_of_lines.accuracy_study import EXTRAPOLATED, EXTRAPOLATED_METHODS, METHODS
from benchmarks.method_of_lines.order_study import StepCounts
from benchmarks.method_of_lines.report import Comparison, compose
from benchmarks.reporting.files import write_report

TINY = Sizes(
    note="A tiny run.",
    problems=("A", "Ju call 2"),
    order_problems=("A",),
    intervals=(32, 64),
    steps_per_interval=(1 / 4,),
    step_counts=StepCounts(32, (8, 16), (6, 8), 64),
    steps_for_cells=16,
    profile=(64, 8),
    solver_grids=((32, 8),),
    relaxation_grids=((32, 8),),
    relaxations=(1.0, 1.2),
    turns=1,
)


@pytest.fixture(scope="module")
def found() -> Comparison:
    return compare(TINY)


def test_every_method_is_run_at_every_setting_and_extrapolated_where_it_can_be(found: Comparison) -> None:
    settings = [(run.method, run.intervals, run.steps) for run in found.runs]
    expected = [(method.label, cells, cells // 4) for method in METHODS for cells in (32, 64)]
    assert settings == expected + [(method.label + EXTRAPOLATED, 64, 16) for method in EXTRAPOLATED_METHODS]


def test_extrapolation_pays_for_both_of_its_solves(found: Comparison) -> None:
    label = EXTRAPOLATED_METHODS[0].label
    coarse, fine = (run for run in found.runs if run.method == label)
    (both,) = (run for run in found.runs if run.method == label + EXTRAPOLATED)
    assert both.node_steps == coarse.node_steps + fine.node_steps
    assert both.milliseconds == pytest.approx(coarse.milliseconds + fine.milliseconds)
    assert both.errors["boundary"] == fine.errors["boundary"]


def test_every_run_has_work_time_and_every_error(found: Comparison) -> None:
    for run in found.runs:
        assert run.node_steps > 0.0
        assert run.milliseconds > 0.0
        assert all(0.0 < run.errors[name].rmse <= run.errors[name].largest < math.inf for name in OUTPUTS)


def test_the_report_has_its_sections_and_files(found: Comparison, tmp_path: Path) -> None:
    report = compose(found)
    assert [section.title for section in report.sections] == [
        "Where each method wins",
        "Error against work",
        "Uniform, square-root and adaptive steps",
        "What averages hide: gamma and the boundary",
        "Exact complementarity and explicit projection",
        "How it was measured",
        "All measurements",
    ]
    assert report.sections[0].paragraphs[0] == "A tiny run."
    files = {path.name for path in write_report(report, tmp_path)}
    assert {"crank-nicolson.json", "crank-nicolson.md", "crank-nicolson.html"} < files
    assert {path.suffix for path in tmp_path.iterdir()} == {".json", ".md", ".html", ".png"}


def test_the_sections_say_what_their_tables_hold(found: Comparison) -> None:
    report = compose(found)
    assert {"winners", "solves-needed", "orders-in-time", "profiles", "solvers", "relaxation", "runs"} < set(
        report.results
    )
    (text,) = (" ".join(part.paragraphs) for part in report.sections if "explicit projection" in part.title)
    fewest = min(found.relaxation, key=lambda run: run.sweeps)
    assert "On 32 cells one step costs" in text
    assert f"{fewest.sweeps:.0f} a step, with the relaxation parameter {fewest.relaxation:g}" in text
