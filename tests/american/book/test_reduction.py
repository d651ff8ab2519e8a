"""Futures, borrow costs, quanto options and payments that lag: prices and Greeks of what the engines do not know."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    contract_from,
    exercise_boundary,
    implied_volatility,
    implied_volatility_many,
    price,
    price_many,
    value_surface,
)
from pricing_core.errors import InvalidInputError
from tests.problems.needs_kernel import needs_kernel
from tests.problems.nightly import nightly_rows

pytestmark = needs_kernel
SEEDS = range(6)
RATES = PiecewiseConstant([0.2, 0.6, 1.0], [0.01, 0.05, 0.03])
YIELDS = PiecewiseConstant([0.4, 0.8], [0.02, 0.04])


def drawn(seed: int) -> tuple[str, dict[str, float]]:
    draw = np.random.default_rng([seed, 7])
    kind = ["put", "call"][seed % 2]
    numbers = {
        "spot": draw.uniform(80, 120),
        "rate": draw.uniform(0.0, 0.08),
        "volatility": draw.uniform(0.1, 0.5),
    }
    return kind, numbers


def normal(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def black(kind: str, forward: float, strike: float, spread: float, discount: float) -> float:
    d = math.log(forward / strike) / spread + 0.5 * spread
    sign = 1.0 if kind == "call" else -1.0
    return sign * discount * (forward * normal(sign * d) - strike * normal(sign * (d - spread)))


def by_tree(option: Option, market: Market, steps: int = 1500) -> float:
    """Price by a binomial tree whose payoff is discounted from payment to exercise at every node."""
    h, lag = option.expiry / steps, option.settlement_lag / 365.0
    rate, dividend_yield = (
        curve if isinstance(curve, PiecewiseConstant) else PiecewiseConstant([1.0], [curve])
        for curve in (market.rate, market.dividend_yield)
    )
    up = math.exp(market.volatility * math.sqrt(h))
    sign = 1.0 if option.option_type == "call" else -1.0

    def exercised(step: int) -> np.ndarray:
        spots = market.spot * up ** np.arange(-step, step + 1, 2.0)
        paid = math.exp(-rate.integral(step * h, step * h + lag))
        return paid * np.maximum(sign * (spots - option.strike), 0.0)

    value = exercised(steps)
    for step in reversed(range(steps)):
        start, end = step * h, (step + 1) * h
        growth = math.exp(rate.integral(start, end) - dividend_yield.integral(start, end))
        share = (growth - 1.0 / up) / (up - 1.0 / up)
        held = math.exp(-rate.integral(start, end)) * (share * value[1:] + (1.0 - share) * value[:-1])
        value = np.maximum(held, exercised(step))
    return float(value[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_european_option_on_a_future_is_worth_blacks_formula(seed):
    kind, market = drawn(seed)
    option = Option(kind, 100.0, 0.7, exercise="european", settlement_lag=20.0)
    discount = math.exp(-market["rate"] * (0.7 + 20.0 / 365.0))
    expected = black(kind, market["spot"], 100.0, market["volatility"] * math.sqrt(0.7), discount)
    assert price(option, Market(**market, underlying="future")).price == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_european_quanto_option_has_its_own_forward(seed):
    kind, market = drawn(seed)
    draw = np.random.default_rng([seed, 8])
    foreign, covariance, borrow = draw.uniform(-0.01, 0.06), draw.uniform(-0.05, 0.05), draw.uniform(0, 0.03)
    carried = Market(
        **market,
        dividend_yield=0.01,
        borrow_rate=borrow,
        foreign_rate=foreign,
        quanto_covariance=covariance,
    )
    forward = market["spot"] * math.exp((foreign - 0.01 - borrow - covariance) * 0.7)
    expected = black(
        kind, forward, 100.0, market["volatility"] * math.sqrt(0.7), math.exp(-0.7 * market["rate"])
    )
    found = price(Option(kind, 100.0, 0.7, exercise="european"), carried)
    assert found.price == pytest.approx(expected, abs=1e-11)


def test_a_european_option_paid_later_under_curves_is_the_forward_discounted_to_the_payment():
    option = Option("put", 100.0, 0.7, exercise="european", settlement_lag=100.0)
    market = Market(95.0, RATES, 0.3, dividend_yield=YIELDS)
    forward = 95.0 * math.exp(RATES.integral(0.0, 0.7) - YIELDS.integral(0.0, 0.7))
    discount = math.exp(-RATES.integral(0.0, 0.7 + 100.0 / 365.0))
    expected = black("put", forward, 100.0, 0.3 * math.sqrt(0.7), discount)
    assert price(option, market).price == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_american_option_on_a_future_is_one_with_the_rate_as_its_yield(seed):
    kind, market = drawn(seed)
    option = Option(kind, 100.0, 1.0)
    found = price(option, Market(**market, underlying="future"), greeks="extended")
    expected = price(option, Market(**market, dividend_yield=market["rate"]), greeks="extended")
    for name in ("price", "delta", "gamma", "theta", "vega", "vanna", "charm", "exercise_boundary"):
        assert getattr(found, name) == getattr(expected, name)
    assert found.rho == expected.rho + expected.dividend_rho
    assert found.dividend_rho == 0.0


@pytest.mark.parametrize("kind", ["put", "call"])
@pytest.mark.parametrize("curves", [False, True])
def test_an_american_option_paid_later_agrees_with_a_tree(kind, curves):
    market = Market(97.0, RATES if curves else 0.05, 0.3, dividend_yield=YIELDS if curves else 0.06)
    option = Option(kind, 100.0, 1.0, settlement_lag=120.0)
    assert price(option, market).price == pytest.approx(by_tree(option, market), abs=6e-3)
    at_once = replace(option, settlement_lag=0.0)
    assert price(at_once, market).price == pytest.approx(by_tree(at_once, market), abs=6e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_at_one_rate_the_lag_is_a_discount_of_everything(seed):
    kind, numbers = drawn(seed)
    option, market = Option(kind, 100.0, 1.0, settlement_lag=90.0), Market(**numbers, dividend_yield=0.04)
    at_once = replace(option, settlement_lag=0.0)
    share = math.exp(-numbers["rate"] * 90.0 / 365.0)
    found, expected = (price(each, market, greeks="extended") for each in (option, at_once))
    for name in ("price", "european_price", "intrinsic_value", "delta", "gamma", "theta", "vega", "volga"):
        assert getattr(found, name) == pytest.approx(share * getattr(expected, name), rel=1e-14)
    lost = 90.0 / 365.0 * expected.price
    assert found.rho == pytest.approx(share * (expected.rho - lost), rel=1e-13)
    assert found.exercise_boundary == expected.exercise_boundary
    surface = value_surface(option, market, spots=[80.0, 120.0], times=[0.0, 0.5])
    plain = value_surface(at_once, market, spots=[80.0, 120.0], times=[0.0, 0.5])
    np.testing.assert_allclose(surface.value, share * plain.value, rtol=1e-13)
    np.testing.assert_allclose(surface.multiplier, share * plain.multiplier, rtol=1e-13)
    boundaries = [exercise_boundary(each, market, [0.0, 0.5]).boundary for each in (option, at_once)]
    np.testing.assert_array_equal(*boundaries)


def richardson(make, at: float, step: float = 1e-3) -> float:
    """Return a derivative of the price by differences of fourth order."""
    values = {k: price(*make(at + k * step), tolerance=1e-8, greeks="none").price for k in (-2, -1, 1, 2)}
    return (8.0 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12.0 * step)


REDUCED = {
    "future": ({}, {"underlying": "future"}),
    "future paid later": ({"settlement_lag": 90.0}, {"underlying": "future"}),
    "quanto": ({}, {"foreign_rate": 0.02, "quanto_covariance": 0.01, "dividend_yield": YIELDS}),
    "quanto paid later": ({"settlement_lag": 90.0}, {"foreign_rate": 0.02, "dividend_yield": YIELDS}),
    "paid later": ({"settlement_lag": 150.0}, {"dividend_yield": YIELDS}),
    "borrowed": ({}, {"borrow_rate": PiecewiseConstant([0.3, 1.0], [0.0, 0.02]), "dividend_yield": YIELDS}),
}
BOTH = list(product(REDUCED, ("put", "call")))
COVERING = BOTH[::4] + BOTH[3::4]  # each case once, and each kind as often
REST = [pair for pair in BOTH if pair not in COVERING]


@pytest.mark.parametrize(("case", "kind"), [*COVERING, *nightly_rows(REST)])
def test_the_buckets_of_curves_are_derivatives_of_the_price(case, kind):
    terms, conditions = REDUCED[case]
    option, market = Option(kind, 100.0, 1.0, **terms), Market(96.0, RATES, 0.25, **conditions)
    found = price(option, market, tolerance=1e-7, greeks="extended")

    def changed(name, curve, piece):
        def make(value):
            values = [*curve.values[:piece], value, *curve.values[piece + 1 :]]
            return option, replace(market, **{name: PiecewiseConstant(curve.times, values)})

        return make

    for name in ("rate", "dividend_yield"):
        curve = getattr(market, name)
        if not isinstance(curve, PiecewiseConstant):
            assert getattr(found, f"{name}_buckets") is None
            continue
        buckets = getattr(found, f"{name}_buckets")
        for piece, bucket in enumerate(buckets):
            make = changed(name, curve, piece)
            expected, rough = (richardson(make, curve.values[piece], step) for step in (2e-3, 4e-3))
            error = found.greek_errors[f"{name}_buckets"][piece]
            assert abs(bucket - expected) <= error + 2.0 * abs(rough - expected) + 2e-6
            assert error <= 5e-2
        parallel = found.rho if name == "rate" else found.dividend_rho
        assert math.fsum(buckets) == pytest.approx(parallel, abs=1e-9)


def test_theta_and_charm_know_what_a_curve_of_rates_does_to_the_discount():
    """The knots of the curve stay where they are in time: what is left is the curve seen later."""
    option, market = Option("put", 100.0, 1.0, settlement_lag=150.0), Market(96.0, RATES, 0.25)
    found = price(option, market, tolerance=1e-7, greeks="extended")

    def later(years):
        times = [time - years for time in RATES.times]
        seen = replace(market, rate=PiecewiseConstant(times, RATES.values))
        return replace(option, expiry=1.0 - years), seen

    assert found.theta == pytest.approx(richardson(later, 0.0, 1e-2), abs=1e-4)
    deltas = [price(*later(years), tolerance=1e-8).delta for years in (-0.01, 0.01)]
    assert found.charm == pytest.approx((deltas[1] - deltas[0]) / 0.02, abs=1e-4)


def columns_of(rows):
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


ROWS = [
    {"option_type": "put", "rate": 0.03, "underlying": "future"},
    {"option_type": "call", "rate": 0.03, "underlying": "spot", "borrow_rate": 0.02, "dividend_yield": 0.01},
    {
        "option_type": "put",
        "rate": 0.03,
        "foreign_rate": 0.01,
        "quanto_covariance": -0.02,
        "dividend_yield": 0.0,
    },
    {"option_type": "put", "rate": 0.03, "settlement_lag": 2.0, "dividend_yield": 0.0},
    {"option_type": "put", "rate": 0.03, "dividend_yield": 0.0},
    {
        "option_type": "put",
        "rate": 0.03,
        "settlement_lag": 3.0,
        "borrow_rate": 0.01,
        "cash_dividends": [{"time": 0.4, "amount": 1.0}],
    },
    {"option_type": "call", "rate": 0.03, "underlying": "future", "settlement_lag": 5.0},
]
COMMON = {"spot": 97.0, "strike": 100.0, "expiry": 1.0, "volatility": 0.25}


@pytest.mark.parametrize("make", [dict, pd.DataFrame, pa.table])
def test_a_row_of_a_table_is_priced_as_it_is_alone(make):
    rows = [{**COMMON, **{"dividend_yield": 0.0}, **row} for row in ROWS]
    columns = columns_of(rows)
    if make is pa.table:
        dividends = pa.array(columns.pop("cash_dividends"))
        table = pa.table({name: pa.array(cells) for name, cells in columns.items()})
        table = table.append_column("cash_dividends", dividends)
    else:
        table = make(columns)
    found = price_many(table, tolerance=1e-5)
    for row, stated in enumerate(rows):
        expected = price(*contract_from(stated), tolerance=1e-5)
        for name in ("price", "european_price", "intrinsic_value", "delta", "rho", "dividend_rho"):
            cell = found[name][row]
            assert (cell.as_py() if make is pa.table else cell) == getattr(expected, name), (row, name)


@pytest.mark.parametrize("row", range(len(ROWS)))
def test_the_implied_volatility_of_the_price_is_the_volatility(row):
    stated = {**COMMON, **ROWS[row]}
    option, market = contract_from(stated)
    quote = price(option, market, tolerance=1e-7)
    found = implied_volatility(option, market, quote.price, tolerance=1e-7)
    assert found.volatility == pytest.approx(0.25, abs=1e-5)
    columns = {name: [cell] for name, cell in stated.items() if name != "volatility"}
    many = implied_volatility_many(columns, option_price=[quote.price], tolerance=1e-7)
    assert many["volatility"][0] == pytest.approx(0.25, abs=1e-5)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"underlying": "future", "dividend_yield": 0.01}, "dividend_yield = 0.01: must be left out where"),
        ({"underlying": "future", "borrow_rate": 0.01}, "borrow_rate = 0.01: must be left out where"),
        ({"underlying": "future", "foreign_rate": 0.01}, "foreign_rate = 0.01: must be left out where"),
        ({"underlying": "future", "cash_dividends": [{"time": 0.5, "amount": 1.0}]}, "cash_dividends = "),
        ({"underlying": "swap"}, 'underlying = \'swap\': must be "spot" or "future"'),
        (
            {"dividend_yield": 1.5, "borrow_rate": 1.0},
            "dividend_yield = 2.5: must be a number from -0.5 to 2, ",
        ),
        ({"settlement_lag": -1.0}, "settlement_lag = -1.0: must be a number from 0 to 366"),
        ({"settlement_lag": 400}, "settlement_lag = 400: must be a number from 0 to 366"),
        ({"borrow_rate": "much"}, "borrow_rate = 'much'"),
    ],
)
def test_what_does_not_go_together_is_named(stated, words):
    whole = {**COMMON, "option_type": "put", "rate": 0.03, **stated}
    with pytest.raises(InvalidInputError) as caught:
        price(*contract_from(whole))
    assert words in str(caught.value)
    table = price_many({name: [cell] for name, cell in whole.items()})
    assert table["status"][0] == "invalid_input"
    assert table["message"][0] == str(caught.value)


def test_escrowed_dividends_and_a_lag_under_a_curve_of_rates_are_refused():
    option = Option("put", 100.0, 1.0, settlement_lag=2.0)
    market = Market(100.0, RATES, 0.2, cash_dividends=(CashDividend(0.5, 1.0),), dividend_model="escrowed")
    with pytest.raises(
        InvalidInputError, match=r"settlement_lag = 2\.0: must be 0 where dividends are escrowed"
    ):
        price(option, market)
    assert price(option, replace(market, rate=0.05)).status == "ok"
