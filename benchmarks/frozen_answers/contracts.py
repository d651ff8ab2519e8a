"""Random contracts over all features of the option engine, which follow from one seed alone."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

SEED = 20261
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

Random: TypeAlias = np.random.Generator
Terms: TypeAlias = dict[str, Any]  # One contract, as `contract_from` takes it.
Answer: TypeAlias = dict[str, Any]  # What was found for a contract, by name.


def _digits(number: float) -> float:
    """Return a number that is quickly quoted."""
    return float(f"{number:.5g}")


def _between(random: Random, low: float, high: float) -> float:
    return _digits(random.uniform(low, high))


def _log_between(random: Random, low: float, high: float) -> float:
    return _digits(math.exp(random.uniform(math.log(low), math.log(high))))


def _either(random: Random, *choices: Any) -> Any:
    return choices[random.integers(len(choices))]


def _flat(random: Random, **given: Any) -> Terms:
    """Return an everyday contract but for what is given; the spot is given as a share of the strike."""
    strike = 100.0 if random.random() < 0.7 else _log_between(random, 0.5, 5000.0)
    terms: Terms = {
        "option_type": _either(random, "put", "call"),
        "spot": _log_between(random, 0.6, 1.6),
        "strike": strike,
        "expiry": _log_between(random, 10.0, 1095.0) / 365.0,
        "rate": _log_between(random, 0.005, 0.1),
        "dividend_yield": _between(random, 0.0, 0.1),
        "volatility": _log_between(random, 0.1, 0.6),
        **given,
    }
    return {**terms, "spot": _digits(terms["spot"] * strike)}


def _everyday(random: Random) -> Terms:
    return _flat(random)


def _wide(random: Random) -> Terms:
    return _flat(
        random,
        spot=_log_between(random, 0.4, 2.5),
        expiry=_log_between(random, 5.0, 3650.0) / 365.0,
        rate=_between(random, 0.0, 0.15),
        dividend_yield=_between(random, 0.0, 0.15),
        volatility=_log_between(random, 0.03, 1.5),
    )


def _negative_rates(random: Random) -> Terms:
    """Return a contract with one boundary, or none, and a rate or a yield below zero."""
    put = random.random() < 0.5
    earned, paid = _between(random, 0.001, 0.06), _between(random, -0.05, -0.001)
    rates = (earned, paid) if put else (paid, earned)
    return _flat(random, option_type="put" if put else "call", rate=rates[0], dividend_yield=rates[1])


def _two_boundaries(random: Random) -> Terms:
    """Return a put with q < r < 0 or a call with r < q < 0."""
    put = random.random() < 0.5
    low = _between(random, -0.08, -0.02)
    high = _digits(low * random.uniform(0.1, 0.8))
    rate, dividend_yield = (high, low) if put else (low, high)
    return _flat(
        random,
        option_type="put" if put else "call",
        expiry=_log_between(random, 0.1, 6.0),
        rate=rate,
        dividend_yield=dividend_yield,
    )


def _never_exercised(random: Random) -> Terms:
    put = random.random() < 0.5
    earned = _either(random, 0.0, _between(random, -0.05, 0.0))
    paid = _digits(earned + _either(random, 0.0, random.uniform(0.0, 0.06)))
    rates = (earned, paid) if put else (paid, earned)
    return _flat(random, option_type="put" if put else "call", rate=rates[0], dividend_yield=rates[1])


def _zero_rate(random: Random) -> Terms:
    zero, other = 0.0, _between(random, -0.03, 0.08)
    rate, dividend_yield = _either(random, (zero, other), (other, zero), (zero, zero), (1e-7, other))
    return _flat(random, rate=rate, dividend_yield=dividend_yield)


def _tiny_volatility(random: Random) -> Terms:
    volatility = (
        _log_between(random, 1e-4, 0.05) if random.random() < 0.9 else _log_between(random, 1e-9, 1e-4)
    )
    return _flat(random, spot=_between(random, 0.9, 1.1), volatility=volatility)


def _huge_volatility(random: Random) -> Terms:
    return _flat(random, volatility=_log_between(random, 0.8, 14.0))


def _days(random: Random) -> Terms:
    """Return a contract with hours or days to expiry."""
    return _flat(
        random,
        spot=_between(random, 0.9, 1.1),
        expiry=_log_between(random, 1.0 / 24.0, 10.0) / 365.0,
    )


def _decades(random: Random) -> Terms:
    return _flat(random, expiry=_between(random, 10.0, 30.0), volatility=_log_between(random, 0.1, 0.6))


def _deep(random: Random) -> Terms:
    return _flat(
        random, spot=_either(random, _log_between(random, 0.01, 0.4), _log_between(random, 2.5, 100.0))
    )


def _european(random: Random) -> Terms:
    base = _either(random, _everyday, _wide, _negative_rates, _days, _deep, _tiny_volatility)(random)
    return {**base, "exercise": "european"}


def _at_an_edge(random: Random) -> Terms:
    """Return a flat contract with a spot, an expiry or a volatility of 0, or with several of these."""
    base = _either(random, _everyday, _wide, _negative_rates, _two_boundaries)(random)
    edges = ({"spot": 0.0}, {"expiry": 0.0}, {"volatility": 0.0}, {"spot": 0.0, "volatility": 0.0})
    exercise = _either(random, "american", "american", "european")
    return {**base, **_either(random, *edges, {"spot": base["strike"], "expiry": 0.0}), "exercise": exercise}


def _refused(random: Random) -> Terms:
    """Return a contract that is no contract."""
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
    return {**_everyday(random), **_either(random, *wrong)}


def _eventful(random: Random, **given: Any) -> Terms:
    """Return an everyday contract for events to be added; three in twenty are European, half have no yield."""
    terms = {
        "expiry": _log_between(random, 0.05, 2.5),
        "rate": _between(random, 0.002, 0.08),
        "dividend_yield": _either(random, 0.0, _between(random, 0.0, 0.05)),
        "exercise": "european" if random.random() < 0.1 else "american",
    }
    return _flat(random, **{**terms, **given})


def _times(random: Random, expiry: float, count: int) -> list[float]:
    """Return increasing times inside the option's life, one in each of so many equal parts of it."""
    return [_digits(expiry * (part + random.uniform(0.05, 0.95)) / count) for part in range(count)]


def _cash(random: Random, terms: Terms, count: int, total: float = 0.04) -> list[dict[str, float]]:
    """Return cash dividends of about `total` of the spot together."""
    return [
        {"time": time, "amount": _digits(terms["spot"] * total * random.uniform(0.2, 1.8) / count)}
        for time in _times(random, terms["expiry"], count)
    ]


def _fractions(random: Random, terms: Terms, count: int) -> list[dict[str, float]]:
    return [
        {"time": time, "fraction": _log_between(random, 0.001, 0.03)}
        for time in _times(random, terms["expiry"], count)
    ]


def _cash_dividends(random: Random) -> Terms:
    terms = _eventful(random)
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 5)))}


def _many_cash_dividends(random: Random) -> Terms:
    terms = _eventful(random, expiry=_log_between(random, 0.5, 3.0))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(5, 13)), 0.06)}


def _crowded_cash_dividends(random: Random) -> Terms:
    terms = _eventful(random, expiry=_log_between(random, 1.0, 3.0))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(13, 61)), 0.06)}


def _odd_cash_dividends(random: Random) -> Terms:
    """Return a contract with a dividend at an odd time or of an odd amount, mostly among others."""
    terms = _eventful(random)
    expiry, amount = terms["expiry"], _digits(terms["spot"] * _log_between(random, 0.005, 0.03))
    middle = _digits(0.5 * expiry)
    odd = (
        [(0.0, amount)],
        [(expiry, amount)],
        [(_digits(1.3 * expiry), amount)],
        [(middle, 0.0)],
        [(middle, amount), (middle, 0.5 * amount)],
        [(middle, amount), (_digits(middle * (1.0 + 1e-4)), amount)],
        [(middle, _digits(terms["spot"] * _log_between(random, 0.1, 0.6)))],
        [(middle, _digits(terms["spot"] * _log_between(random, 1.1, 2.0)))],
        [(_digits(1e-3 * expiry), amount)],
        [(_digits((1.0 - 1e-3) * expiry), amount)],
        [(middle, _digits(1e-4 * amount))],
    )
    chosen = [{"time": time, "amount": amount} for time, amount in _either(random, *odd)]
    others = _cash(random, terms, int(random.integers(1, 4)), 0.03) if random.random() < 0.6 else []
    return {**terms, "cash_dividends": chosen + others}


def _escrowed(random: Random) -> Terms:
    base = _either(random, _cash_dividends, _cash_dividends, _many_cash_dividends, _odd_cash_dividends)(
        random
    )
    return {**base, "dividend_model": "escrowed"}


def _proportional(random: Random) -> Terms:
    terms = _eventful(random)
    return {**terms, "proportional_dividends": _fractions(random, terms, int(random.integers(1, 7)))}


def _cash_and_proportional(random: Random) -> Terms:
    """Return a contract with dividends of both kinds, every third time two of them on one date."""
    terms = _cash_dividends(random)
    fractions = _fractions(random, terms, int(random.integers(1, 4)))
    if random.random() < 0.3:
        fractions[0]["time"] = terms["cash_dividends"][0]["time"]
    return {**terms, "proportional_dividends": fractions}


def _curve(random: Random, expiry: float, low: float, high: float) -> dict[str, list[float]]:
    count = int(random.integers(2, 6))
    times = _times(random, expiry, count - 1)
    return {"times": [*times, expiry], "values": [_between(random, low, high) for _ in range(count)]}


def _curves(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    """Return a contract with a curve of rates, of yields or of volatilities, or all three."""
    terms = base(random)
    level, expiry = terms["volatility"], terms["expiry"]
    low = -0.02 if random.random() < 0.2 else 0.0
    curves = {
        "rate": _curve(random, expiry, low, 0.08),
        "dividend_yield": _curve(random, expiry, 0.0, 0.06),
        "volatility": _curve(random, expiry, 0.6 * level, 1.4 * level),
    }
    chosen = _either(random, ["rate"], ["dividend_yield"], ["volatility"], list(curves))
    return {**terms, **{name: curves[name] for name in chosen}}


def _bermudan(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    terms = base(random)
    times = _times(random, terms["expiry"], int(_either(random, 1, 2, 4, 6, 12, 24)))
    last = [terms["expiry"]] if random.random() < 0.5 else []
    return {**terms, "exercise": "bermudan", "exercise_times": [*times, *last]}


def _window(random: Random, base: Callable[[Random], Terms] = _eventful) -> Terms:
    terms = base(random)
    share = 1.0 if random.random() < 0.1 else random.uniform(0.05, 0.95)
    start = min(_digits(terms["expiry"] * share), terms["expiry"]) if share < 1.0 else terms["expiry"]
    return {**terms, "exercise": "american", "exercise_start": start}


def _bermudan_curves(random: Random, base: Callable[[Random], Terms]) -> Terms:
    return _bermudan(random, lambda again: _curves(again, base))


def _combined(random: Random) -> Terms:
    """Return a contract with several kinds of events."""
    paying = _either(random, _cash_dividends, _escrowed, _proportional, _cash_and_proportional)
    terms: Terms = _either(random, _curves, _bermudan, _window, _bermudan_curves)(random, paying)
    return terms


def _hard(random: Random) -> Terms:
    """Return a contract with events that are hard to price: steep, long, close, volatile, or at negative rates."""
    kinds = (_long_cash, _volatile_cash, _steep_curves, _negative_with_events, _close_events)
    terms: Terms = _either(random, *kinds)(random)
    return terms


def _long_cash(random: Random) -> Terms:
    terms = _eventful(random, expiry=_between(random, 2.0, 8.0))
    count = int(terms["expiry"] * random.integers(1, 4))
    return {**terms, "cash_dividends": _cash(random, terms, count, 0.0075 * count)}


def _volatile_cash(random: Random) -> Terms:
    terms = _eventful(random, volatility=_between(random, 0.8, 1.5))
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 5)))}


def _steep_curves(random: Random) -> Terms:
    terms = _eventful(random)
    low, high = (-0.03, 0.15) if random.random() < 0.5 else (0.0, 0.2)
    volatilities = _curve(random, terms["expiry"], 0.05, 0.9)
    return {**terms, "rate": _curve(random, terms["expiry"], low, high), "volatility": volatilities}


def _negative_with_events(random: Random) -> Terms:
    terms = _eventful(
        random, rate=_between(random, -0.03, 0.03), dividend_yield=_between(random, -0.03, 0.01)
    )
    if random.random() < 0.5:
        return {**terms, "proportional_dividends": _fractions(random, terms, int(random.integers(1, 4)))}
    return {**terms, "cash_dividends": _cash(random, terms, int(random.integers(1, 4)))}


def _close_events(random: Random) -> Terms:
    """Return a contract two of whose dividends are minutes, seconds or less apart."""
    terms = _cash_dividends(random)
    first = terms["cash_dividends"][0]
    second = {"time": first["time"] + _log_between(random, 1e-11, 1e-5), "amount": first["amount"]}
    return {**terms, "cash_dividends": [*terms["cash_dividends"], second]}


class Family(NamedTuple):
    """A kind of contracts: how many, and how one is made."""

    size: int
    make: Callable[[Random], Terms]


FAMILIES = {
    "everyday": Family(330, _everyday),
    "wide": Family(200, _wide),
    "negative rates": Family(120, _negative_rates),
    "two boundaries": Family(140, _two_boundaries),
    "never exercised": Family(60, _never_exercised),
    "zero rate or yield": Family(80, _zero_rate),
    "tiny volatility": Family(50, _tiny_volatility),
    "huge volatility": Family(50, _huge_volatility),
    "hours or days": Family(60, _days),
    "decades": Family(50, _decades),
    "deep in or out of the money": Family(60, _deep),
    "european": Family(90, _european),
    "at an edge": Family(80, _at_an_edge),
    "refused": Family(30, _refused),
    "cash dividends": Family(190, _cash_dividends),
    "many cash dividends": Family(110, _many_cash_dividends),
    "crowded cash dividends": Family(40, _crowded_cash_dividends),
    "odd cash dividends": Family(150, _odd_cash_dividends),
    "escrowed": Family(130, _escrowed),
    "proportional dividends": Family(130, _proportional),
    "cash and proportional dividends": Family(90, _cash_and_proportional),
    "curves": Family(250, _curves),
    "bermudan": Family(120, _bermudan),
    "window": Family(80, _window),
    "combined": Family(160, _combined),
    "hard events": Family(150, _hard),
}
EVERY = sum(family.size for family in FAMILIES.values())


@dataclass(frozen=True, slots=True)
class Contract:
    """One row: its place among all contracts, its family, terms and tolerance."""

    id: int
    family: str
    terms: Terms
    tolerance: float

    def columns(self) -> dict[str, list[Any]]:
        """Return a table of this row alone, as `price_many` takes it."""
        return {name: [value] for name, value in self.terms.items()}

    @property
    def scale(self) -> float:
        """Return what differences of money are measured by."""
        spot, strike = float(self.terms["spot"]), float(self.terms["strike"])
        return max(1.0, abs(spot), abs(strike))


def all_contracts() -> list[Contract]:
    """Return every contract; each follows from the seed, its family and its number in the family alone."""
    contracts: list[Contract] = []
    for place, (name, family) in enumerate(FAMILIES.items()):
        for number in range(family.size):
            random = np.random.default_rng((SEED, place, number))
            terms = family.make(random)
            contracts.append(Contract(len(contracts), name, terms, float(random.choice(TOLERANCES))))
    return contracts
