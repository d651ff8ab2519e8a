"""Random contracts with events: dividends of both kinds, curves, exercise dates, escrow."""

import numpy as np

from pricing_core.american import Market, Option


def random_curve(rng, expiry, least, most):
    times = np.sort(rng.uniform(0.02, 0.95, 3)) * expiry
    return {"times": [*times, expiry], "values": list(rng.uniform(least, most, 4))}


def random_contracts(seed, count):
    """Return (option, market) pairs of every kind of event."""
    rng = np.random.default_rng(seed)
    contracts = []
    while len(contracts) < count:
        expiry = float(np.exp(rng.uniform(np.log(0.05), np.log(3.0))))
        times = rng.uniform(0.0, expiry, rng.integers(1, 6))
        kind = rng.choice(["cash", "fractions", "curves", "bermudan", "escrowed"])
        option = Option(str(rng.choice(["put", "call"])), 100.0, expiry)
        events = {
            "cash_dividends": [
                {"time": t, "amount": float(np.exp(rng.uniform(np.log(0.1), np.log(3.0))))} for t in times
            ]
        }
        volatility = rng.uniform(0.1, 0.7)
        rate, dividend_yield = rng.uniform(0.005, 0.08), float(rng.choice([0.0, 0.03]))
        if kind == "fractions":
            amounts = events.pop("cash_dividends")
            events["proportional_dividends"] = [
                {"time": dividend["time"], "fraction": 0.01 * dividend["amount"]} for dividend in amounts
            ]
        elif kind == "curves":
            rate, dividend_yield = random_curve(rng, expiry, 0.0, 0.08), random_curve(rng, expiry, 0.0, 0.06)
            volatility = random_curve(rng, expiry, 0.6 * volatility, 1.4 * volatility)
        elif kind == "bermudan":
            option = Option(option.option_type, 100.0, expiry, "bermudan", (*np.sort(times), expiry))
        elif kind == "escrowed":
            events["dividend_model"] = "escrowed"
        spot = 100.0 * float(np.exp(rng.normal(0.0, 0.2)))
        contracts.append((option, Market(spot, rate, volatility, dividend_yield, **events)))
    return contracts
