"""Limiting cases have their exact answers, and puts with two boundaries meet the default tolerance."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, price
from tests.problems.event_values import event_values
from tests.problems.needs_kernel import needs_kernel
from tests.problems.true_values import rows_of

TWO_BOUNDARIES = [case for case in event_values() if case.market.rate < 0.0]


# The grid's errors are a part of the spot, those of the compiled engines of the price.
ROWS = [
    pytest.param(row, id="-".join(row.values()), marks=[needs_kernel] * (row["strike"] == "1e-8"))
    for row in rows_of("american_edge_cases.csv")
]


@pytest.mark.parametrize("row", ROWS)
def test_limiting_cases_have_their_exact_answers(row):
    numbers = {name: float(text) for name, text in row.items() if name != "option_type"}
    option = Option(row["option_type"], numbers["strike"], numbers["days"] / 365.0)
    market = Market(numbers["spot"], numbers["rate"], numbers["volatility"], numbers["dividend_yield"])
    assert price(option, market).price == pytest.approx(
        numbers["expected"], rel=0.0, abs=numbers["tolerance"]
    )


@pytest.mark.parametrize("case", TWO_BOUNDARIES, ids=lambda case: case.name)
def test_puts_with_two_boundaries_meet_the_default_tolerance(case):
    found = price(case.option, case.market, greeks="none")
    assert found.status == "ok"
    assert found.price == pytest.approx(case.price, abs=2e-6 * case.option.strike)


RISING = {"times": [0.5, 1.0], "values": [0.01, 0.02]}


def test_a_put_on_a_spot_without_measure_is_worth_nothing():
    market = Market(1e30, RISING, 0.2, cash_dividends=[CashDividend(0.5, 1.0)])
    found = price(Option("put", 100.0, 1.0), market)
    assert (found.status, found.price) == ("ok", 0.0)
    assert found.error_estimate <= 1e-9


@needs_kernel
@pytest.mark.parametrize(
    ("option", "market"),
    [
        (Option("put", 100.0, 200.0), Market(100.0, 2.0, 0.15, -0.5)),
        (Option("put", 100.0, 200.0, "bermudan", [100.0]), Market(100.0, 0.05, 0.3, -0.5)),
    ],
    ids=["rates far apart", "bermudan"],
)
def test_the_ends_of_the_promised_domain_have_an_honest_status(option, market):
    found = price(option, market, greeks="none", interrupt=lambda: False)
    assert found.status in ("ok", "tolerance_not_met")
    assert found.price >= 0.0
    assert found.price + found.error_estimate <= 100.0 * (1.0 + 1e-12)


@needs_kernel
def test_options_out_of_reach_are_worth_nothing_to_within_their_error():
    rng = np.random.default_rng(12)
    boundaries = 0
    for _ in range(60):
        option_type, far = str(rng.choice(["put", "call"])), math.exp(rng.uniform(15.5, 60.0))
        years, volatility = 10.0 ** rng.uniform(-9.0, 0.5), 10.0 ** rng.uniform(-8.0, -0.1)
        rate = RISING if rng.random() < 0.3 else rng.uniform(-0.1, 0.1)
        option = Option(option_type, 100.0, years)
        market = Market(
            100.0 * (far if option_type == "put" else 1.0 / far), rate, volatility, rng.uniform(-0.1, 0.1)
        )
        found = price(option, market, tolerance=1e-4, greeks="extended")
        assert (found.status, found.price) == ("ok", 0.0)
        european = price(replace(option, exercise="european"), market, greeks="none").price
        assert european <= found.error_estimate + 1e-300
        assert found.delta == found.vega == found.vanna == 0.0
        at_the_money = price(option, replace(market, spot=100.0), tolerance=1e-4, greeks="none")
        if found.exercise_boundary is not None and at_the_money.exercise_boundary is not None:
            boundaries += 1
            assert found.exercise_boundary == pytest.approx(at_the_money.exercise_boundary, rel=2e-3)
    assert boundaries > 20


@pytest.mark.parametrize("rate", [0.05, RISING])
@pytest.mark.parametrize("volatility", [1e-300, 1e-160, 1e-30])
def test_the_least_volatilities_have_all_their_greeks(rate, volatility):
    for option_type, delta in (("put", 0.0), ("call", 1.0)):
        found = price(Option(option_type, 90.0, 1.0), Market(100.0, rate, volatility), greeks="extended")
        assert found.status == "ok"
        assert (found.vega, found.vanna, found.volga) == (0.0, 0.0, 0.0)
        assert found.delta == pytest.approx(delta, abs=1e-9)


@needs_kernel
@pytest.mark.parametrize("kind", ["put", "call"])
@pytest.mark.parametrize("volatilities", [(1e-300, 0.3), (0.3, 0.0)])
def test_a_time_without_volatility_is_the_limit_of_one_with_little(kind, volatilities):
    def value(least):
        curve = {"times": [0.5, 1.0], "values": [max(one, least) for one in volatilities]}
        market = Market(97.0, RISING, curve, 0.03, cash_dividends=[(0.8, 1.5)])
        return price(Option(kind, 100.0, 1.0), market, tolerance=1e-5)

    found, little, more = value(0.0), value(0.01), value(0.02)
    limit = little.price + (little.price - more.price) / 3.0  # the volatility's square counts
    assert abs(found.price - limit) <= found.error_estimate + 2.0 * (
        little.error_estimate + more.error_estimate
    )
    assert found.error_estimate <= 0.02
    assert (found.method, found.status == "ok") == ("zero-volatility", found.error_estimate <= 1e-3)


@pytest.mark.parametrize("exercise", ["american", "european"])
def test_an_error_is_never_below_the_rounding_of_the_value(exercise):
    """50 % paid for 200 years make a put worth e^100 strikes, of which no number has 1e-6 strikes' accuracy."""
    market = Market(100.0, -0.5, 0.2, -0.5)
    found = price(Option("put", 100.0, 200.0, exercise), market)
    assert found.price == pytest.approx(2.2652784469501787e45, rel=1e-13)
    assert 4e-16 * found.price <= found.error_estimate <= 1e-12 * found.price
    assert found.status == "tolerance_not_met"


@pytest.mark.parametrize("volatility", [1e-8, 0.2, 0.8])
def test_a_call_whose_escrow_exceeds_the_strike_is_exercised_just_before_the_dividend(volatility):
    market = Market(
        1000.0, 0.05, volatility, cash_dividends=[CashDividend(0.5, 500.0)], dividend_model="escrowed"
    )
    found = price(Option("call", 100.0, 1.0), market)
    assert found.status == "ok"
    assert found.price == pytest.approx(1000.0 - 100.0 * math.exp(-0.025), abs=found.error_estimate + 1e-9)
