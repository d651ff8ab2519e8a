"""Volatilities of the forward from those of a spot that drops by cash dividends."""

import datetime as dt

import numpy as np
import pyarrow as pa
import pytest
from scipy.special import ndtr

from pricing_core.american import price_many
from pricing_core.arrays import Vector
from pricing_core.chains.forward_volatilities import of_forward
from pricing_core.chains.quotes import Quotes
from pricing_core.chains.volatilities import QuoteVolatilities

SPOT, RATE = 100.0, 0.03


def black(is_call: np.ndarray, forward: Vector, strike: Vector, spread: Vector) -> Vector:
    """Return Black's undiscounted price (1976)."""
    d = np.log(forward / strike) / spread + 0.5 * spread
    sign = np.where(is_call, 1.0, -1.0)
    return np.asarray(sign * (forward * ndtr(sign * d) - strike * ndtr(sign * (d - spread))))


def quotes_of(seed: int, count: int = 60) -> Quotes:
    rng = np.random.default_rng(seed)
    expiry = rng.uniform(0.05, 2.0, count)
    strike = SPOT * np.exp(0.5 * np.sqrt(expiry) * rng.uniform(-0.6, 0.6, count))
    nothing, none = np.full(count, np.nan), pa.table({})
    return Quotes(
        none, dt.date(2026, 1, 2), SPOT, "american", np.ones(count, dtype=bool), expiry, strike, nothing,
        nothing, rng.random(count) < 0.5,
    )  # fmt: skip


def volatilities(quotes: Quotes, european_price: Vector, volatility: float) -> QuoteVolatilities:
    mid = np.full(quotes.strike.size, volatility)
    status = np.full(mid.size, "ok", dtype=object)
    return QuoteVolatilities(0.98 * mid, mid, 1.02 * mid, european_price, european_price, status)


@pytest.mark.parametrize("seed", range(5))
def test_a_dividend_just_before_expiry_moves_spot_and_strike_alike(seed: int) -> None:
    """The spot is lognormal up to it: the price is Black's of F + D and K + D, of which the volatility is known."""
    quotes, amount, volatility = quotes_of(seed), 6.0, 0.3
    discount = np.exp(-RATE * quotes.expiry)
    grown, spread = SPOT / discount, volatility * np.sqrt(quotes.expiry)
    price = discount * black(quotes.is_call, grown, quotes.strike + amount, spread)
    found = of_forward(quotes, volatilities(quotes, price, volatility), grown - amount, discount)
    again = discount * black(
        quotes.is_call, grown - amount, quotes.strike, found.mid * np.sqrt(quotes.expiry)
    )
    np.testing.assert_allclose(again, price, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(found.ask / found.mid, 1.02, rtol=1e-14)
    assert np.all(found.mid > volatility)


def test_the_european_prices_of_the_engine_are_met_behind_several_dividends() -> None:
    quotes = quotes_of(7)
    dividends = [{"time": time, "amount": 1.5} for time in (0.02, 0.5, 1.0, 1.5)]
    table = price_many(
        {
            "option_type": quotes.option_type, "exercise": "european", "spot": SPOT, "strike": quotes.strike,
            "expiry": quotes.expiry, "rate": RATE, "volatility": 0.3,
            "cash_dividends": [dividends] * quotes.strike.size,
        },
        tolerance=1e-8, greeks="none",
    )  # fmt: skip
    discount = np.exp(-RATE * quotes.expiry)
    paid = [sum(1.5 * np.exp(-RATE * d["time"]) for d in dividends if d["time"] <= T) for T in quotes.expiry]
    forward = (SPOT - np.array(paid)) / discount
    found = of_forward(quotes, volatilities(quotes, table["price"], 0.3), forward, discount)
    price = discount * black(quotes.is_call, forward, quotes.strike, found.mid * np.sqrt(quotes.expiry))
    np.testing.assert_allclose(price, table["price"], atol=1e-9)
    late = quotes.expiry > 0.5
    assert np.all(found.mid[late] > 0.3)
    assert np.all(found.mid[late] < 0.3 * 1.1)


def test_a_price_without_time_value_has_no_volatility_of_the_forward() -> None:
    quotes = quotes_of(8, count=2)
    discount = np.ones(2)
    intrinsic = np.maximum(np.where(quotes.is_call, 1.0, -1.0) * (SPOT - quotes.strike), 0.0)
    found = of_forward(quotes, volatilities(quotes, intrinsic, 0.3), np.full(2, SPOT), discount)
    assert np.isnan(found.mid).all()
