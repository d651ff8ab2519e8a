"""Families of random contracts without events, and of contracts that are refused."""

from benchmarks.frozen_answers.random_terms import (
    Random,
    Terms,
    between,
    digits,
    either,
    flat_terms,
    log_between,
)


def everyday(random: Random) -> Terms:
    """Return a contract with terms as they are commonly traded."""
    return flat_terms(random)


def wide(random: Random) -> Terms:
    """Return a contract from a wide range of everything."""
    return flat_terms(
        random,
        spot=log_between(random, 0.4, 2.5),
        expiry=log_between(random, 5.0, 3650.0) / 365.0,
        rate=between(random, 0.0, 0.15),
        dividend_yield=between(random, 0.0, 0.15),
        volatility=log_between(random, 0.03, 1.5),
    )


def negative_rates(random: Random) -> Terms:
    """Return a contract with one boundary, or none, and a rate or a yield below zero."""
    put = random.random() < 0.5
    earned, paid = between(random, 0.001, 0.06), between(random, -0.05, -0.001)
    rates = (earned, paid) if put else (paid, earned)
    return flat_terms(random, option_type="put" if put else "call", rate=rates[0], dividend_yield=rates[1])


def two_boundaries(random: Random) -> Terms:
    """Return a put with q < r < 0 or a call with r < q < 0."""
    put = random.random() < 0.5
    low = between(random, -0.08, -0.02)
    high = digits(low * random.uniform(0.1, 0.8))
    rate, dividend_yield = (high, low) if put else (low, high)
    return flat_terms(
        random,
        option_type="put" if put else "call",
        expiry=log_between(random, 0.1, 6.0),
        rate=rate,
        dividend_yield=dividend_yield,
    )


def never_exercised(random: Random) -> Terms:
    """Return a contract whose early exercise earns nothing."""
    put = random.random() < 0.5
    earned = either(random, 0.0, between(random, -0.05, 0.0))
    paid = digits(earned + either(random, 0.0, random.uniform(0.0, 0.06)))
    rates = (earned, paid) if put else (paid, earned)
    return flat_terms(random, option_type="put" if put else "call", rate=rates[0], dividend_yield=rates[1])


def zero_rate(random: Random) -> Terms:
    """Return a contract whose rate or yield is 0, or both, or whose rate is nearly 0."""
    zero, other = 0.0, between(random, -0.03, 0.08)
    rate, dividend_yield = either(random, (zero, other), (other, zero), (zero, zero), (1e-7, other))
    return flat_terms(random, rate=rate, dividend_yield=dividend_yield)


def tiny_volatility(random: Random) -> Terms:
    """Return a contract near the money with a volatility below 5 %, one in ten far below."""
    volatility = log_between(random, 1e-4, 0.05) if random.random() < 0.9 else log_between(random, 1e-9, 1e-4)
    return flat_terms(random, spot=between(random, 0.9, 1.1), volatility=volatility)


def huge_volatility(random: Random) -> Terms:
    """Return a contract with a volatility from 80 % to nearly the largest that is allowed."""
    return flat_terms(random, volatility=log_between(random, 0.8, 14.0))


def days(random: Random) -> Terms:
    """Return a contract with hours or days to expiry."""
    return flat_terms(
        random,
        spot=between(random, 0.9, 1.1),
        expiry=log_between(random, 1.0 / 24.0, 10.0) / 365.0,
    )


def decades(random: Random) -> Terms:
    """Return a contract with 10 to 30 years to expiry."""
    return flat_terms(random, expiry=between(random, 10.0, 30.0), volatility=log_between(random, 0.1, 0.6))


def deep(random: Random) -> Terms:
    """Return a contract deep in or out of the money."""
    return flat_terms(
        random, spot=either(random, log_between(random, 0.01, 0.4), log_between(random, 2.5, 100.0))
    )


def european(random: Random) -> Terms:
    """Return a European contract."""
    base = either(random, everyday, wide, negative_rates, days, deep, tiny_volatility)(random)
    return {**base, "exercise": "european"}


def at_an_edge(random: Random) -> Terms:
    """Return a flat contract with a spot, an expiry or a volatility of 0, or with several of these."""
    base = either(random, everyday, wide, negative_rates, two_boundaries)(random)
    edges = ({"spot": 0.0}, {"expiry": 0.0}, {"volatility": 0.0}, {"spot": 0.0, "volatility": 0.0})
    exercise = either(random, "american", "american", "european")
    return {**base, **either(random, *edges, {"spot": base["strike"], "expiry": 0.0}), "exercise": exercise}


def refused(random: Random) -> Terms:
    """Return a mapping that states no valid contract."""
    wrong = (
        {"spot": -1.0},
        {"strike": 0.0},
        {"expiry": -0.5},
        {"expiry": 201.0},
        {"rate": 3.0},
        {"rate": None},
        {"volatility": -0.2},
        {"volatility": 16.0},
        {"option_type": "straddle"},
        {"exercise": "bermudan"},
        {"exercise_times": [0.01]},
        {"cash_dividends": [{"time": -0.1, "amount": 1.0}]},
        {"cash_dividends": [{"time": 0.1, "amount": -1.0}]},
        {"proportional_dividends": [{"time": 0.1, "fraction": 1.5}]},
        {"volatility": {"times": [0.5, 0.2], "values": [0.2, 0.3]}},
        {"dividend_model": "forward"},
    )
    return {**everyday(random), **either(random, *wrong)}
