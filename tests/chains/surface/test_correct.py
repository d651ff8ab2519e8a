"""Early exercise premiums from one march, and surfaces corrected until American quotes reprice."""

import math

import numpy as np
import pytest

from pricing_core.american import LocalVolatility, Market, implied_volatility_many, price_many
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.chains.surface.correct import correct
from pricing_core.chains.surface.early_exercise import early_exercise
from pricing_core.chains.surface.fit import fit_surface
from pricing_core.chains.surface.smile_quotes import AmericanQuotes, SmileQuotes
from pricing_core.errors import InvalidInputError
from tests.problems.smiles import displaced

DIVIDENDS = [{"time": 0.12, "amount": 0.6}, {"time": 0.37, "amount": 0.6}, {"time": 0.62, "amount": 0.6}]
SHIFT, SCALE, RATE = -0.3, 0.25, 0.05


@pytest.mark.parametrize("dividends", [[], DIVIDENDS], ids=["yield", "cash"])
@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("expiry", [0.1, 0.8])
def test_premiums_extrapolated_are_those_of_the_engines_under_a_flat_volatility(
    option_type, expiry, dividends
):
    market = Market(100.0, rate=0.05, volatility=0.25, dividend_yield=0.03, cash_dividends=dividends)
    strike, spread = (
        100.0 * np.exp(np.linspace(-2.0, 2.0, 13) * 0.25 * math.sqrt(expiry)),
        0.25 * math.sqrt(expiry),
    )
    flat = LocalVolatility([0.0, 1.0], [50.0, 200.0], [[0.25, 0.25], [0.25, 0.25]])
    coordinates = Coordinates(market, expiry)
    premiums = early_exercise(flat, market, coordinates, option_type, strike, expiry, spread)
    columns = {"option_type": option_type, "spot": 100.0, "strike": strike, "expiry": expiry, "rate": 0.05}
    columns |= {"dividend_yield": 0.03, "volatility": 0.25} | (
        {"cash_dividends": dividends} if dividends else {}
    )
    table = price_many(columns, tolerance=1e-8, greeks="none")
    held = ~premiums.exercised
    true = (table["price"] - table["european_price"])[held]
    assert premiums.premium[held] == pytest.approx(true, abs=5e-6 * 100.0)
    ahead = np.where(option_type == "put", strike - 100.0, 100.0 - strike)
    assert np.all(ahead[premiums.exercised] > 0.0)
    assert table["price"][premiums.exercised] == pytest.approx(ahead[premiums.exercised], abs=1e-5 * 100.0)


def american_chain(noise, seed):
    """Return American quotes under a displaced diffusion, exact by shifting (q = r), and the flat-volatility smiles."""
    expiries, spot = (0.1, 0.4, 1.0), 100.0
    types, strikes, times = [], [], []
    for expiry in expiries:
        spread = math.sqrt(float(displaced(np.zeros(1), expiry, SHIFT, SCALE)[0]))
        for strike in np.round(spot * np.exp(np.linspace(-2.2, 2.0, 25) * spread), 2):
            types += ["put", "call"]
            strikes += [strike] * 2
            times += [expiry] * 2
    types, strikes, times = np.array(types), np.array(strikes), np.array(times)
    shared = {"option_type": types, "expiry": times, "rate": RATE, "dividend_yield": RATE}
    moved = {"spot": spot * (1.0 + SHIFT), "strike": strikes + spot * SHIFT, "volatility": SCALE}
    true = price_many(shared | moved, tolerance=1e-8, greeks="none")["price"]
    half = 0.01 + 0.005 * true
    mid = true + noise * half * np.random.default_rng(seed).standard_normal(true.size)
    implied = implied_volatility_many(shared | {"spot": spot, "strike": strikes}, option_price=mid)[
        "volatility"
    ]
    vega = price_many(
        shared | {"spot": spot, "strike": strikes, "volatility": np.where(implied > 0.0, implied, 0.2)}
    )["vega"]
    smiles = []
    for expiry in expiries:
        rows = np.flatnonzero(
            (times == expiry) & (types == np.where(strikes < spot, "put", "call")) & (implied > 0.0)
        )
        own = strikes[rows]
        smiles.append(
            SmileQuotes(expiry, spot, np.log(own / spot), own, implied[rows], half[rows] / vega[rows])
        )
    return smiles, AmericanQuotes(types, strikes, times, mid - half, mid + half, mid), true


MARKET = Market(100.0, rate=RATE, volatility=0.2, dividend_yield=RATE)


def test_without_noise_american_quotes_reprice_to_1e_5_of_the_spot():
    smiles, quotes, true = american_chain(0.0, 0)
    corrected = correct(fit_surface(smiles, MARKET), MARKET, quotes)
    assert corrected.surface.proof.holds
    told = corrected.informative
    assert told.sum() > 100
    assert corrected.model_price[told] == pytest.approx(true[told], abs=1e-5 * 100.0)
    assert corrected.model_price == pytest.approx(true, abs=4e-5 * 100.0)
    assert corrected.share_within_after == 1.0
    rows = np.arange(0, true.size, 19)
    columns = {"option_type": quotes.option_type[rows], "spot": 100.0, "strike": quotes.strike[rows]}
    columns |= {"expiry": quotes.expiry[rows], "rate": RATE, "dividend_yield": RATE}
    prices = price_many({**columns, "volatility": corrected.local_volatility}, tolerance=1e-6, greeks="none")
    assert prices["price"] == pytest.approx(true[rows], abs=1e-5 * 100.0)


def test_with_noise_the_correction_lies_within_its_standard_errors():
    inside = []
    for seed in range(3):
        smiles, quotes, _ = american_chain(1.0, seed)
        surface = correct(fit_surface(smiles, MARKET), MARKET, quotes).surface
        assert surface.proof.holds
        for expiry in (0.1, 0.4, 1.0):
            x = np.linspace(-2.0, 2.0, 17) * math.sqrt(float(displaced(np.zeros(1), expiry, SHIFT, SCALE)[0]))
            true = np.sqrt(displaced(x, expiry, SHIFT, SCALE) / expiry)
            error = surface.standard_error(100.0 * np.exp(x), expiry)
            inside.append(
                np.mean(np.abs(surface.volatility(100.0 * np.exp(x), expiry) - true) <= 2.0 * error)
            )
    assert (
        np.mean(inside) > 0.85
    )  # Nine smiles of some five independent errors each: the share scatters by 0.03.


def test_a_premium_that_the_flat_volatility_misses_is_corrected():
    smiles, quotes, true = american_chain(0.0, 0)
    narrow = AmericanQuotes(
        quotes.option_type, quotes.strike, quotes.expiry, true - 5e-3, true + 5e-3, quotes.mid
    )
    raised = [
        SmileQuotes(s.expiry, s.forward, s.log_moneyness, s.strike, s.volatility + 1e-3, s.deviation)
        for s in smiles
    ]
    corrected = correct(fit_surface(raised, MARKET), MARKET, narrow)
    assert corrected.share_within_before < 0.7
    assert corrected.share_within_after > 0.98


def test_quotes_that_are_not_two_sided_are_left_out():
    smiles, quotes, _ = american_chain(0.0, 0)
    bid = np.array(quotes.bid)
    bid[::2] = np.nan
    spoiled = AmericanQuotes(quotes.option_type, quotes.strike, quotes.expiry, bid, quotes.ask, quotes.mid)
    corrected = correct(fit_surface(smiles, MARKET), MARKET, spoiled, rounds=1)
    assert np.isnan(corrected.model_price[::2]).all()
    assert np.isfinite(corrected.model_price[1::2]).all()
    one_sided = AmericanQuotes(
        quotes.option_type, quotes.strike, quotes.expiry, quotes.ask, quotes.ask, quotes.mid
    )
    with pytest.raises(InvalidInputError, match="american_quotes"):
        correct(corrected.surface, MARKET, one_sided)
    with pytest.raises(InvalidInputError, match=r"option_type\[0\]"):
        AmericanQuotes(["straddle"], *([np.ones(1)] * 5))
