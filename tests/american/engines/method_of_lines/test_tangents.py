"""Derivatives carried along with the value, against differences of values at a tight tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, PiecewiseConstant
from pricing_core.american.engines.method_of_lines import MethodOfLines
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel

DIVIDENDS = [{"time": 0.25, "amount": 2.0}, {"time": 0.75, "amount": 2.0}]
PUT, CALL = Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)
FLAT = {
    "put": (PUT, Market(100.0, 0.05, 0.2)),
    "call": (CALL, Market(95.0, 0.03, 0.3, 0.06)),
    "call with two boundaries": (replace(CALL, expiry=0.85796), Market(94.5405, -0.03784, 0.19155, -0.0195)),
    "put with two boundaries": (replace(PUT, expiry=1.4), Market(92.0, -0.01, 0.25, -0.04)),
    "put with dividends": (PUT, Market(100.0, 0.05, 0.25, cash_dividends=DIVIDENDS)),
    "call with escrowed dividends": (
        CALL,
        Market(105.0, 0.05, 0.25, cash_dividends=DIVIDENDS, dividend_model="escrowed"),
    ),
    "put that a dividend may take to zero": (
        PUT,
        Market(60.0, 0.05, 0.5, cash_dividends=[{"time": 0.5, "amount": 50.0}]),
    ),
    "call before a proportional dividend": (
        CALL,
        Market(105.0, 0.03, 0.25, proportional_dividends=[{"time": 0.5, "fraction": 0.05}]),
    ),
    "Bermudan put": (
        replace(PUT, exercise="bermudan", exercise_times=[0.25, 0.5, 1.0]),
        Market(100.0, 0.05, 0.25),
    ),
    "European put": (replace(PUT, exercise="european"), Market(100.0, 0.05, 0.25, cash_dividends=DIVIDENDS)),
}


def values(option, market, tolerance=1e-8):
    found = solved(MethodOfLines(), (option, market), tolerance=tolerance)
    return np.array([found.value[0], found.delta[0]])


def slope(value, h):
    """Return the derivative at 0 by differences of fourth order."""
    return (8.0 * (value(h) - value(-h)) - (value(2.0 * h) - value(-2.0 * h))) / (12.0 * h)


@pytest.mark.nightly
@needs_kernel
@pytest.mark.parametrize("name", FLAT)
def test_greeks_are_differences_of_prices(name):
    option, market = FLAT[name]
    found = solved(MethodOfLines(), (option, market), greeks="extended")

    def by(field, h):
        return slope(lambda x: values(option, replace(market, **{field: getattr(market, field) + x})), h)

    def in_time(x):
        later = [replace(each, time=each.time + x) for each in market.cash_dividends]
        later_share = [replace(each, time=each.time + x) for each in market.proportional_dividends]
        dates = [time + x for time in option.exercise_times]
        return -values(
            replace(option, expiry=option.expiry + x, exercise_times=dates),
            replace(market, cash_dividends=later, proportional_dividends=later_share),
        )

    expected = dict(zip(("vega", "vanna"), by("volatility", 0.01 * market.volatility), strict=True))
    expected["rho"] = by("rate", 2e-4)[0]
    expected["dividend_rho"] = by("dividend_yield", 2e-4)[0]
    expected["theta"], expected["charm"] = slope(in_time, 0.005 * option.expiry)
    for greek, truth in expected.items():
        number, error = getattr(found, greek)[0], getattr(found, f"{greek}_error")[0]
        assert error <= 5e-3 * max(abs(truth), 1.0), greek
        assert number == pytest.approx(truth, abs=error + 1e-4), greek

    def vega(x):
        shifted = replace(market, volatility=market.volatility + x)
        return solved(MethodOfLines(), (option, shifted), tolerance=1e-7, greeks="standard").vega[0]

    h = 0.02 * market.volatility
    volga = (vega(h) - vega(-h)) / (2.0 * h)
    assert found.volga[0] == pytest.approx(volga, abs=2.0 * found.volga_error[0])


@needs_kernel
@pytest.mark.parametrize("model", ["spot", "escrowed"])
@pytest.mark.parametrize("option", [PUT, CALL], ids=["put", "call"])
def test_dividend_sensitivities_are_differences_of_prices(option, model):
    market = Market(103.0, 0.05, 0.25, cash_dividends=DIVIDENDS, dividend_model=model)
    found = solved(MethodOfLines(), (option, market), greeks="standard")
    for entry in range(2):

        def value(x, entry=entry):
            paid = [*market.cash_dividends]
            paid[entry] = replace(paid[entry], amount=paid[entry].amount + x)
            return values(option, replace(market, cash_dividends=paid))[0]

        error = found.dividend_sensitivities_error.row(0)[entry]
        assert error < 2e-3
        assert found.dividend_sensitivities.row(0)[entry] == pytest.approx(
            slope(value, 0.05), abs=error + 1e-5
        )


@needs_kernel
def test_buckets_add_up_to_the_parallel_shift():
    market = Market(
        100.0,
        PiecewiseConstant([0.4, 1.5], [0.02, 0.07]),
        PiecewiseConstant([0.5, 1.5], [0.2, 0.4]),
        PiecewiseConstant([0.3, 1.5], [0.01, -0.02]),
    )
    found = solved(MethodOfLines(), (Option("put", 110.0, 1.5), market), greeks="extended")
    for greek, buckets in (
        ("rho", "rate_buckets"),
        ("dividend_rho", "dividend_yield_buckets"),
        ("vega", "volatility_buckets"),
    ):
        total = sum(getattr(found, buckets).row(0))
        assert total == pytest.approx(getattr(found, greek)[0], rel=1e-9), greek
        assert len(getattr(found, f"{buckets}_error").row(0)) == 2
