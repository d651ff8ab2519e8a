"""Random contracts, usual ones and extreme ones: seconds and centuries, next to no volatility and 1,500 %.

Continuous numbers alone would leave out rates of exactly 0, fractions of exactly 1 and what is the same as another.
"""

import math

import numpy as np

from pricing_core.american import Market, Option, PiecewiseConstant

KINDS = ("none", "cash", "escrowed", "fractions", "curves", "bermudan", "window", "mixed")


def random_contracts(seed, count):
    """Return (option, market) pairs; three in ten are extreme."""
    rng = np.random.default_rng(seed)
    return [_contract(rng) for _ in range(count)]


def _contract(rng):
    extreme = rng.random() < 0.3
    if extreme:
        expiry = _between(rng, 1e-6, 200.0)
        volatility = _between(rng, 1e-5, 10.0)
        rate, dividend_yield = (float(rng.choice([-0.3, 1.0])) * _between(rng, 1e-6, 1.0) for _ in range(2))
        spot = 100.0 * math.exp(rng.normal() * rng.choice([0.1, 1.0, 5.0]))
    else:
        expiry = _between(rng, 1.0 / 365.0, 10.0)
        volatility = _between(rng, 0.05, 1.0)
        rate, dividend_yield = rng.uniform(-0.03, 0.12, 2).tolist()
        spot = 100.0 * math.exp(rng.normal() * min(volatility * math.sqrt(expiry), 0.7))
    rate, dividend_yield = [
        (rate, dividend_yield),
        (0.0, 0.0),
        (0.0, dividend_yield),
        (rate, 0.0),
        (rate, rate),
    ][rng.choice(5, p=[0.6, 0.1, 0.1, 0.1, 0.1])]
    kind, count = str(rng.choice(KINDS)), int(rng.integers(1, 13))
    if rng.random() < 0.02:
        count = int(rng.integers(40, 367))
    times = np.sort(rng.uniform(0.0, expiry, count)).tolist()
    size = _between(rng, 0.01, 0.5 if extreme else 0.05)
    shares = (size * rng.uniform(0.2, 1.0, count)).tolist()
    used_up = extreme and rng.random() < 0.2
    further = {}
    if kind in ("cash", "mixed"):
        further["cash_dividends"] = [(t, spot * share) for t, share in zip(times, shares, strict=True)]
    if kind == "escrowed":  # worth less than half the spot, whatever the rate
        least = min(0.4 / count * math.exp(min(rate * expiry, 0.0)), 1.0)
        further["cash_dividends"] = [
            (t, spot * share * least) for t, share in zip(times, shares, strict=True)
        ]
        further["dividend_model"] = "escrowed"
    if kind in ("fractions", "mixed"):
        shares = [1.0 if used_up and rng.random() < 0.3 else share for share in shares]
        further["proportional_dividends"] = list(zip(times, shares, strict=True))
    if kind in ("curves", "mixed"):
        knots = [expiry * share for share in (0.3, 0.6, 1.0)]
        rate = PiecewiseConstant(knots, (rate * rng.uniform(0.3, 1.5, 3)).tolist())
        volatility = PiecewiseConstant(knots, (volatility * rng.uniform(0.5, 1.5, 3)).tolist())
    stated = {}
    if kind == "bermudan":
        stated = {"exercise": "bermudan", "exercise_times": (*times, expiry)}
    elif kind == "window":
        stated = {"exercise_start": float(rng.uniform(0.0, expiry))}
    option = Option(str(rng.choice(["put", "call"])), 100.0, expiry, **stated)
    return option, Market(spot, rate, volatility, dividend_yield, **further)


def _between(rng, least, most):
    """Return a number between two, its logarithm equally likely everywhere."""
    return math.exp(rng.uniform(math.log(least), math.log(most)))
