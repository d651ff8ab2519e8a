import math

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.exercise_region import (
    EMPTY_REGION,
    ExerciseRegion,
    closing_times,
    earning_region,
    region_at_expiry,
)


def limits(option, market):
    last = Book.of([(option, market)]).segments_of()[-1]
    return region_at_expiry(last, is_put=option.is_put).boundaries(option.strike, is_put=option.is_put)


@pytest.mark.parametrize(
    ("option_type", "rate", "dividend_yield", "expected"),
    [
        ("put", 0.05, 0.0, (100.0, math.nan)),
        ("put", 0.03, 0.06, (50.0, math.nan)),
        ("put", -0.02, -0.04, (100.0, 50.0)),
        ("put", 0.0, -0.04, (100.0, math.nan)),
        ("put", 0.0, 0.04, (math.nan, math.nan)),
        ("put", -0.02, 0.0, (math.nan, math.nan)),
        ("call", 0.06, 0.03, (200.0, math.nan)),
        ("call", 0.0, 0.03, (100.0, math.nan)),
        ("call", -0.04, -0.02, (100.0, 200.0)),
        ("call", 0.04, 0.0, (math.nan, math.nan)),
    ],
)
def test_limits_at_expiry(option_type, rate, dividend_yield, expected):
    """K min(1, r/q) and K max(1, r/q); [K r/q, K] for q < r < 0 and [K, K r/q] for r < q < 0."""
    found = limits(Option(option_type, 100.0, 1.0), Market(100.0, rate, 0.2, dividend_yield))
    assert found == pytest.approx(expected, nan_ok=True)


def test_the_last_piece_of_a_curve_settles_the_limit():
    market = Market(
        100.0,
        {"times": [0.5, 1.0], "values": [0.08, 0.02]},
        0.2,
        {"times": [0.5, 1.0], "values": [0.0, 0.04]},
    )
    assert limits(Option("put", 100.0, 1.0), market)[0] == pytest.approx(50.0)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_what_is_exercised_at_expiry_alone_is_exercised_wherever_it_pays(option_type):
    market = Market(100.0, 0.02, 0.2, 0.04)
    for option in (
        Option(option_type, 100.0, 1.0, "bermudan", exercise_times=(0.5, 1.0)),
        Option(option_type, 100.0, 1.0, "european"),
    ):
        assert limits(option, market) == pytest.approx((100.0, math.nan), nan_ok=True)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_where_exercise_earns_is_where_the_payoff_grows_faster_than_interest(option_type):
    """r K - q S for a put, the negative for a call, at spots where the payoff is positive."""
    rng = np.random.default_rng(1)
    for rate, dividend_yield in rng.uniform(-0.1, 0.1, (200, 2)).tolist():
        contract = Option(option_type, 1.0, 1.0), Market(1.0, rate, 0.2, dividend_yield)
        (segment,) = Book.of([contract]).segments_of()
        region = earning_region(segment, is_put=option_type == "put")
        s = np.exp(rng.uniform(-3.0, 3.0, 50))
        sign = 1.0 if option_type == "put" else -1.0
        earns = (sign * (1.0 - s) > 0.0) & (sign * (rate - dividend_yield * s) > 0.0)
        assert [region.contains(x) for x in np.log(s).tolist()] == earns.tolist()


def test_an_interval_holds_its_ends():
    region = ExerciseRegion(-0.5, 0.25)
    assert [region.contains(x) for x in (-0.51, -0.5, 0.0, 0.25, 0.26)] == [False, True, True, True, False]
    assert not EMPTY_REGION.contains(0.0)


def test_the_end_nearer_the_strike_comes_first():
    region = ExerciseRegion(math.log(0.5), math.log(0.8))
    assert region.boundaries(100.0, is_put=True) == pytest.approx((80.0, 50.0))
    assert region.boundaries(100.0, is_put=False) == pytest.approx((50.0, 80.0))
    assert EMPTY_REGION.boundaries(100.0, is_put=True) == pytest.approx((math.nan, math.nan), nan_ok=True)


@pytest.mark.parametrize("largest", [math.inf, 650.0])
def test_a_boundary_beyond_all_money_is_none(largest):
    """Spots above 1e30 are not priced, and e to more than 709 would overflow."""
    assert math.isnan(ExerciseRegion(0.0, largest).boundaries(100.0, is_put=False)[1])
    assert math.isnan(ExerciseRegion(largest, math.inf).boundaries(100.0, is_put=False)[0])


def test_a_region_closes_when_waiting_for_the_drop_is_worth_more():
    """K (1 - exp(-r t)) = D exp(-r t) + S (1 - exp(-q t)) t years before the drop, ln(1 + D/K)/r without a yield."""
    put, dividend = Option("put", 100.0, 1.0), [(0.6, 2.0)]
    plain, paying = (
        Book.of([(put, Market(70.0, 0.05, 0.2, dividend_yield, cash_dividends=dividend))])
        for dividend_yield in (0.0, 0.02)
    )
    assert closing_times(plain)[0] == pytest.approx(0.6 - math.log(1.02) / 0.05, rel=1e-12)
    waits = 0.6 - closing_times(paying)[0]
    earned = 100.0 * -math.expm1(-0.05 * waits) - 70.0 * -math.expm1(-0.02 * waits)
    assert earned == pytest.approx(2.0 * math.exp(-0.05 * waits), rel=0.01)


@pytest.mark.parametrize(
    ("option_type", "rate", "dividend"),
    [("call", 0.05, 2.0), ("put", 0.0, 2.0), ("put", -0.01, 2.0), ("put", 0.05, 0.0), ("put", 0.05, 5.0)],
)
def test_no_region_closes_where_none_was_or_nothing_is_paid_or_it_stays_closed(option_type, rate, dividend):
    market = Market(70.0, rate, 0.2, cash_dividends=[(0.6, dividend)])
    assert np.isnan(closing_times(Book.of([(Option(option_type, 100.0, 1.0), market)]))[0])
