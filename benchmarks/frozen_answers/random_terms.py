"""Random numbers in few digits, and the terms of a random everyday contract made of them."""

import math
from typing import Any, TypeAlias

import numpy as np

Random: TypeAlias = np.random.Generator
Terms: TypeAlias = dict[str, Any]  # One contract, as `contract_from` takes it.


def digits(number: float) -> float:
    """Return a number with few digits."""
    return float(f"{number:.5g}")


def between(random: Random, low: float, high: float) -> float:
    """Return a number between two limits, all equally likely."""
    return digits(random.uniform(low, high))


def log_between(random: Random, low: float, high: float) -> float:
    """Return a number between two positive limits, equally likely in its logarithm."""
    return digits(math.exp(random.uniform(math.log(low), math.log(high))))


def either(random: Random, *choices: Any) -> Any:
    """Return one of the choices, all equally likely."""
    return choices[random.integers(len(choices))]


def flat_terms(random: Random, **given: Any) -> Terms:
    """Return an everyday contract but for what is given; the spot is given as a share of the strike."""
    strike = 100.0 if random.random() < 0.7 else log_between(random, 0.5, 5000.0)
    terms: Terms = {
        "option_type": either(random, "put", "call"),
        "spot": log_between(random, 0.6, 1.6),
        "strike": strike,
        "expiry": log_between(random, 10.0, 1095.0) / 365.0,
        "rate": log_between(random, 0.005, 0.1),
        "dividend_yield": between(random, 0.0, 0.1),
        "volatility": log_between(random, 0.1, 0.6),
        **given,
    }
    return {**terms, "spot": digits(terms["spot"] * strike)}
