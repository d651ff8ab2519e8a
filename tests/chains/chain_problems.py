"""Chains with a known truth: a displaced diffusion, whose American options are those of a flat volatility, moved."""

from dataclasses import dataclass

import numpy as np

from pricing_core.american import implied_volatility_many, price_many

SPOT, RATE, DISPLACEMENT, LEVEL = 100.0, 0.05, 50.0, 0.25
EXPIRIES = np.array([14, 30, 60, 120, 240, 365, 730]) / 365.0


@dataclass(frozen=True)
class KnownChain:
    """Options in columns of shape (n,): with q = r the spot plus the displacement is lognormal, and so F + d.

    American and European options at (S + d, K + d) with a flat volatility are then those at (S, K).
    """

    option_type: np.ndarray
    strike: np.ndarray
    expiry: np.ndarray
    price: np.ndarray
    volatility: np.ndarray  # of the European options
    half_spread: np.ndarray

    def chain(self, mid: np.ndarray) -> dict:
        """Return quotes around these mids as `implied_carry` takes them."""
        columns = {"option_type": self.option_type, "strike": self.strike, "expiry": self.expiry}
        quotes = {"bid": mid - self.half_spread, "ask": mid + self.half_spread}
        return {**columns, **quotes, "spot": SPOT, "rate": RATE}


def displaced_chain(strikes_per_expiry: int = 23, expiries: np.ndarray = EXPIRIES) -> KnownChain:
    """Return a chain of calls and puts within 2.2 standard deviations."""
    steps = np.linspace(-2.2, 2.2, strikes_per_expiry)
    strikes = [np.round(SPOT * np.exp(steps * LEVEL * np.sqrt(time)), 1) for time in expiries]
    strike = np.concatenate([np.tile(row, 2) for row in strikes])
    expiry = np.repeat(expiries, 2 * strikes_per_expiry)
    option_type = np.tile(np.repeat(["call", "put"], strikes_per_expiry), expiries.size)
    moved = {
        "option_type": option_type,
        "spot": SPOT + DISPLACEMENT,
        "strike": strike + DISPLACEMENT,
        "expiry": expiry,
        "rate": RATE,
        "dividend_yield": RATE,
        "volatility": LEVEL * SPOT / (SPOT + DISPLACEMENT),
    }
    table = price_many(moved, tolerance=1e-8, greeks="none")
    at_spot = {**moved, "spot": SPOT, "strike": strike, "exercise": "european"}
    del at_spot["volatility"]
    found = implied_volatility_many(at_spot, table["european_price"], tolerance=1e-8)
    price = table["price"]
    return KnownChain(option_type, strike, expiry, price, found["volatility"], 0.01 + 0.005 * np.sqrt(price))
