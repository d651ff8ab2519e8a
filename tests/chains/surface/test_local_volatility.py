"""Dupire's local volatility: against the model's, and European prices under it against the surface."""

import math

import numpy as np
import pytest

from pricing_core.american import Market, price_many
from pricing_core.chains.surface.dupire import dupire
from pricing_core.chains.surface.fit import fit_surface
from tests.problems.smiles import EXPIRIES, TRUTHS, smile_quotes, spread_at

MARKET = Market(100.0, rate=0.03, volatility=0.2, dividend_yield=0.01)


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda truth: truth.name)
def test_without_noise_it_is_that_of_the_model_to_one_percent(truth):
    found = dupire(fit_surface(smile_quotes(truth, MARKET), MARKET), MARKET)
    for time in (0.04, 0.07, 0.1, 0.18, 0.4, 0.7, 1.0, 1.5, 1.95):
        x = np.linspace(-2.0, 2.0, 21) * spread_at(truth, time)
        spots = MARKET.spot * math.exp(0.02 * time) * np.exp(x)
        assert found.at(time, spots) == pytest.approx(truth.local_volatility(x, time), rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_bounded_whatever_the_noise(seed):
    surface = fit_surface(smile_quotes(TRUTHS[0], MARKET, noise=2.0, seed=seed), MARKET)
    found = dupire(surface, MARKET)
    assert np.isfinite(found.values).all()
    assert 0.02 < found.values.min() < found.values.max() < 2.0


@pytest.mark.parametrize("expiry", [0.1, 1.0])
def test_european_options_under_it_cost_what_the_surface_says(expiry):
    dividends = [{"time": 0.05, "amount": 0.8}, {"time": 0.6, "amount": 0.8}]
    market = Market(100.0, rate=0.03, volatility=0.2, dividend_yield=0.01, cash_dividends=dividends)
    surface = fit_surface(smile_quotes(TRUTHS[0], MARKET), market)
    strike = surface.coordinates.forward(expiry) * np.exp(
        np.array([-1.5, 0.0, 1.5]) * 0.25 * math.sqrt(expiry)
    )
    columns = {
        "option_type": "put",
        "exercise": "european",
        "spot": 100.0,
        "strike": strike,
        "expiry": expiry,
    }
    columns |= {"rate": 0.03, "dividend_yield": 0.01, "cash_dividends": dividends}
    prices = price_many({**columns, "volatility": dupire(surface, market)}, tolerance=1e-6, greeks="none")
    expected = surface.european_price("put", strike, expiry)
    assert prices["price"] == pytest.approx(expected, abs=1.5e-5 * market.spot)
    assert len(EXPIRIES) == surface.expiries.size
