import math

import pytest

from benchmarks.cost_scaling import Law, run
from benchmarks.problems.cost_sweeps import BOOKS
from benchmarks.problems.random_contracts import rows_of
from benchmarks.reporting.report import Report
from tests.problems.needs_kernel import needs_kernel


@pytest.fixture(scope="module")
def report() -> Report:
    return run(quick=True)


def test_the_power_is_that_of_the_larger_half() -> None:
    law = Law("steps", (1.0, 10.0, 100.0, 1000.0), (5.0, 1.0, 100.0, 10_000.0))
    assert law.power == pytest.approx(2.0)


@pytest.mark.nightly  # `make benchmark` measures the same
@needs_kernel
def test_every_law_has_an_exponent_and_every_sweep_its_largest_jump(report: Report) -> None:
    laws, jumps, books = report.tables
    exponents = {row["parameter"]: row["exponent"] for row in laws.records}
    assert len(exponents) == 7
    assert "rows per call" in exponents
    assert all(isinstance(power, float) and math.isfinite(power) for power in exponents.values())
    assert {row["along"] for row in jumps.records} >= {"rate, 4 dividends", "years between two dividends"}
    assert {row["book"] for row in books.records} == set(BOOKS)


def test_books_are_the_same_at_every_call() -> None:
    for kind in BOOKS.values():
        assert rows_of(kind, 2) == rows_of(kind, 2)
