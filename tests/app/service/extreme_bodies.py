"""Bodies at the edges of what every field may be, and beyond them, at random; the same ones for the same seed."""

import json
import math
from typing import Any, NamedTuple

import numpy as np

CONTRACT_ROUTES = (
    "/v1/price",
    "/v1/boundary",
    "/v1/implied-volatility",
    "/v1/surface",
    "/v1/exercise-advice",
)
JSON = "application/json"
SPOTS = [0.0, 1e-30, 1e-6, 1.0, 50.0, 99.9, 100.0, 100.0 * (1 + 1e-15), 120.0, 1e4, 1e12, 1e30]
RATES = [-0.5, -0.02, -1e-300, 0.0, 0.0, 1e-300, 1e-9, 0.01, 0.05, 0.3, 2.0]
VOLATILITIES = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1.1e-4, 1e-3, 0.05, 0.2, 0.2, 0.7, 3.0, 15.0]
EXPIRIES = [0.0, 1e-300, 1e-12, 1e-9, 1e-4, 0.0044, 0.1, 0.498, 1.0, 1.0, 5.0, 30.0, 200.0]
STRIKES = [100.0, 100.0, 100.0, 1e-30, 1e-6, 179754.81, 1e30]
COUNTS = [1, 1, 2, 3, 12, 40, 366]
PLAIN = {"option_type": "put", "strike": 100.0, "spot": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
# What no field may be.
WRONG_VALUES: tuple[Any, ...] = (
    *("100", True, None, [], {}, [100.0], -1.0, 1e31, 10**400, "put", "2026-13-45", [None] * 367),
    {"times": [], "values": []},
    {"times": [2.0, 1.0], "values": [0.1, 0.1]},
    {"times": [1.0], "values": [0.1, 0.2]},
    [{"time": 0.5}],
    [{"time": 0.5, "amount": -1.0}],
    [{"time": "x", "amount": 1.0}],
)
# What is no JSON object, or not a sound one.
BROKEN = (
    *(b"", b"{", b"[]", b"null", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf{}", b'{"spot": 1}{"spot": 2}'),
    *(b'{"spot": NaN}', b'{"spot": 1e999}', b'{"spot": Infinity}', b'{"spot": 1, "spot": 2}'),
    b'{"spot": ' + b"9" * 5_000 + b"}",
    b'{"option_type": "\\ud800"}',
    b"[" * 50_000,
    b'{"a": ' * 2_000 + b"1" + b"}" * 2_000,
    b" " * 60_000,
    b'"' + b"x" * 60_000 + b'"',
)


class Body(NamedTuple):
    """One request: `question` is what its body says, None where that is no JSON object or is not sound."""

    path: str
    raw: bytes
    question: Any
    media_type: str = JSON


def bodies(count: int, seed: int = 29) -> list[Body]:
    """Return each extreme alone as a question for a price, and bodies for all routes, a quarter of them not sound."""
    rng = np.random.default_rng(seed)
    extremes = {
        "spot": SPOTS,
        "strike": STRIKES,
        "expiry": EXPIRIES,
        "rate": RATES,
        "dividend_yield": RATES,
        "volatility": VOLATILITIES,
    }
    alone = [
        PLAIN | {"tolerance": 1e-4, "greeks": "extended", name: value}
        for name, values in extremes.items()
        for value in values
    ]
    first = [Body("/v1/price", json.dumps(question).encode(), question) for question in alone]
    return first + [_body(rng) for _ in range(count - len(first))]


def contract(rng: np.random.Generator) -> dict[str, Any]:
    """Return a contract and its market: each field is sound, and they may still not go together."""
    strike = float(rng.choice(STRIKES))
    scale = strike / 100.0
    spot = float(rng.choice(SPOTS))
    found: dict[str, Any] = {
        "option_type": str(rng.choice(["put", "call"])),
        "strike": strike,
        "spot": min(spot * scale, 1e30) if rng.random() < 0.9 else spot,
        "expiry": float(rng.choice(EXPIRIES))
        if rng.random() < 0.7
        else float(10.0 ** rng.uniform(-4.0, 2.0)),
        "rate": _rate(rng, RATES),
        "volatility": _volatility(rng, strike),
        "tolerance": float(rng.choice([1e-2, 1e-4, 1e-6, 1e-6, 1e-8])),
    }
    years = found["expiry"]
    if rng.random() < 0.5:
        found["dividend_yield"] = _rate(rng, RATES)
    if rng.random() < 0.4:
        amount = found["strike"] * float(rng.choice([1e-12, 1e-4, 0.01, 0.3, 1.5]))
        found["cash_dividends"] = [{"time": time, "amount": amount} for time in _times(rng, years)]
        found["dividend_model"] = str(rng.choice(["spot", "spot", "escrowed"]))
    if rng.random() < 0.3:
        fractions = [float(rng.choice([1e-9, 0.001, 0.02, 0.38, 0.74, 0.91, 1.0])) for _ in range(366)]
        found["proportional_dividends"] = [
            {"time": time, "fraction": fraction}
            for time, fraction in zip(_times(rng, years), fractions, strict=False)
        ]
    kind = rng.random()
    if kind < 0.1:
        found["exercise"] = "european"
    elif kind < 0.25 and years > 0.0:
        found |= {"exercise": "bermudan", "exercise_times": _times(rng, years)}
    elif kind < 0.35:
        found["exercise_start"] = float(rng.choice([0.0, 0.5, 1.0])) * years
    if rng.random() < 0.15:
        found |= {"borrow_rate": _rate(rng, RATES), "quanto_covariance": float(rng.choice([-0.1, 0.0, 0.2]))}
    if rng.random() < 0.1:
        found["settlement_lag"] = float(rng.choice([0.0, 2.0, 366.0]))
    if rng.random() < 0.05:
        found |= {"underlying": "future"}
        found.pop("dividend_yield", None)
    return found


def _rate(rng: np.random.Generator, values: list[float]) -> Any:
    if rng.random() < 0.85:
        return float(rng.choice(values))
    count = int(rng.choice([1, 2, 5, 100]))
    return {
        "times": _increasing(rng, count, 2.0),
        "values": [float(rng.choice(values)) for _ in range(count)],
    }


def _volatility(rng: np.random.Generator, strike: float) -> Any:
    kind = rng.random()
    if kind < 0.8:
        return float(rng.choice(VOLATILITIES))
    if kind < 0.92:
        return _rate(rng, VOLATILITIES) if kind < 0.85 else {"times": [0.5, 2.0], "values": [15.0, 1e-12]}
    times, spots = (
        _increasing(rng, int(rng.choice([1, 3, 20])), 2.0),
        [strike * factor for factor in (0.5, 1.0, 2.0)],
    )
    values = [[float(rng.choice([0.01, 0.2, 0.5, 15.0])) for _ in spots] for _ in times]
    return {"times": times, "spots": spots, "values": values} if 1e-20 < strike < 1e20 else 0.2


def _times(rng: np.random.Generator, years: float) -> list[float]:
    return sorted({float(time) for time in rng.uniform(0.0, years or 1.0, int(rng.choice(COUNTS)))})


def _increasing(rng: np.random.Generator, count: int, most: float) -> list[float]:
    return np.cumsum(rng.uniform(0.01, most / count + 0.01, count)).tolist()


def _question(rng: np.random.Generator, path: str) -> dict[str, Any]:
    found = contract(rng)
    years, strike = found["expiry"], found["strike"]
    if path == "/v1/price":
        found["greeks"] = str(rng.choice(["none", "standard", "extended"]))
        found["greek_errors"] = bool(rng.random() < 0.2)
    elif path == "/v1/implied-volatility":
        found.pop("volatility")
        most = strike if found["option_type"] == "put" else found["spot"]
        found["option_price"] = most * float(rng.choice([0.0, 1e-12, 0.01, 0.1, 0.5, 0.999, 1.0, 2.0]))
    elif path == "/v1/surface":
        found.pop("spot")
        spots = sorted(
            {min(strike * float(f), 1e30) for f in rng.choice([0.0, 1e-9, 0.5, 0.9, 1.0, 1.1, 2.0, 1e6], 3)}
        )
        found |= {"spots": spots, "times": sorted({0.0, years * float(rng.uniform())})}
        found["greeks"] = str(rng.choice(["none", "standard"]))
    elif rng.random() < 0.7:
        count = (
            int(rng.choice([1, 3, 200])) if path == "/v1/exercise-advice" else int(rng.choice([1, 5, 1000]))
        )
        found["times"] = sorted({float(time) for time in rng.uniform(0.0, years, count)} | {years})
    return found


def _body(rng: np.random.Generator) -> Body:
    kind = rng.random()
    if kind < 0.12:
        return _batch(rng)
    path = str(rng.choice(CONTRACT_ROUTES, p=[0.3, 0.15, 0.15, 0.15, 0.25]))
    question = _question(rng, path)
    if kind < 0.75:
        return Body(path, json.dumps(question).encode(), question)
    if kind < 0.80:
        return Body(path, BROKEN[rng.integers(len(BROKEN))], None)
    return Body(path, json.dumps(_spoilt(rng, question)).encode(), None)


def _spoilt(rng: np.random.Generator, question: dict[str, Any]) -> dict[str, Any]:
    """Return a question with something in it that is wrong, most likely."""
    name, kind = str(rng.choice(list(question))), rng.random()
    if kind < 0.15:
        return {key: value for key, value in question.items() if key != name}
    if kind < 0.3:
        return question | {name[:-1] + "x": 1.0}
    return question | {name: WRONG_VALUES[rng.integers(len(WRONG_VALUES))]}


def _batch(rng: np.random.Generator) -> Body:
    rows = [contract(rng) for _ in range(int(rng.integers(1, 12)))]
    if rng.random() < 0.5:
        lines = [json.dumps(row).encode() for row in rows]
        if rng.random() < 0.3:
            lines[rng.integers(len(lines))] = BROKEN[rng.integers(9)]
            rows = []  # how many lines a broken one is, it says itself
        return Body("/v1/batch", b"\n".join(lines), rows or None, "application/x-ndjson")
    names = sorted({name for row in rows for name in row})
    columns = {name: [row.get(name) for row in rows] for name in names}
    if rng.random() < 0.2:
        columns[str(rng.choice(names))] = []
        rows = []
    return Body("/v1/batch", json.dumps(columns).encode(), rows or None)


def sum_over_life(rate: Any, years: float) -> tuple[float, float]:
    """Return the least and the largest integral of a rate from now to any time before expiry."""
    if not isinstance(rate, dict):
        return min(0.0, rate * years), max(0.0, rate * years)
    total, last, sums = 0.0, 0.0, [0.0]
    for end, value in [*zip(rate["times"], rate["values"], strict=True), (math.inf, rate["values"][-1])]:
        total += value * max(0.0, min(end, years) - last)
        last = min(end, years)
        sums.append(total)
    return min(sums), max(sums)


def value_bounds(question: dict[str, Any]) -> tuple[float, float]:
    """Return bounds of no arbitrage that hold for every volatility and dividend, independent of the engine's.

    The upper one is infinite where a fee, a quanto or a lag changes what the spot or the strike is worth.
    """
    strike, spot, years = question["strike"], float(question["spot"]), question["expiry"]
    is_put = question["option_type"] == "put"
    carry = "rate" if is_put or question.get("underlying") == "future" else "dividend_yield"
    least, _ = sum_over_life(question.get(carry, 0.0), years)
    most = (strike if is_put else spot) * math.exp(-least)
    if question.get("settlement_lag") or "borrow_rate" in question:
        most = math.inf
    now = max(strike - spot, 0.0) if is_put else max(spot - strike, 0.0)
    exercised_now = (
        question.get("exercise", "american") == "american"
        and not question.get("exercise_start")
        and not question.get("settlement_lag")
    )
    return now if exercised_now else 0.0, most
