from dataclasses import replace

import pytest

from benchmarks.engine_frontier import QUICK, Sizes, findings
from benchmarks.option_engine.march_scaling import MarchCost
from benchmarks.option_engine.portfolio_study import Effort, PortfolioStudy, Ratio
from benchmarks.option_engine.report import Findings, compose, goals_of
from benchmarks.option_engine.throughput import (
    ALL_GREEKS,
    CHAINS,
    GREEKS_BY_DEFAULT,
    LADDERS,
    PRICE_BY_DEFAULT,
    PRICE_ONLY,
    TWO_THREADS,
    Rate,
)
from benchmarks.option_engine.wide_set import ToleranceKept
from benchmarks.option_engine.work_precision import ENGINE, Measurement
from benchmarks.quantlib.american_engines import FINITE_DIFFERENCES, QD_FP, CallOverhead
from tests.problems.needs_kernel import needs_kernel

TINY = Sizes(
    published=4,
    everyday=3,
    wide=3,
    batch=8,
    ladders=1,
    chains=1,
    marched=4,
    effort=Effort((1e-2, 1e-3), single_rows=1, single_tolerances=(1e-3,), screened_rows=2, slow_rows=2),
)
MADE_UP = Findings(
    overhead=CallOverhead(0.3, 1.4),
    studies=(
        PortfolioStudy(
            "Made-up puts",
            contracts=20,
            left_out=1,
            measurements=(
                Measurement(ENGINE, "tolerance 1e-04", 0.5, 1e-5, 4e-5, 20, 0),
                Measurement(QD_FP, "fast", 4.0, 1e-5, 3e-5, 20, 0),
            ),
            ratios=(
                Ratio(QD_FP, 1e-5, 0.5, 4.0, 8.0, 5.8),
                Ratio(QD_FP, 2e-7, None, None, None, None),
                Ratio(FINITE_DIFFERENCES, 5e-5, 0.5, 600.0, 1200.0, 1198.0),
            ),
        ),
    ),
    kept=(ToleranceKept(1e-6, 20, 3, 1.0, 0.95, 1.0, 0.5, 0.97, 4.0, 6.0),),
    rates={
        what: Rate(what, 100, time)
        for what, time in {
            PRICE_ONLY: 2.0,
            ALL_GREEKS: 6.0,
            TWO_THREADS: 1.0,
            LADDERS: 0.4,
            CHAINS: 2.0,
            PRICE_BY_DEFAULT: 3.0,
            GREEKS_BY_DEFAULT: 9.0,
        }.items()
    },
    sharing_difference=1e-7,
    latency=250.0,
    march=(MarchCost(8, 1.0, 3.0, 1e-6, 5.0, None),),
)


def verdicts(found: Findings) -> dict[str, str]:
    return {goal.what: goal.verdict() for goal in goals_of(found)}


def test_every_goal_has_its_verdict():
    assert verdicts(MADE_UP) == {
        "Made-up puts: times as fast as QuantLib QdFp at RMSE 1e-05": (
            "missed by a factor of 1.25, the least is reached"
        ),
        "Made-up puts: times as fast as QuantLib QdFp at RMSE 2e-07": "not measured",
        "Made-up puts: times as fast as QuantLib finite differences at RMSE 5e-05": "reached",
        "spot ladders of 200 points, options per second and core": "reached",
        "chains of 100 strikes x 10 expiries, options per second and core": "missed by a factor of 2",
        "two threads against one, times as fast": "reached",
        "all Greeks against the price alone, times the cost": "reached",
        "the same at the default tolerance": "reached",
        "one warm price() with all Greeks, microseconds": "reached",
        "wide set at tolerance 1e-06: share of rows within it": "reached",
        "wide set at tolerance 1e-06: largest error of an ok row, in tolerances": "reached",
        "wide set at tolerance 1e-06: share of estimates of at least half the error": (
            "missed by a factor of 1.01"
        ),
        "wide set at tolerance 1e-06: median of estimate / error": "reached",
    }


def test_the_report_says_plainly_what_is_missed():
    summary = compose(MADE_UP).sections[0].text
    assert summary.startswith("9 of 12 measured goals are reached.")
    assert (
        "chains of 100 strikes x 10 expiries, options per second and core: 5e+05, the goal is 1e+06"
        in summary
    )
    assert "Not measured: Made-up puts: times as fast as QuantLib QdFp at RMSE 2e-07." in summary


def test_a_quick_report_says_so():
    assert compose(MADE_UP, quick=True).sections[0].text.startswith("A quick run")


def test_every_table_has_a_name():
    tables = [table for section in compose(MADE_UP).sections for table in section.tables]
    assert [table.name for table in tables] == [
        "goals",
        "made-up-puts",
        "made-up-puts-ratios",
        "wide-set",
        "throughput",
        "march",
    ]


def test_without_shared_solves_ladders_are_not_measured():
    alone = {what: rate for what, rate in MADE_UP.rates.items() if what not in {LADDERS, CHAINS}}
    report = compose(replace(MADE_UP, rates=alone, sharing_difference=None))
    assert "Shared solves are not offered by this version" in report.sections[3].text


@needs_kernel
@pytest.mark.usefixtures("without_quantlib")
def test_without_quantlib_the_report_is_on_this_project_alone_and_says_so():
    report = compose(findings(TINY))
    assert "QuantLib is not installed" in report.sections[0].text
    assert [section.title for section in report.sections] == [
        "Goals and what is reached",
        "Andersen-Lake-Offengenden puts",
        "Random puts and calls",
        "Batches, threads, Greeks, latency",
        "What limits: time steps",
        "How it was measured",
    ]
    assert not [name for name in report.results if name.endswith("-ratios")]


@pytest.fixture
def without_quantlib(monkeypatch):
    monkeypatch.setattr("benchmarks.quantlib.american_engines.AVAILABLE", False)


def test_the_quick_run_asks_for_the_whole_range_of_tolerances():
    assert min(QUICK.effort.tolerances) == 1e-8
    assert max(QUICK.effort.tolerances) == 1e-2
