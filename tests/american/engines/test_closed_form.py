"""The formula and its limits against parity, the equation, numerical integration, differences and exact values."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, exercise_boundary, price
from pricing_core.american.book.book import Book
from pricing_core.american.engines.certain import certain_value
from pricing_core.american.engines.closed_form import ClosedForm
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.held import ROUNDING
from tests.problems.engines import solved
from tests.problems.schedules import cash, proportional
from tests.problems.zero_volatility import OPTIMAL_STOPPING

rates = st.floats(-0.2, 0.3)
volatilities = st.floats(0.02, 2.0)
expiries = st.floats(0.01, 20.0)
moneyness = st.floats(-2.0, 2.0)
ENGINE = ClosedForm()
RATES = PiecewiseConstant([0.4, 1.5], [0.02, 0.07])
VOLATILITIES = PiecewiseConstant([0.7, 1.5], [0.2, 0.4])
YIELDS = PiecewiseConstant([0.3, 0.9], [0.01, -0.02])
EUROPEAN = {
    "flat": (Option("put", 100.0, 1.0, "european"), Market(95.0, 0.05, 0.25, 0.03)),
    "call, flat": (Option("call", 100.0, 1.0, "european"), Market(95.0, 0.05, 0.25, 0.03)),
    "curves": (Option("put", 110.0, 1.5, "european"), Market(100.0, RATES, VOLATILITIES, YIELDS)),
    "call, curves that go on": (
        Option("call", 110.0, 1.2, "european"),
        Market(100.0, PiecewiseConstant([0.4, 1.5, 2.0], [0.02, 0.07, 0.2]), VOLATILITIES, YIELDS),
    ),
    "fractions": (
        Option("call", 110.0, 1.5, "european"),
        Market(100.0, RATES, 0.3, 0.02, proportional_dividends=proportional(0.03, (0.5, 1.1))),
    ),
    "fraction at expiry": (
        Option("put", 100.0, 1.0, "european"),
        Market(100.0, 0.05, 0.3, proportional_dividends=proportional(0.1, (1.0,))),
    ),
    "escrowed": (
        Option("put", 100.0, 1.0, "european"),
        Market(100.0, RATES, VOLATILITIES, 0.01, cash_dividends=cash(2.0), dividend_model="escrowed"),
    ),
    "call, escrowed, fractions, curves": (
        Option("call", 95.0, 1.0, "european"),
        Market(
            100.0,
            RATES,
            VOLATILITIES,
            YIELDS,
            cash_dividends=cash(1.5, (0.2, 1.0, 1.3)),
            proportional_dividends=proportional(0.02, (0.6,)),
            dividend_model="escrowed",
        ),
    ),
    "put never exercised": (Option("put", 100.0, 1.0), Market(95.0, -0.01, 0.3, 0.02)),
    "call never exercised": (Option("call", 100.0, 1.0), Market(95.0, RATES, 0.3, -0.005)),
}


def at_strike_one(option_type, x, tau, rate, volatility, dividend_yield):
    """Return the European price, delta and gamma on e^x for a strike of 1."""
    market = Market(math.exp(x), rate, volatility, dividend_yield)
    found = solved(ENGINE, (Option(option_type, 1.0, tau, "european"), market))
    return found.value[0], found.delta[0], found.gamma[0]


@given(x=moneyness, tau=expiries, rate=rates, dividend_yield=rates, volatility=volatilities)
def test_put_call_parity(x, tau, rate, dividend_yield, volatility):
    put, call = (at_strike_one(t, x, tau, rate, volatility, dividend_yield) for t in ("put", "call"))
    forward = math.exp(x - dividend_yield * tau) - math.exp(-rate * tau)
    scale = math.exp(abs(x) + (abs(rate) + abs(dividend_yield)) * tau)
    assert call[0] - put[0] == pytest.approx(forward, abs=1e-14 * scale)
    assert call[2] == pytest.approx(put[2], rel=1e-12)


@given(x=moneyness, tau=expiries, rate=rates, dividend_yield=rates, volatility=volatilities)
def test_the_formula_satisfies_the_equation(x, tau, rate, dividend_yield, volatility):
    """(11.51) with a yield; v_tau by central differences in tau."""
    value, delta, gamma = at_strike_one("put", x, tau, rate, volatility, dividend_yield)
    h, S = 1e-4 * tau, math.exp(x)
    later, sooner = (at_strike_one("put", x, tau + d, rate, volatility, dividend_yield)[0] for d in (h, -h))
    right = 0.5 * (volatility * S) ** 2 * gamma + (rate - dividend_yield) * S * delta - rate * value
    scale = math.exp(abs(x) + (abs(rate) + abs(dividend_yield)) * tau) / tau
    assert (later - sooner) / (2 * h) == pytest.approx(right, abs=2e-6 * scale)


def test_a_textbook_value():
    """Hull, Options, Futures and Other Derivatives: S = 42, K = 40, r = 10 %, sigma = 20 %, T = 1/2: 4.76 and 0.81."""
    market = Market(42.0, 0.1, 0.2)
    assert price(Option("call", 40.0, 0.5, "european"), market).price == pytest.approx(4.759422, abs=1e-6)
    assert price(Option("put", 40.0, 0.5, "european"), market).price == pytest.approx(0.808599, abs=1e-6)


# Curves, proportional dividends and an escrow: the expected payoff, integrated over a lognormal spot.


def integral(curve, start, end):
    return curve.integral(start, end) if isinstance(curve, PiecewiseConstant) else curve * (end - start)


def integrated_value(option, market):
    """Return the discounted expected payoff by Gauss-Legendre quadrature over the normal variable."""
    T = option.expiry
    squared = market.volatility
    if isinstance(squared, PiecewiseConstant):
        squared = PiecewiseConstant(squared.times, [value**2 for value in squared.values])
        spread = math.sqrt(squared.integral(0.0, T))
    else:
        spread = squared * math.sqrt(T)
    r, q = (integral(curve, 0.0, T) for curve in (market.rate, market.dividend_yield))
    spot = market.spot
    if market.dividend_model == "escrowed":
        due = (d for d in market.cash_dividends if 0.0 < d.time <= T)
        spot -= math.fsum(d.amount * math.exp(-integral(market.rate, 0.0, d.time)) for d in due)
    for dividend in market.proportional_dividends:
        if 0.0 < dividend.time <= T:
            spot *= 1.0 - dividend.fraction
    points, weights = np.polynomial.legendre.leggauss(60)
    sign = 1.0 if option.option_type == "put" else -1.0
    kink = (math.log(option.strike / spot) - r + q + 0.5 * spread**2) / spread
    total = 0.0
    for a, b in ((-12.0, kink - 4.0), (kink - 4.0, kink), (kink, kink + 4.0), (kink + 4.0, 12.0)):
        z = 0.5 * (a + b) + 0.5 * (b - a) * points
        paid = np.maximum(sign * (option.strike - spot * np.exp(r - q - 0.5 * spread**2 + spread * z)), 0.0)
        density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        total += 0.5 * (b - a) * float(np.dot(weights, paid * density))
    return math.exp(-r) * total


@pytest.mark.parametrize("name", EUROPEAN)
def test_the_value_is_the_expected_payoff(name):
    contract = EUROPEAN[name]
    found = solved(ENGINE, contract)
    assert found.settled[0]
    assert found.method[0] == "closed-form"
    assert found.value[0] == pytest.approx(integrated_value(*contract), abs=1e-10)
    assert found.european[0] == found.value[0]
    assert found.error[0] <= 1e-12


def test_a_lognormal_contract_is_one_in_the_flat_market_of_its_averages():
    """Rates and variance averaged, the spot less the fractions and the escrow."""
    option, market = EUROPEAN["call, escrowed, fractions, curves"]
    due = 1.5 * math.exp(-0.02 * 0.2) + 1.5 * math.exp(-0.02 * 0.4 - 0.07 * 0.6)
    rate, dividend_yield = 0.4 * 0.02 + 0.6 * 0.07, 0.3 * 0.01 - 0.7 * 0.02
    volatility = math.sqrt(0.7 * 0.04 + 0.3 * 0.16)
    flat = Market(0.98 * (100.0 - due), rate, volatility, dividend_yield)
    mine, its = solved(ENGINE, (option, market)), solved(ENGINE, (option, flat))
    assert mine.value[0] == pytest.approx(its.value[0], abs=1e-12)
    assert mine.delta[0] == pytest.approx(0.98 * its.delta[0], abs=1e-14)
    assert mine.gamma[0] == pytest.approx(0.98**2 * its.gamma[0], abs=1e-14)


# Greeks.


def bumped(contract, name, by):
    option, market = contract
    number = getattr(market, name)
    moved = (
        PiecewiseConstant(number.times, [value + by for value in number.values])
        if isinstance(number, PiecewiseConstant)
        else number + by
    )
    return option, replace(market, **{name: moved})


def central(value, h):
    """Return the first derivative by differences of fourth order."""
    return (8.0 * (value(h) - value(-h)) - (value(2 * h) - value(-2 * h))) / (12.0 * h)


@pytest.mark.parametrize("name", EUROPEAN)
def test_greeks_are_the_derivatives(name):
    contract = EUROPEAN[name]
    found = solved(ENGINE, contract, greeks="extended")

    def at(column, parameter):
        return lambda by: getattr(solved(ENGINE, bumped(contract, parameter, by), greeks="standard"), column)[
            0
        ]

    assert found.delta[0] == pytest.approx(central(at("value", "spot"), 0.05), abs=1e-8)
    assert found.gamma[0] == pytest.approx(central(at("delta", "spot"), 0.05), abs=1e-8)
    steps = {"volatility": 1e-3, "rate": 1e-3, "dividend_yield": 1e-3}
    for greek, parameter in (("vega", "volatility"), ("rho", "rate"), ("dividend_rho", "dividend_yield")):
        wanted = central(at("value", parameter), steps[parameter])
        assert getattr(found, greek)[0] == pytest.approx(wanted, abs=1e-6), greek
    assert found.vanna[0] == pytest.approx(central(at("delta", "volatility"), 1e-3), abs=1e-7)
    assert found.volga[0] == pytest.approx(central(at("vega", "volatility"), 1e-3), abs=1e-5)


def test_below_zero_the_rate_that_is_never_exercised_may_not_be_bumped_but_the_formula_can():
    found = solved(ENGINE, (Option("put", 100.0, 1.0), Market(95.0, 0.0, 0.3, 0.02)), greeks="standard")
    european = solved(
        ENGINE, (Option("put", 100.0, 1.0, "european"), Market(95.0, 0.0, 0.3, 0.02)), greeks="standard"
    )
    assert found.rho[0] == european.rho[0]


@pytest.mark.parametrize("name", EUROPEAN)
def test_theta_is_the_change_of_the_value_as_time_passes(name):
    option, market = EUROPEAN[name]

    def later(h):
        """Return the value h years from now: everything comes nearer by h."""
        shifted = {
            field: PiecewiseConstant([t - h for t in curve.times], curve.values)
            for field in ("rate", "dividend_yield", "volatility")
            if isinstance(curve := getattr(market, field), PiecewiseConstant)
        }
        cash_dividends = [CashDividend(d.time - h, d.amount) for d in market.cash_dividends]
        fractions = [{"time": d.time - h, "fraction": d.fraction} for d in market.proportional_dividends]
        events = {"cash_dividends": cash_dividends, "proportional_dividends": fractions}
        moved = replace(market, **shifted, **events)
        return solved(ENGINE, (replace(option, expiry=option.expiry - h), moved)).value[0]

    assert solved(ENGINE, (option, market)).theta[0] == pytest.approx(central(later, 1e-4), abs=1e-6)


@pytest.mark.parametrize("name", EUROPEAN)
def test_buckets_are_the_derivatives_by_the_pieces_and_sum_to_the_whole(name):
    contract = option, market = EUROPEAN[name]
    found = solved(ENGINE, contract, greeks="extended")
    whole = {"rate": "rho", "dividend_yield": "dividend_rho", "volatility": "vega"}
    for parameter, greek in whole.items():
        buckets = getattr(found, f"{parameter}_buckets").row(0)
        curve = getattr(market, parameter)
        if not isinstance(curve, PiecewiseConstant):
            assert buckets == ()
            continue
        assert len(buckets) == len(curve.values)
        assert sum(buckets) == pytest.approx(getattr(found, greek)[0], abs=1e-10)

        def at(piece, curve=curve, parameter=parameter):
            def value(by):
                values = [v + by * (k == piece) for k, v in enumerate(curve.values)]
                moved = replace(market, **{parameter: PiecewiseConstant(curve.times, values)})
                return solved(ENGINE, (option, moved)).value[0]

            return value

        for piece, bucket in enumerate(buckets):
            assert bucket == pytest.approx(central(at(piece), 1e-3), abs=1e-6), (parameter, piece)


@pytest.mark.parametrize("name", ["escrowed", "call, escrowed, fractions, curves"])
def test_dividend_sensitivities_are_the_derivatives_by_the_amounts(name):
    option, market = EUROPEAN[name]
    found = solved(ENGINE, (option, market), greeks="standard").dividend_sensitivities.row(0)
    assert len(found) == len(market.cash_dividends)
    for k, sensitivity in enumerate(found):

        def at(by, k=k):
            amounts = [
                CashDividend(d.time, d.amount + by * (j == k)) for j, d in enumerate(market.cash_dividends)
            ]
            return solved(ENGINE, (option, replace(market, cash_dividends=amounts))).value[0]

        assert sensitivity == pytest.approx(central(at, 0.01), abs=1e-8)
        assert (sensitivity == 0.0) == (market.cash_dividends[k].time > option.expiry)


def test_no_greeks_by_parameters_unless_asked_for():
    found = solved(ENGINE, EUROPEAN["escrowed"])
    for name in ("vega", "rho", "dividend_rho", "vanna", "volga"):
        assert math.isnan(getattr(found, name)[0])
    assert math.isnan(solved(ENGINE, EUROPEAN["escrowed"], greeks="standard").volga[0])


# Which contracts have a formula.


@pytest.mark.parametrize("rate", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("dividend_yield", [-0.02, 0.0, 0.02])
def test_never_exercised_by_the_sign_of_the_rates(rate, dividend_yield):
    market = Market(100.0, rate, 0.2, dividend_yield)
    book = Book.of([(Option("put", 1.0, 1.0), market), (Option("call", 1.0, 1.0), market)])
    never = [rate <= 0 and rate <= dividend_yield, dividend_yield <= 0 and dividend_yield <= rate]
    assert ENGINE.serves(book).tolist() == never


@pytest.mark.parametrize(
    ("option", "market", "served"),
    [
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), False),
        (Option("put", 100.0, 1.0), Market(0.0, 0.05, 0.2), True),
        (Option("put", 100.0, 0.0), Market(100.0, 0.05, 0.2), True),
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.0), True),
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, 1e-6), True),
        (Option("put", 100.0, 1.0, "european"), Market(100.0, 0.05, 0.2, cash_dividends=cash(1.0)), False),
        (Option("put", 100.0, 1.0, "bermudan", (0.5, 1.0)), Market(100.0, 0.05, 0.2), False),
        (Option("put", 100.0, 1.0, "bermudan", (0.5, 1.0)), Market(100.0, -0.01, 0.2), True),
        (Option("put", 100.0, 1.0, "bermudan", (1.0,)), Market(100.0, 0.05, 0.2), True),
        (Option("put", 100.0, 1.0, exercise_start=1.0), Market(100.0, 0.05, 0.2), True),
        (Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2, cash_dividends=cash(1.0)), False),
        (Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2, cash_dividends=cash(1.0, (1.5,))), True),
        # Just before a dividend at expiry.
        (Option("call", 100.0, 1.0, "bermudan", (1.0,)), EUROPEAN["call, escrowed, fractions, curves"][1], False),
        (Option("put", 100.0, 1.0), Market(100.0, PiecewiseConstant([0.5, 1.0], [-0.01, 0.01]), 0.2), False),
        (Option("put", 100.0, 1.0), Market(100.0, PiecewiseConstant([0.5, 1.0], [-0.01, -0.02]), 0.2), True),
    ],
)  # fmt: skip
def test_what_has_a_formula_is_served(option, market, served):
    assert ENGINE.serves(Book.of([(option, market)])).tolist() == [served]
    among = Book.of([EUROPEAN["flat"], (option, market), EUROPEAN["escrowed"]])
    assert ENGINE.serves(among).tolist() == [True, served, True]


# Nothing uncertain: expired, no volatility, a spot of zero.


@pytest.mark.parametrize("exercise", ["american", "european"])
@pytest.mark.parametrize("spot", [0.0, 80.0, 100.0, 130.0])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_an_expired_option_is_worth_its_payoff(option_type, spot, exercise):
    option = Option(option_type, 100.0, 0.0, exercise)
    found = solved(ENGINE, (option, Market(spot, 0.05, 0.2)), greeks="standard")
    assert (found.value[0], found.european[0]) == (option.payoff(spot),) * 2
    assert found.error[0] == ROUNDING * option.payoff(spot)
    assert found.exercised[0] == (option.payoff(spot) > 0.0)
    slope = 0.0 if option.payoff(spot) == 0.0 else (-1.0 if option_type == "put" else 1.0)
    assert (found.delta[0], found.gamma[0], found.theta[0], found.vega[0]) == (slope, 0.0, 0.0, 0.0)
    assert (found.method[0], found.settled[0]) == ("expired", True)


@pytest.mark.parametrize(("rate", "value", "exercised"), [(0.05, 100.0, True), (-0.05, 105.12710964, False)])
@pytest.mark.parametrize("dividends", [(), cash(3.0, (0.5,))], ids=["flat", "dividend"])
def test_a_spot_of_zero_has_an_exact_value(rate, value, exercised, dividends):
    market = Market(0.0, rate, 0.2, cash_dividends=dividends)
    put = solved(ENGINE, (Option("put", 100.0, 1.0), market))
    assert put.settled[0]
    assert put.value[0] == pytest.approx(value, abs=1e-8)
    assert put.exercised[0] == exercised
    call = solved(ENGINE, (Option("call", 100.0, 1.0), market))
    assert (call.value[0], call.delta[0], call.exercised[0]) == (0.0, 0.0, False)


@pytest.mark.parametrize("rate", [0.05, -0.05])
def test_next_to_a_spot_of_zero_the_derivatives_are_those_of_what_is_held(rate):
    """The put is K less the spot now, or K e^{-rT} less the spot with its dividends at expiry."""
    found = solved(ENGINE, (Option("put", 100.0, 1.0), Market(0.0, rate, 0.2, 0.03)), greeks="standard")
    if rate > 0.0:
        assert (found.delta[0], found.rho[0], found.theta[0]) == (-1.0, 0.0, 0.0)
    else:
        worth = 100.0 * math.exp(0.05)
        assert found.value[0] == pytest.approx(worth, abs=1e-12)
        assert found.rho[0] == pytest.approx(-worth, rel=1e-6)
        assert found.theta[0] == pytest.approx(rate * worth, rel=1e-12)


def test_on_a_spot_of_zero_no_dividend_matters():
    market = Market(0.0, 0.05, 0.2, cash_dividends=cash(3.0, (0.5,)))
    for option in (Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)):
        found = solved(ENGINE, (option, market), greeks="standard")
        assert found.dividend_sensitivities.row(0) == (0.0,)


def best_on_a_path(option, market):
    """Return the best of very many times to exercise on the spot's certain path; slow, and knows no formula."""
    T, sign = option.expiry, 1.0 if option.option_type == "put" else -1.0
    events = sorted(
        [(d.time, 0, d.fraction) for d in market.proportional_dividends if 0.0 < d.time <= T]
        + [(d.time, 1, d.amount) for d in market.cash_dividends if 0.0 < d.time <= T]
    )
    times = np.unique(
        [*np.linspace(0.0, T, 20_001), *(time for time, _, _ in events), *option.exercise_times]
    )
    best, spot, last, paid = 0.0, market.spot, 0.0, 0
    american = option.exercise == "american"

    def exercised(time, spot):
        return math.exp(-integral(market.rate, 0.0, time)) * sign * (option.strike - spot)

    for time in times.tolist():
        growth = integral(market.rate, last, time) - integral(market.dividend_yield, last, time)
        spot, last = spot * math.exp(growth), time
        allowed = time >= option.exercise_start if american else time in option.exercise_times
        best = max(best, exercised(time, spot)) if allowed else best
        while paid < len(events) and events[paid][0] <= time:
            _, kind, size = events[paid]
            spot, paid = max(spot * (1.0 - size) if kind == 0 else spot - size, 0.0), paid + 1
        if american and allowed:  # just after the dividends
            best = max(best, exercised(time, spot))
    return max(best, exercised(T, spot), 0.0)


CERTAIN = {
    "put, flat": (Option("put", 120.0, 40.0), Market(100.0, 0.01, 0.0, 0.5)),
    "call, flat": (Option("call", 60.0, 10.0), Market(100.0, 0.03, 0.0, 0.04)),
    "put, dividends": (Option("put", 100.0, 2.0), Market(100.0, 0.05, 0.0, cash_dividends=cash(3.0))),
    "call, dividends": (Option("call", 90.0, 1.0), Market(100.0, 0.02, 0.0, cash_dividends=cash(3.0))),
    "put, fractions": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.08, 0.0, proportional_dividends=proportional(0.02)),
    ),
    "put, curves": (Option("put", 105.0, 1.5), Market(100.0, RATES, 0.0, YIELDS)),
    "put, negative rates": (Option("put", 120.0, 3.0), Market(100.0, -0.02, 0.0, -0.05)),
    "put, dates": (Option("put", 110.0, 1.0, "bermudan", (0.25, 0.75)), Market(100.0, 0.05, 0.0)),
    "put, window": (Option("put", 110.0, 1.0, exercise_start=0.5), Market(100.0, 0.05, 0.0)),
    "put, spot gone": (
        Option("put", 110.0, 1.0),
        Market(100.0, 0.05, 0.0, cash_dividends=cash(200.0, (0.5,))),
    ),
    "European call": (
        Option("call", 90.0, 1.0, "european"),
        Market(100.0, 0.02, 0.0, cash_dividends=cash(3.0)),
    ),
}


@pytest.mark.parametrize("name", CERTAIN)
def test_a_certain_value_is_that_of_the_best_time_to_exercise(name):
    contract = CERTAIN[name]
    wanted = best_on_a_path(*contract)
    assert certain_value(Book.of([contract]))[0] == pytest.approx(
        wanted, abs=1e-5
    )  # 1e-6: the times are apart
    found = solved(ENGINE, contract)
    assert found.settled[0]
    assert found.value[0] == certain_value(Book.of([contract]))[0]
    assert found.error[0] == ROUNDING * found.value[0]


@pytest.mark.parametrize(
    ("option_type", "spot", "strike", "expiry", "rate", "dividend_yield", "expected"),
    OPTIMAL_STOPPING,
)
def test_zero_volatility_is_optimal_stopping_without_chance(
    option_type, spot, strike, expiry, rate, dividend_yield, expected
):
    contract = Option(option_type, strike, expiry), Market(spot, rate, 0.0, dividend_yield)
    assert solved(ENGINE, contract).value[0] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("volatility", [1e-7, 1e-6, 1e-5])
def test_chance_that_is_left_out_counts_as_error(volatility):
    contract = Option("put", 100.0, 1.0, "bermudan", (0.5, 1.0)), Market(100.0, 0.05, volatility)
    found = solved(ENGINE, contract, tolerance=1e-4)
    spread = volatility  # sqrt(1 year)
    assert found.error[0] == pytest.approx(2.0 * 100.0 * spread, rel=1e-6)
    assert found.settled[0] == (found.error[0] <= 0.1 * 1e-4 * 100.0)


def test_greeks_on_a_certain_path_are_those_of_the_best_time():
    """A call held to expiry is S e^{-qT} - K e^{-rT}, a put exercised now K - S."""
    held = Option("call", 50.0, 1.0), Market(100.0, 0.05, 0.0, 0.01)
    now = Option("put", 120.0, 1.0), Market(100.0, 0.05, 0.0, 0.01)
    found = solved(ENGINE, held, now, greeks="standard")
    bond, stock = 50.0 * math.exp(-0.05), 100.0 * math.exp(-0.01)
    assert found.delta == pytest.approx([math.exp(-0.01), -1.0], abs=1e-9)
    assert found.rho == pytest.approx([bond, 0.0], abs=1e-6)
    assert found.dividend_rho == pytest.approx([-stock, 0.0], abs=1e-6)
    assert found.theta == pytest.approx([0.01 * stock - 0.05 * bond, 0.0], abs=1e-7)
    assert found.exercised.tolist() == [False, True]
    assert found.boundary[1] == pytest.approx(120.0)


# Boundaries.


def test_boundaries_of_what_is_certain_or_never_exercised():
    times, request = np.array([0.0, 0.5, 1.0]), Request(np.array([1e-6]))

    def ends(option, market):
        return ENGINE.boundary(Book.of([(option, market)]), request)(times * option.expiry)

    sure = ends(Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.0, 0.06))
    assert sure.found.all()
    assert sure.near == pytest.approx([50.0] * 3)
    never = ends(Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2))
    assert never.found.all()
    assert np.isnan(never.near[:2]).all()
    two = ends(Option("put", 100.0, 1.0), Market(100.0, -0.02, 0.0, -0.04))
    assert (two.near[0], two.far[0]) == (pytest.approx(100.0), pytest.approx(50.0))
    unsure = ends(Option("put", 100.0, 1.0), Market(0.0, 0.05, 0.2))
    assert not unsure.found.any()


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
def test_a_row_does_not_depend_on_the_others(greeks):
    contracts = [*EUROPEAN.values(), *CERTAIN.values(), (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2))]
    together = solved(ENGINE, *contracts, greeks=greeks)
    for row, contract in enumerate(contracts):
        alone = solved(ENGINE, contract, greeks=greeks)
        for name in ("value", "european", "error", "delta", "gamma", "theta", "vega", "rho", "volga"):
            np.testing.assert_array_equal(getattr(together, name)[row], getattr(alone, name)[0], err_msg=name)
        for name in ("dividend_sensitivities", "rate_buckets", "volatility_buckets"):
            assert getattr(together, name).row(row) == getattr(alone, name).row(0), name


def test_with_a_dividend_at_expiry_the_certain_boundary_is_not_that_without_events():
    """Exercise just before the dividend at 1.0 brings K - S, holding K - (S - 5): never below the strike then."""
    market = Market(100.0, 0.05, 0.0, cash_dividends=(CashDividend(1.0, 5.0),))
    boundary = exercise_boundary(Option("put", 100.0, 1.0), market, times=[0.3, 0.9, 1.0]).boundary
    assert boundary[0] == pytest.approx(3.47, abs=0.05)
    assert boundary[1] == pytest.approx(0.54, abs=0.05)
    assert math.isnan(boundary[2])


def test_at_the_kink_of_a_certain_put_nothing_is_worth_nothing():
    found = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.0))
    assert (found.price, found.delta, found.theta) == (0.0, 0.0, 0.0)
