import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.american import Market, Option, price
from pricing_core.american.flat.closed_form import european_values, perpetual_boundary

rates = st.floats(-0.2, 0.3)
volatilities = st.floats(0.02, 2.0)
expiries = st.floats(0.01, 20.0)
moneyness = st.floats(-2.0, 2.0)


def european(option_type, spot, market_changes=None, expiry=1.0):
    market = Market(
        spot, **{"rate": 0.05, "volatility": 0.25, "dividend_yield": 0.03, **(market_changes or {})}
    )
    return price(Option(option_type, 100.0, expiry, "european"), market)


@given(x=moneyness, tau=expiries, rate=rates, dividend_yield=rates, volatility=volatilities)
def test_put_call_parity(x, tau, rate, dividend_yield, volatility):
    market = Market(1.0, rate, volatility, dividend_yield)
    put, call = (european_values(t, np.array([x]), tau, market) for t in ("put", "call"))
    forward = math.exp(x - dividend_yield * tau) - math.exp(-rate * tau)
    scale = math.exp(abs(x) + (abs(rate) + abs(dividend_yield)) * tau)
    assert call.value[0] - put.value[0] == pytest.approx(forward, abs=1e-14 * scale)
    assert call.curvature[0] == pytest.approx(put.curvature[0], rel=1e-12)


@given(x=moneyness, tau=expiries, rate=rates, dividend_yield=rates, volatility=volatilities)
def test_the_formula_satisfies_the_equation(x, tau, rate, dividend_yield, volatility):
    """(11.51) with a yield; v_tau by central differences in tau."""
    market = Market(1.0, rate, volatility, dividend_yield)
    v = european_values("put", np.array([x]), tau, market)
    h = 1e-4 * tau
    later, sooner = (european_values("put", np.array([x]), tau + d, market).value[0] for d in (h, -h))
    right = 0.5 * volatility**2 * v.curvature[0] + (rate - dividend_yield) * v.slope[0] - rate * v.value[0]
    scale = math.exp(abs(x) + (abs(rate) + abs(dividend_yield)) * tau) / tau
    assert (later - sooner) / (2 * h) == pytest.approx(right, abs=2e-6 * scale)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_greeks_are_the_derivatives(option_type):
    v = european(option_type, 95.0)

    def central(f, h):
        return (f(h) - f(-h)) / (2 * h)

    assert v.delta == pytest.approx(central(lambda d: european(option_type, 95 + d).price, 1e-3), abs=1e-8)
    assert v.gamma == pytest.approx(central(lambda d: european(option_type, 95 + d).delta, 1e-3), abs=1e-8)
    for greek, name in (("vega", "volatility"), ("rho", "rate"), ("dividend_rho", "dividend_yield")):
        base = {"rate": 0.05, "volatility": 0.25, "dividend_yield": 0.03}[name]
        bumped = central(lambda d, n=name, b=base: european(option_type, 95.0, {n: b + d}).price, 1e-5)
        assert getattr(v, greek) == pytest.approx(bumped, abs=1e-5)
    assert v.theta == pytest.approx(
        -central(lambda d: european(option_type, 95.0, expiry=1 + d).price, 1e-5), abs=1e-6
    )


def test_a_textbook_value():
    """Hull, Options, Futures and Other Derivatives: S = 42, K = 40, r = 10 %, sigma = 20 %, T = 1/2: 4.76 and 0.81."""
    market = Market(42.0, 0.1, 0.2)
    assert price(Option("call", 40.0, 0.5, "european"), market).price == pytest.approx(4.759422, abs=1e-6)
    assert price(Option("put", 40.0, 0.5, "european"), market).price == pytest.approx(0.808599, abs=1e-6)


@pytest.mark.parametrize("option_type", ["put", "call"])
@given(rate=st.floats(0.001, 0.5), dividend_yield=st.floats(0.001, 0.5), volatility=st.floats(0.001, 3.0))
def test_perpetual_boundary_satisfies_its_quadratic(option_type, rate, dividend_yield, volatility):
    boundary = perpetual_boundary(Market(1.0, rate, volatility, dividend_yield), option_type)
    assert boundary < 1.0 if option_type == "put" else boundary > 1.0
    L = boundary / (boundary - 1.0)  # for both: S*/K = L/(L - 1)
    drift = rate - dividend_yield - 0.5 * volatility**2
    terms = (0.5 * volatility**2 * L * L, drift * L, -rate)
    assert sum(terms) == pytest.approx(0.0, abs=1e-6 * max(map(abs, terms)))


def test_perpetual_boundary_is_where_nothing_is_exercised():
    assert perpetual_boundary(Market(1.0, 0.0, 0.2, 0.05), "put") == 0.0
    assert perpetual_boundary(Market(1.0, 0.05, 0.2, 0.0), "call") == math.inf
