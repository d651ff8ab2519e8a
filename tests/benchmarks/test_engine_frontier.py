import pytest

from benchmarks.engine_frontier import QUICK, Sizes, findings
from benchmarks.option_engine.march_scaling import MarchCost
from benchmarks.option_engine.portfolio_study import Effort, PortfolioStudy, Ratio
from benchmarks.option_engine.report import Findings, compose
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


def test_every_finding_has_its_sentence():
    told = " ".join(compose(MADE_UP).sections[0].paragraphs)
    assert (
        "8 times QuantLib QdFp at 1e-05, 1.2e+03 times QuantLib finite differences at 5e-05 of the strike"
        in told
    )
    assert "Two threads are 2.00 times as fast as one; all Greeks cost 3.00 times the price alone" in told
    assert "takes 250 microseconds" in told
    assert "differ from those without sharing by at most 1.0e-07 of the strike" in told
    assert "97.0% of the estimates are at least half the error" in told


def test_a_quick_report_says_so():
    assert compose(MADE_UP, quick=True).sections[0].text.startswith("A quick run")


def test_every_table_has_a_name():
    assert [table.name for table in compose(MADE_UP).tables] == [
        "made-up-puts",
        "made-up-puts-ratios",
        "wide-set",
        "throughput",
        "march",
    ]


@needs_kernel
@pytest.mark.usefixtures("without_quantlib")
def test_without_quantlib_the_report_is_on_this_project_alone_and_says_so():
    report = compose(findings(TINY))
    assert "QuantLib is not installed" in report.sections[0].text
    assert [section.title for section in report.sections] == [
        "What was found",
        "Andersen-Lake-Offengenden puts",
        "Random puts and calls",
        "Batches, threads, Greeks",
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
