"""Families of random contracts with events: dividends of both kinds, curves, exercise dates."""

from collections.abc import Callable
from typing import Any

from benchmarks.frozen_answers.random_terms import (
    Random,
    Terms,
    between,
    digits,
    either,
    flat_terms,
    log_between,
)


def _eventful(random: Random, **given: Any) -> Terms:
    """Return an everyday contract for events to be added; three in twenty are European, half have no yield."""
    terms = {
        "expiry": log_between(random, 0.05, 2.5),
        "rate": between(random, 0.002, 0.08),
        "dividend_yield": either(random, 0.0, between(random, 0.0, 0.05)),
        "exercise": "european" if random.random() < 0.1 else "american",
    }
    return flat_terms(random, **{**terms, **given})


def _times(random: Random, expiry: float, count: int) -> list[float]:
    """Return increasing times inside the option's life, one in each of so many equal parts of it."""
    return [digits(expiry * (part + random.uniform(0.05, 0.95)) / count) for part in range(count)]


def _cash(random: Random, terms: Terms, count: int, total: float = 0.04) -> list[dict[str, float]]:
    """Return cash dividends of about `total` of the spot together."""
    return [
        {"time": time, "amount": digits(terms["spot"] * total * random.uniform(0.2, 1.8) / count)}
        for time in _times(random, terms["expiry"], count)
    ]


def _fractions(random: Random, terms: Terms, count: int) -> list[dict[str, float]]:
    return [
        {"time": time, "fraction": log_between(random, 0.001, 0.03)}
        for time in _times(random, terms["expiry"], count)
    ]


def cash_dividends(random: Random) -> Terms:
    """Return a contract with one to four cash dividends."""
    terms = _eventful(random)
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 5)))}


def many_cash_dividends(random: Random) -> Terms:
    """Return a contract with five to twelve cash dividends."""
    terms = _eventful(random, expiry=log_between(random, 0.5, 3.0))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(5, 13)), 0.06)}


def crowded_cash_dividends(random: Random) -> Terms:
    """Return a contract with thirteen to sixty cash dividends."""
    terms = _eventful(random, expiry=log_between(random, 1.0, 3.0))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(13, 61)), 0.06)}


def odd_cash_dividends(random: Random) -> Terms:
    """Return a contract with a dividend at an odd time or of an odd amount, mostly among others."""
    terms = _eventful(random)
    expiry, amount = terms["expiry"], digits(terms["spot"] * log_between(random, 0.005, 0.03))
    middle = digits(0.5 * expiry)
    odd = (
        [(0.0, amount)],
        [(expiry, amount)],
        [(digits(1.3 * expiry), amount)],
        [(middle, 0.0)],
        [(middle, amount), (middle, 0.5 * amount)],
        [(middle, amount), (digits(middle * (1.0 + 1e-4)), amount)],
        [(middle, digits(terms["spot"] * log_between(random, 0.1, 0.6)))],
        [(middle, digits(terms["spot"] * log_between(random, 1.1, 2.0)))],
        [(digits(1e-3 * expiry), amount)],
        [(digits((1.0 - 1e-3) * expiry), amount)],
        [(middle, digits(1e-4 * amount))],
    )
    chosen = [{"time": time, "amount": amount} for time, amount in either(random, *odd)]
    others = _cash(random, terms, int(random.integers(1, 4)), 0.03) if random.random() < 0.6 else []
    return {**terms, "cash_dividends": chosen + others}


def escrowed(random: Random) -> Terms:
    """Return a contract with cash dividends in the escrowed model."""
    base = either(random, cash_dividends, cash_dividends, many_cash_dividends, odd_cash_dividends)(random)
    return {**base, "dividend_model": "escrowed"}


def proportional(random: Random) -> Terms:
    """Return a contract with one to six proportional dividends."""
    terms = _eventful(random)
    return {**terms, "proportional_dividends": _fractions(random, terms, int(random.integers(1, 7)))}


def cash_and_proportional(random: Random) -> Terms:
    """Return a contract with dividends of both kinds, every third time two of them on one date."""
    terms = cash_dividends(random)
    fractions = _fractions(random, terms, int(random.integers(1, 4)))
    if random.random() < 0.3:
        fractions[0]["time"] = terms["cash_dividends"][0]["time"]
    return {**terms, "proportional_dividends": fractions}


def _curve(random: Random, expiry: float, low: float, high: float) -> dict[str, list[float]]:
    count = int(random.integers(2, 6))
    times = _times(random, expiry, count - 1)
    return {"times": [*times, expiry], "values": [between(random, low, high) for _ in range(count)]}


def curves(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    """Return a contract with a curve of rates, of yields or of volatilities, or all three."""
    terms = base(random)
    level, expiry = terms["volatility"], terms["expiry"]
    low = -0.02 if random.random() < 0.2 else 0.0
    curves = {
        "rate": _curve(random, expiry, low, 0.08),
        "dividend_yield": _curve(random, expiry, 0.0, 0.06),
        "volatility": _curve(random, expiry, 0.6 * level, 1.4 * level),
    }
    chosen = either(random, ["rate"], ["dividend_yield"], ["volatility"], list(curves))
    return {**terms, **{name: curves[name] for name in chosen}}


def bermudan(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    """Return a contract with up to 24 exercise times, and every other time one at expiry."""
    terms = base(random)
    times = _times(random, terms["expiry"], int(either(random, 1, 2, 4, 6, 12, 24)))
    last = [terms["expiry"]] if random.random() < 0.5 else []
    return {**terms, "exercise": "bermudan", "exercise_times": [*times, *last]}


def window(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    """Return a contract that may be exercised from some time on."""
    terms = base(random)
    share = 1.0 if random.random() < 0.1 else random.uniform(0.05, 0.95)
    start = min(digits(terms["expiry"] * share), terms["expiry"]) if share < 1.0 else terms["expiry"]
    return {**terms, "exercise": "american", "exercise_start": start}


def _bermudan_curves(random: Random, base: Callable[[Random], Terms]) -> Terms:
    return bermudan(random, lambda again: curves(again, base))


def combined(random: Random) -> Terms:
    """Return a contract with several kinds of events."""
    paying = either(random, cash_dividends, escrowed, proportional, cash_and_proportional)
    terms: Terms = either(random, curves, bermudan, window, _bermudan_curves)(random, paying)
    return terms


def hard(random: Random) -> Terms:
    """Return a contract with events that are hard to price: steep, long, close, volatile, or at negative rates."""
    kinds = (_long_cash, _volatile_cash, _steep_curves, _negative_with_events, _close_events)
    terms: Terms = either(random, *kinds)(random)
    return terms


def _long_cash(random: Random) -> Terms:
    terms = _eventful(random, expiry=between(random, 2.0, 8.0))
    count = int(terms["expiry"] * random.integers(1, 4))
    return {**terms, "cash_dividends": _cash(random, terms, count, 0.0075 * count)}


def _volatile_cash(random: Random) -> Terms:
    terms = _eventful(random, volatility=between(random, 0.8, 1.5))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 5)))}


def _steep_curves(random: Random) -> Terms:
    terms = _eventful(random)
    low, high = (-0.03, 0.15) if random.random() < 0.5 else (0.0, 0.2)
    volatilities = _curve(random, terms["expiry"], 0.05, 0.9)
    return {**terms, "rate": _curve(random, terms["expiry"], low, high), "volatility": volatilities}


def _negative_with_events(random: Random) -> Terms:
    terms = _eventful(random, rate=between(random, -0.03, 0.03), dividend_yield=between(random, -0.03, 0.01))
    if random.random() < 0.5:
        return {**terms, "proportional_dividends": _fractions(random, terms, int(random.integers(1, 4)))}
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 4)))}


def _close_events(random: Random) -> Terms:
    """Return a contract two of whose dividends are minutes, seconds or less apart."""
    terms = cash_dividends(random)
    first = terms["cash_dividends"][0]
    second = {"time": first["time"] + log_between(random, 1e-11, 1e-5), "amount": first["amount"]}
    return {**terms, "cash_dividends": [*terms["cash_dividends"], second]}
