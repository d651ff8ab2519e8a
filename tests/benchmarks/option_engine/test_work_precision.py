import numpy as np
import pytest

from benchmarks.measuring.timing import Task
from benchmarks.option_engine.work_precision import (
    CRANK_NICOLSON,
    ENGINE,
    LCS_PATH,
    Method,
    engine_methods,
    measure,
    points,
    single_methods,
)
from benchmarks.problems.portfolios import everyday


def method(prices: list[float], rows: list[int], overhead: float = 0.0) -> Method:
    return Method("family", "setting", Task((list,)), lambda: np.array(prices), np.array(rows), overhead)


def test_errors_are_those_of_the_rows_that_were_priced():
    reference = np.array([0.5, 0.25, 0.125])
    (measured,) = measure([method([0.5, 0.225], [0, 2])], reference, turns=1)
    assert measured.contracts == 2
    assert measured.largest_error == pytest.approx(0.1)
    assert measured.rmse == pytest.approx(0.1 / np.sqrt(2.0))


def test_a_method_that_misses_rows_gives_no_point():
    (measured,) = measure([method([np.nan, 0.25], [0, 1])], np.array([0.5, 0.25]), turns=1)
    assert measured.missing == 1
    assert points([measured], "family") == ()


def test_the_overhead_is_taken_off_every_row():
    (measured,) = measure([method([0.5, 0.5], [0, 1], overhead=1e6)], np.array([0.5, 0.5]), turns=1)
    assert measured.microseconds == pytest.approx(-1e6, rel=0.01)


def test_this_projects_methods_price_the_same_contracts():
    contracts = everyday(4)
    rows = contracts.sample(2)
    methods = (*engine_methods(contracts, [1e-3, 1e-4]), *single_methods(contracts, rows, [1e-3]))
    assert [one.family for one in methods] == [ENGINE, ENGINE, LCS_PATH, CRANK_NICOLSON]
    fine = methods[1].prices()
    for one in methods:
        assert np.abs(one.prices() - fine[one.rows]).max() < 2e-3
