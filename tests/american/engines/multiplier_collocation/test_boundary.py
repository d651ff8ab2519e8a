import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, exercise_boundary, price
from pricing_core.american.contracts.schedule import make_schedule
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts

pytestmark = needs_kernel


@pytest.mark.parametrize(
    ("seed", "count"), [(11, 60), pytest.param(12, 600, marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_boundaries_converge_as_told_whatever_the_events(seed, count):
    errors, stated = [], []
    for option, market in random_contracts(seed, count):
        ends = [segment.end for segment in make_schedule(option, market).segments]
        times = np.unique([0.0, *ends, *np.convolve([0.0, *ends], [0.5, 0.5], "valid")])
        rough, close = (exercise_boundary(option, market, times, tolerance=t) for t in (1e-6, 1e-8))
        sure = np.isfinite(rough.boundary) & np.isfinite(rough.error_estimate)
        sure &= np.isfinite(close.boundary) & np.isfinite(close.error_estimate)
        errors += (np.abs(rough.boundary - close.boundary) / close.boundary)[sure].tolist()
        stated += (rough.error_estimate / rough.boundary)[sure].tolist()
    assert len(errors) > 3 * count
    assert np.quantile(errors, 0.99) < 1e-4
    assert max(errors) < 2e-2
    assert np.mean(np.array(errors) <= np.array(stated) + 1e-5) > 0.995


def test_a_boundary_many_deviations_off_is_found_where_it_may_still_be_reached_by_expiry():
    dividends = [CashDividend(time, 0.5) for time in (0.08, 0.33, 0.58, 0.83)]
    market = Market(108.0, rate=0.034, volatility=0.156, dividend_yield=0.026, cash_dividends=dividends)
    option = Option("call", strike=100.0, expiry=2.0)
    boundary = exercise_boundary(option, market, times=[0.0]).boundary[0]
    assert 130.0 < boundary < 150.0
    for spot, exercised in [(boundary * 0.999, False), (boundary * 1.001, True)]:
        value = price(option, Market(spot, 0.034, 0.156, 0.026, dividends), tolerance=1e-8, greeks="none")
        assert value.exercise_now == exercised
