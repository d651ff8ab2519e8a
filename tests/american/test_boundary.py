import itertools
import math

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
    price,
)
from pricing_core.american.engines.perpetual import perpetual_boundary
from pricing_core.errors import InvalidInputError, NumericalError
from tests.problems.needs_kernel import needs_kernel
from tests.problems.true_values import true_boundaries


def perpetual_level(market, option_type):
    """Return S*/K of the option without expiry."""
    numbers = {"rate": market.rate, "dividend_yield": market.dividend_yield, "volatility": market.volatility}
    return perpetual_boundary(is_put=option_type == "put", **numbers)


@pytest.mark.parametrize("case", true_boundaries(), ids=lambda case: case.name)
def test_boundary_is_within_1e_3_of_the_true_one(case):
    times = [case.option.expiry - tau for tau in reversed(case.time_to_expiry)]
    found = exercise_boundary(case.option, case.market, times).boundary
    expected = np.array(case.boundary[::-1])
    assert np.max(np.abs(found / expected - 1.0)) <= 1e-3 + case.reference_error / expected.min()
    assert np.max(np.abs(found / expected - 1.0)) <= 5e-4 + case.reference_error / expected.min()


@pytest.mark.parametrize(("rate", "dividend_yield"), [(0.05, 0.0), (0.05, 0.02), (0.03, 0.07), (0.05, -0.02)])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_boundary_starts_at_its_limit_and_stays_beyond_the_perpetual_level(option_type, rate, dividend_yield):
    """Limits K min(1, r/q) and K max(1, r/q); K where the other rate is not positive."""
    if option_type == "call":
        rate, dividend_yield = dividend_yield, rate
    option, market = Option(option_type, 100.0, 2.0), Market(100.0, rate, 0.25, dividend_yield)
    found = exercise_boundary(option, market)
    ratio = rate / dividend_yield if rate > 0 and dividend_yield > 0 else 1.0
    limit = 100.0 * (min(1.0, ratio) if option_type == "put" else max(1.0, ratio))
    assert found.time[0] == 0.0
    assert found.time[-1] == option.expiry
    assert found.boundary[-1] == pytest.approx(limit, rel=1e-12)
    direction = 1.0 if option_type == "put" else -1.0
    assert np.all(direction * np.diff(found.boundary) > -1e-4 * limit)
    assert np.all(direction * (found.boundary - 100.0 * perpetual_level(market, option_type)) > 0)
    assert found.other_boundary is None


def test_put_and_call_boundaries_are_reciprocal():
    """S*_call(r, q) S*_put(q, r) = K**2: McDonald and Schroder 1998."""
    put = exercise_boundary(Option("put", 100.0, 1.0), Market(100.0, 0.06, 0.3, 0.02), [0.0, 0.5])
    call = exercise_boundary(Option("call", 100.0, 1.0), Market(100.0, 0.02, 0.3, 0.06), [0.0, 0.5])
    assert put.boundary * call.boundary == pytest.approx([1e4, 1e4], rel=5e-4)


def test_two_boundaries_leave_their_limits_and_meet():
    """Put with q < r < 0: exercise region [K r/q, K] just before expiry (Battauz, De Donno, Sbuelz 2015)."""
    option, market = Option("put", 100.0, 5.0), Market(100.0, -0.005, 0.2, -0.01)
    found = exercise_boundary(option, market)
    assert found.boundary[-1] == pytest.approx(100.0)
    assert found.other_boundary[-1] == pytest.approx(50.0)
    exists = ~np.isnan(found.boundary)
    assert 10 < np.count_nonzero(exists) < exists.size  # they met before today
    assert np.all(np.diff(exists.astype(int)) >= 0)
    assert np.all(found.boundary[exists] >= found.other_boundary[exists])
    assert np.all(np.diff(found.other_boundary[exists]) < 1e-2)


def test_two_boundaries_of_a_call_mirror_those_of_a_put():
    put = exercise_boundary(Option("put", 100.0, 1.0), Market(100.0, -0.02, 0.2, -0.05), [0.0, 0.5])
    call = exercise_boundary(Option("call", 100.0, 1.0), Market(100.0, -0.05, 0.2, -0.02), [0.0, 0.5])
    assert put.boundary * call.boundary == pytest.approx([1e4, 1e4], rel=2e-3)
    assert put.other_boundary * call.other_boundary == pytest.approx([1e4, 1e4], rel=4e-3)


@needs_kernel
def test_next_to_the_boundary_the_value_leaves_the_payoff_as_the_equation_says():
    """V - payoff = (r K - q S*)/(sigma S*)**2 (S - S*)**2 + ..., from smooth pasting and (11.46)."""
    option, market = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)
    boundary = price(option, market, tolerance=1e-7).exercise_boundary
    distance = 0.005 * boundary
    above = price(option, Market(boundary + distance, 0.05, 0.2), tolerance=1e-7)
    curvature = 2 * 0.05 * 100.0 / (0.2 * boundary) ** 2
    assert above.delta + 1.0 == pytest.approx(curvature * distance, rel=0.05)
    assert above.price - above.intrinsic_value == pytest.approx(0.5 * curvature * distance**2, rel=0.05)


def test_european_and_never_exercised_options_have_none():
    european = exercise_boundary(Option("put", 100.0, 1.0, "european"), Market(100.0, 0.05, 0.2))
    never = exercise_boundary(Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2))
    assert np.isnan(european.boundary).all()
    assert np.isnan(never.boundary).all()


def test_at_zero_volatility_and_at_expiry_the_boundary_is_its_limit():
    flat = exercise_boundary(Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.0, 0.06), [0.0, 0.5])
    expired = exercise_boundary(Option("put", 100.0, 0.0), Market(100.0, 0.05, 0.2))
    assert flat.boundary == pytest.approx([50.0, 50.0])
    assert expired.boundary == pytest.approx([100.0])
    assert expired.time_to_expiry == pytest.approx([0.0])


@pytest.mark.parametrize("times", [[-0.1], [1.1], [0.5, 0.5], [0.5, 0.2], [math.nan], "soon"])
def test_bad_times_are_refused(put, market, times):
    with pytest.raises(InvalidInputError, match="times"):
        exercise_boundary(put, market, times)


def test_an_interrupt_is_an_error_since_no_boundary_is_known(put, market):
    with pytest.raises(NumericalError, match="interrupted"):
        exercise_boundary(put, market, interrupt=lambda: True)


@pytest.mark.parametrize("asked", [1, 5, 50])
def test_a_boundary_without_volatility_is_interrupted_between_its_times(asked):
    """Every time takes 50 ms where hundreds of dividends follow."""
    count = itertools.count()
    with pytest.raises(NumericalError, match="interrupt"):
        exercise_boundary(
            Option("put", 100.0, 1.0),
            Market(100.0, 0.05, 1e-4, cash_dividends=[CashDividend(0.5, 1.0)]),
            np.linspace(0.0, 1.0, 100),
            interrupt=lambda: next(count) >= asked,
        )
    assert next(count) == asked + 1


# (rate, dividend_yield, volatility, expiry): r < q, where the boundary starts far below the strike
FLAT = [
    (0.00968, 0.04384, 0.252, 0.1417),
    (0.0569, 0.1036, 0.0618, 0.0598),
    (0.00082167, 0.1073, 0.5775, 0.00063),
    (0.000928, 0.0968, 0.03665, 5.371),
]


@needs_kernel
@pytest.mark.parametrize(("rate", "dividend_yield", "volatility", "expiry"), FLAT)
def test_boundary_is_monotone_above_the_perpetual_level_and_that_of_the_price(
    rate, dividend_yield, volatility, expiry
):
    option, market = Option("put", 100.0, expiry), Market(100.0, rate, volatility, dividend_yield)
    found = exercise_boundary(option, market).boundary
    assert np.all(np.diff(found) >= 0.0)
    assert found[0] >= 100.0 * perpetual_level(market, "put") * (1 - 1e-4)
    assert price(option, market).exercise_boundary == pytest.approx(found[0], rel=2e-3)


def test_two_boundaries_solved_apart_meet_their_limits():
    option, market = Option("put", 100.0, 0.1), Market(100.0, -0.01, 0.02, -0.04)
    found = exercise_boundary(option, market)
    assert found.boundary[-1] == pytest.approx(100.0)
    assert found.other_boundary[-1] == pytest.approx(25.0)
    assert np.all(np.diff(found.boundary) >= 0)
    assert np.all(np.diff(found.other_boundary) <= 0)
    assert 95.0 < found.boundary[0] < 100.0
    assert 25.0 < found.other_boundary[0] < 26.0


@needs_kernel
def test_a_time_does_not_depend_on_the_other_times():
    """Far from expiry this option is beyond the march; close to it, it is not."""
    option, market = Option("put", 100.0, 35.0), Market(100.0, 0.05, 3.0)
    times = np.array([0.0, 0.5, 0.9999]) * 35.0
    together = exercise_boundary(option, market, times)
    alone = exercise_boundary(option, market, times[-1:])
    assert np.isfinite(together.error_estimate).all()
    assert together.boundary[-1] == alone.boundary[0]
    assert np.all(np.diff(together.boundary) >= 0.0)


@pytest.mark.parametrize("amount", [2.0, 30.0, 150.0])
def test_nobody_exercises_an_escrowed_put_just_before_a_payment(amount):
    """Who waits until it is over gets a strike that is higher by the payment."""
    market = Market(1000.0, 0.05, 0.2, 0.02, (CashDividend(0.5, amount),), dividend_model="escrowed")
    found = exercise_boundary(Option("put", 100.0, 1.0), market, [0.0, 0.5, 0.5001, 1.0])
    assert np.isnan(found.boundary[1])
    assert 80.0 < found.boundary[2] < 83.0
    assert found.boundary[3] == 100.0


@pytest.mark.parametrize("strike", [1e-30, 1.0])
def test_a_boundary_that_begins_at_no_spot_is_none(strike):
    """The boundary of this put begins at K r/q, which is 0 in floating-point numbers for the smaller strike."""
    dividends = (CashDividend(0.5, 0.3 * strike), CashDividend(1.5, 0.3 * strike))
    market = Market(strike, PiecewiseConstant([0.2, 1.0], [0.05, 1e-300]), 1e-4, 2.0, dividends)
    found = exercise_boundary(Option("put", strike, 2.0), market)
    assert np.all(np.isnan(found.boundary) | (found.boundary <= strike))


@needs_kernel
@pytest.mark.parametrize("spot", [150.0, 310.0, 2000.0])
@pytest.mark.parametrize(
    ("option_type", "amounts", "model"),
    [("put", (0.6, 0.6), "spot"), ("put", (0.3, 0.3), "escrowed"), ("call", (4.0, 4.0), "spot")],
)
def test_a_price_far_from_the_boundary_tells_the_same_boundary(option_type, amounts, model, spot):
    """Its march around the spot, many deviations away, reaches no boundary: one around the strike is asked."""
    dividends = [CashDividend(0.9, amounts[0]), CashDividend(1.7, amounts[1])]
    market = Market(spot, 0.04, 0.02, 0.03, cash_dividends=dividends, dividend_model=model)
    option = Option(option_type, 100.0, 2.0)
    found = price(option, market, tolerance=1e-6, greeks="none")
    expected = exercise_boundary(option, market, [0.0])
    assert found.exercise_boundary is not None
    allowed = found.boundary_error + expected.error_estimate[0]
    assert found.exercise_boundary == pytest.approx(expected.boundary[0], abs=allowed)


def test_a_put_on_a_spot_that_hardly_moves_after_it_moved_far_has_no_boundary_above_the_strike():
    """The grid's cells are a seventh of the spot wide: an end of the region is known to within one of them."""
    market = Market(
        1e-6,
        {"times": [0.12, 0.35, 0.61, 0.78, 1.04], "values": [0.3, 0.0, -0.5, 0.05, 2.0]},
        {"times": [0.5, 2.0], "values": [15.0, 1e-12]},
        2.0,
        cash_dividends=[CashDividend(0.92, 1.0)],
        dividend_model="escrowed",
    )
    found = exercise_boundary(Option("put", 100.0, 1.0), market, tolerance=0.01).boundary
    assert np.nanmax(found) <= 100.0
