import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    exercise_advice,
    exercise_boundary,
    price,
)
from pricing_core.errors import InvalidInputError, NumericalError
from tests.american.advice.monte_carlo import simulate
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

QUARTERLY = tuple(CashDividend(time, 2.0) for time in (0.2, 0.45, 0.7, 0.95))
CURVED = Market(
    95.0,
    PiecewiseConstant([0.5, 1.0, 3.0], [0.02, 0.06, 0.04]),
    PiecewiseConstant([0.7, 3.0], [0.2, 0.3]),
    proportional_dividends=[ProportionalDividend(0.6, 0.05), ProportionalDividend(1.6, 0.05)],
)
DATES = (0.25, 0.5, 0.75)
CASES = {
    "put at the money": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
    "call with cash dividends": (Option("call", 100.0, 1.0), Market(110.0, 0.05, 0.2, 0.02, QUARTERLY)),
    "put with cash dividends": (Option("put", 100.0, 1.0), Market(90.0, 0.05, 0.2, 0.0, QUARTERLY)),
    "two boundaries": (Option("put", 100.0, 1.0), Market(100.0, -0.01, 0.1, -0.02)),
    "Bermudan": (Option("put", 100.0, 1.0, "bermudan", DATES), Market(95.0, 0.05, 0.2)),
    "curves": (Option("put", 100.0, 2.0), CURVED),
    "week": (Option("put", 100.0, 0.02), Market(99.0, 0.05, 0.2)),
    "call with a yield": (Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.08)),
    "call out of the money": (Option("call", 100.0, 30.0), Market(60.0, 0.03, 0.25, 0.04)),
    "put in the money": (Option("put", 100.0, 1.0), Market(84.0, 0.05, 0.2)),
    "put out of the money": (Option("put", 100.0, 0.5), Market(125.0, 0.05, 0.3)),
    "escrowed put": (
        Option("put", 100.0, 1.0),
        Market(90.0, 0.05, 0.3, 0.0, QUARTERLY, dividend_model="escrowed"),
    ),
    "escrowed call": (
        Option("call", 100.0, 1.0),
        Market(115.0, 0.05, 0.3, 0.0, QUARTERLY, dividend_model="escrowed"),
    ),
    "starts later": (Option("put", 100.0, 1.0, exercise_start=0.5), Market(90.0, 0.05, 0.2)),
    "paid out": (Option("put", 100.0, 1.0), Market(60.0, 0.02, 0.5, 0.0, [CashDividend(0.3, 40.0)])),
    "future": (Option("put", 100.0, 0.5, settlement_lag=30.0), Market(95.0, 0.08, 0.2, underlying="future")),
    "negative rate": (Option("call", 100.0, 2.0), Market(105.0, -0.02, 0.2, 0.01)),
    "two boundaries that meet": (Option("put", 100.0, 20.0), Market(110.0, -0.01, 0.15, -0.06)),
    "Bermudan call": (
        Option("call", 100.0, 1.0, "bermudan", (0.19, 0.45, 0.94)),
        Market(112.0, 0.03, 0.25, 0.0, QUARTERLY),
    ),
    "high volatility": (Option("put", 100.0, 3.0), Market(100.0, 0.03, 1.2)),
}
QUICK = list(CASES)[:6]


def compare(name, paths, steps):
    option, market = CASES[name]
    advice = exercise_advice(option, market)
    simulated = simulate(option, market, paths, steps, seed=len(name))

    def close(found, expected):
        deviation = math.sqrt(max(expected * (1.0 - expected), 1e-4) / paths)
        assert abs(found - expected) <= 4.0 * deviation + advice.probability_error

    close(advice.probability, simulated.probability)
    close(advice.exercised_at_expiry, simulated.at_expiry)
    close(advice.expires_worthless, simulated.worthless)
    for time, found in zip(
        advice.time[::10].tolist(), advice.cumulative_probability[::10].tolist(), strict=True
    ):
        close(found, simulated.cumulative(time))


@pytest.mark.parametrize("name", QUICK)
def test_probabilities_are_those_of_simulated_paths(name):
    compare(name, 60_000, 60)


@pytest.mark.nightly
@pytest.mark.parametrize("name", CASES)
def test_probabilities_are_those_of_a_million_simulated_paths(name):
    compare(name, 1_000_000, 200)


@pytest.mark.parametrize("name", CASES)
def test_nobody_is_lost_and_time_only_adds(name):
    option, market = CASES[name]
    advice = exercise_advice(option, market)
    total = advice.probability + advice.exercised_at_expiry + advice.expires_worthless
    assert total == pytest.approx(1.0, abs=1e-12)
    for column in (advice.cumulative_probability, advice.assignment_probability, advice.cost_of_waiting):
        assert (np.diff(column) >= -1e-12).all()
    assert advice.cumulative_probability[-1] == pytest.approx(advice.probability, abs=1e-12)
    assert advice.assignment_probability[-1] == pytest.approx(1.0 - advice.expires_worthless, abs=1e-12)
    assert advice.probability_error < 1e-3


@pytest.mark.parametrize("name", CASES)
def test_waiting_costs_what_an_option_that_starts_later_is_worth_less(name):
    option, market = CASES[name]
    times = np.array([0.0, 0.1, 0.2, 0.5, 0.83]) * option.expiry
    cost = exercise_advice(option, market, times).cost_of_waiting
    for time, lost in zip(times.tolist(), cost.tolist(), strict=True):
        if option.exercise == "bermudan":
            left = tuple(when for when in option.exercise_times if when >= time)
            waited = (
                replace(option, exercise_times=left)
                if left
                else replace(option, exercise="european", exercise_times=())
            )
        else:
            waited = replace(option, exercise_start=max(option.exercise_start, time))
        expected = price(option, market).price - price(waited, market).price
        assert lost == pytest.approx(expected, abs=2e-6 * option.strike)


@pytest.mark.parametrize("name", CASES)
def test_waiting_until_expiry_costs_the_early_exercise_premium(name):
    option, market = CASES[name]
    advice = exercise_advice(option, market, times=[option.expiry])
    european = replace(option, exercise="european", exercise_times=(), exercise_start=0.0)
    values = [price(each, market, tolerance=1e-8) for each in (option, european)]
    premium = values[0].price - values[1].price
    assert abs(advice.cost_of_waiting[0] - premium) <= advice.cost_error[0] + sum(
        v.error_estimate for v in values
    )


@pytest.mark.parametrize("dividend_yield", [0.0, 0.03, 0.09])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_cost_of_waiting_is_the_integral_of_the_multiplier_under_the_free_law(option_type, dividend_yield):
    """Kim 1990: a holder who does not exercise loses rK - qS (a put) per year for as long as exercise is optimal."""
    sign = 1.0 if option_type == "put" else -1.0
    option, market = Option(option_type, 100.0, 1.0), Market(100.0, 0.05, 0.25, dividend_yield)
    advice = exercise_advice(option, market, times=[0.3, 0.6, 1.0])

    def loss(root):
        t = root * root
        level = exercise_boundary(option, market, [t], tolerance=1e-8).boundary[0]
        if math.isnan(level):
            return 0.0
        spread = 0.25 * root
        d = (math.log(100.0 / level) + (0.05 - dividend_yield - 0.5 * 0.25**2) * t) / spread
        strike = 0.05 * 100.0 * math.exp(-0.05 * t) * norm.cdf(-sign * d)
        spot = dividend_yield * 100.0 * math.exp(-dividend_yield * t) * norm.cdf(-sign * (d + spread))
        return 2.0 * root * sign * (strike - spot)

    for time, cost, error in zip(advice.time, advice.cost_of_waiting, advice.cost_error, strict=True):
        assert cost == pytest.approx(
            quad(loss, 1e-6, math.sqrt(time), epsabs=1e-6, limit=60)[0], abs=error + 2e-5
        )


def test_put_of_the_references_has_the_probability_and_the_premium_found_there():
    """Two independent codes: 0.4880 within 0.0015, and 6.0903706 - 5.5735260."""
    advice = exercise_advice(*CASES["put at the money"], tolerance=1e-8)
    assert advice.probability == pytest.approx(0.4880, abs=0.0015)
    assert advice.cost_of_waiting[-1] == pytest.approx(0.5168446, abs=2e-7)
    assert advice.exercised_at_expiry == pytest.approx(0.0, abs=1e-8)


def test_call_without_dividends_is_never_exercised_early():
    advice = exercise_advice(Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2))
    d = (0.05 - 0.5 * 0.2**2) / 0.2
    assert advice.probability == 0.0
    assert math.isnan(advice.expected_time)
    assert advice.exercised_at_expiry == pytest.approx(norm.cdf(d), abs=1e-10)
    assert advice.cost_of_waiting[-1] == 0.0


def test_call_with_one_dividend_is_exercised_just_before_it_above_its_boundary():
    option, market = Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.0, [CashDividend(0.5, 5.0)])
    advice = exercise_advice(option, market)
    level = exercise_boundary(option, market, [0.5], tolerance=1e-8).boundary[0]
    d = (math.log(100.0 / level) + (0.05 - 0.5 * 0.2**2) * 0.5) / (0.2 * math.sqrt(0.5))
    assert advice.probability == pytest.approx(norm.cdf(d), abs=advice.probability_error)
    assert advice.probability_error < 5e-4
    assert advice.expected_time == 0.5
    before, after = advice.time < 0.5, advice.time >= 0.5
    assert (advice.cumulative_probability[before] == 0.0).all()
    assert (advice.cumulative_probability[after] == advice.probability).all()


def test_put_far_from_expiry_is_hit_as_often_as_a_drifted_motion_hits_a_level():
    """The boundary of 200 years hardly moves in the first 50: it is that without expiry."""
    rate, volatility, time = 0.05, 0.2, 50.0
    advice = exercise_advice(Option("put", 100.0, 200.0), Market(120.0, rate, volatility), times=[time])
    power = 2.0 * rate / volatility**2
    fall = math.log(120.0 / (100.0 * power / (1.0 + power)))
    drift, spread = rate - 0.5 * volatility**2, volatility * math.sqrt(time)
    reached = norm.cdf((-fall - drift * time) / spread)
    reflected = math.exp(-2.0 * drift * fall / volatility**2) * norm.cdf((-fall + drift * time) / spread)
    assert advice.cumulative_probability[0] == pytest.approx(
        reached + reflected, abs=advice.probability_error
    )
    assert advice.probability_error < 1e-3


def test_exercise_now_settles_everything():
    advice = exercise_advice(Option("put", 100.0, 1.0), Market(70.0, 0.05, 0.2))
    assert advice.exercise_now
    assert (advice.probability, advice.expected_time, advice.expires_worthless) == (1.0, 0.0, 0.0)
    assert (advice.cumulative_probability == 1.0).all()


@pytest.mark.parametrize(("spot", "gains"), [(90.0, 1.0), (110.0, 0.0)])
def test_expired_option_is_exercised_or_worthless(spot, gains):
    advice = exercise_advice(Option("put", 100.0, 0.0), Market(spot, 0.05, 0.2))
    assert (advice.probability, advice.exercised_at_expiry, advice.expires_worthless) == (
        0.0,
        gains,
        1.0 - gains,
    )


def test_events_close_together_change_nothing_where_nothing_happens():
    """Segments that a curve of equal rates would cut are as one, however short they are."""
    whole = exercise_advice(*CASES["put at the money"], times=[0.5, 1.0])
    curve = PiecewiseConstant([0.5, 0.5 + 1e-7, 0.6, 1.0], [0.05, 0.05 + 1e-12, 0.05, 0.05 + 1e-12])
    cut = exercise_advice(Option("put", 100.0, 1.0), Market(100.0, curve, 0.2), times=[0.5, 1.0])
    bound = whole.probability_error + cut.probability_error
    assert np.abs(whole.cumulative_probability - cut.cumulative_probability).max() <= bound < 2e-3


def test_what_is_not_supported_is_told():
    option = Option("put", 100.0, 1.0)
    with pytest.raises(InvalidInputError, match="above 0 in advice"):
        exercise_advice(option, Market(100.0, 0.05, 0.0))
    with pytest.raises(InvalidInputError, match="times"):
        exercise_advice(option, Market(100.0, 0.05, 0.2), times=[0.5, 0.5])
    with pytest.raises(InvalidInputError, match="tolerance"):
        exercise_advice(option, Market(100.0, 0.05, 0.2), tolerance=1.0)
    with pytest.raises(NumericalError, match="interrupted"):
        exercise_advice(option, Market(100.0, 0.05, 0.2), interrupt=lambda: True)


@pytest.mark.parametrize("asked_at_most", [1, 10])
def test_a_law_that_rounding_keeps_from_being_resolved_takes_bounded_memory_and_can_be_interrupted(
    asked_at_most: int,
) -> None:
    asked = 0

    def interrupt() -> bool:
        nonlocal asked
        asked += 1
        return asked > asked_at_most

    option = Option("call", 1e29, 1e-9, exercise_start=5e-10)
    tracemalloc.start()
    try:
        with pytest.raises(NumericalError):
            exercise_advice(option, Market(1e30, -0.5, 3.0), interrupt=interrupt)
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
    assert asked == asked_at_most + 1


def test_a_call_on_a_spot_of_zero_is_worthless_whatever_its_volatility():
    local = LocalVolatility([0.8], [50.0, 100.0, 200.0], [[0.2, 0.2, 0.5]])
    for volatility in (0.2, local):
        market = Market(0.0, -0.5, volatility, 0.05, cash_dividends=[CashDividend(0.3, 1.0)])
        found = exercise_advice(Option("call", 100.0, 1.0), market, times=[0.2, 1.0])
        assert (found.probability, found.exercised_at_expiry, found.expires_worthless) == (0.0, 0.0, 1.0)
