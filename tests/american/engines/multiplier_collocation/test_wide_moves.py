"""Dividends that move the spot by thousands of its standard deviations: the interval is not filled with panels."""

import math

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    ProportionalDividend,
    exercise_boundary,
    price,
)
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel


@pytest.mark.parametrize("seed", range(12))
def test_puts_without_interest_are_worth_what_the_dividends_leave(seed: int) -> None:
    rng = np.random.default_rng(seed)
    expiry = float(rng.uniform(0.1, 1.0))
    proportions = rng.uniform(0.3, 0.95, 3)
    dividends = [
        ProportionalDividend(time=float(time), fraction=float(share))
        for time, share in zip(np.sort(rng.uniform(0.05, 0.95, 3)) * expiry, proportions, strict=True)
    ]
    volatility = math.exp(rng.uniform(math.log(1e-4), math.log(2e-3)))
    option = Option("put", strike=1e5, expiry=expiry)
    market = Market(spot=1e5, rate=0.0, volatility=volatility, proportional_dividends=dividends)
    found = price(option, market, greeks="none", tolerance=1e-6)
    # Without interest waiting costs nothing, and after the dividends the put is so deep that it is its intrinsic value.
    left = 1e5 * float(np.prod(1.0 - proportions))
    assert found.status == "ok"
    assert found.price == pytest.approx(1e5 - left, abs=1e-6 * 1e5)
    boundary = exercise_boundary(option, market, tolerance=1e-6)
    # Who exercises before the first dividend gives away the fall of the spot.
    before = boundary.boundary[boundary.time < dividends[0].time]
    assert np.all(np.isnan(before) | (before < 1.0))


@pytest.mark.parametrize("seed", range(4))
def test_dividends_that_take_the_spot_many_times_over_are_left_to_another_engine(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, 1.0, 366)).tolist()
    option, rate = Option("put", strike=100.0, expiry=1.0), -0.5
    market = Market(1.0, rate, 0.2, cash_dividends=[CashDividend(time, 30.0) for time in times])
    found = price(option, market, greeks="none", tolerance=1e-4)
    # The first dividend takes the spot to nothing but for a negligible chance, and at this rate waiting pays.
    assert found.method != "multiplier-collocation"
    assert found.price == pytest.approx(100.0 * math.exp(-rate), abs=1e-2)
