"""Valid questions at the edges of what each field may be: an honest answer each time, never a 500."""

import math
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.settings import Settings
from tests.problems.needs_kernel import needs_kernel

EXTREMES: dict[str, list[Any]] = {
    "spot": [0, 1e-30, 1e-12, 1.0, 50.0, 100, 100 * (1 + 1e-15), 200.0, 1e12, 1e30],
    "strike": [1e-30, 1e-6, 100, 1e6, 1e30],
    "expiry": [0, 1e-300, 1e-12, 1e-9, 1e-4, 1.0, 30.0, 200],
    "rate": [-0.5, -0.02, -1e-300, 0, 1e-300, 1e-9, 0.05, 2, {"times": [0.1, 0.5], "values": [2.0, -0.5]}],
    "volatility": [0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-3, 0.2, 3.0, 15, {"times": [0.5, 2.0], "values": [15.0, 1e-12]}],
    "dividend_yield": [-0.5, -0.03, 0, 1e-300, 0.04, 2, {"times": [0.25, 1.0], "values": [-0.5, 2.0]}],
    "option_type": ["put", "call"],
    "exercise": ["american", "american", "european"],
    "greeks": ["none", "standard", "extended"],
    "tolerance": [1e-2, 1e-4, 1e-6, 1e-8],
}  # fmt: skip
PLAIN = {
    "spot": 100, "strike": 100, "expiry": 1.0, "rate": 0.05, "volatility": 0.2, "dividend_yield": 0.0,
    "option_type": "put", "exercise": "american", "greeks": "extended", "tolerance": 1e-4,
}  # fmt: skip
STATUSES = {"ok", "tolerance_not_met", "deadline"}
COUNT = 330


def questions() -> list[dict[str, Any]]:
    """Return each extreme alone, and then several at random."""
    found = [PLAIN | {name: value} for name, values in EXTREMES.items() for value in values]
    rng = np.random.default_rng(29)
    while len(found) < COUNT:
        question = dict(PLAIN)
        for name in rng.choice(list(EXTREMES), size=int(rng.integers(2, 6)), replace=False):
            question[str(name)] = EXTREMES[name][rng.integers(len(EXTREMES[name]))]
        if rng.random() < 0.2:
            years = float(question["expiry"])
            times = np.sort(rng.uniform(0.0, years, 2)).tolist()
            amounts = [float(question["strike"]) * float(rng.choice([0.0, 1e-12, 0.02, 0.9])) for _ in times]
            question["cash_dividends"] = [
                {"time": time, "amount": amount} for time, amount in zip(times, amounts, strict=True)
            ]
        found.append(question)
    return found


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


def bounds(question: dict[str, Any]) -> tuple[float, float]:
    """Return bounds of no arbitrage that hold for every volatility and dividend, independent of the engine's."""
    strike, spot, years = question["strike"], float(question["spot"]), question["expiry"]
    is_put = question["option_type"] == "put"
    least, _ = sum_over_life(question["rate"] if is_put else question["dividend_yield"], years)
    most = (strike if is_put else spot) * math.exp(-least)
    american = question["exercise"] == "american"
    now = max(strike - spot, 0.0) if is_put else max(spot - strike, 0.0)
    return now if american else 0.0, most


@pytest.fixture(scope="module")
def quick_client() -> Any:
    with TestClient(create_app(Settings(slots=2, deadline_seconds=0.5))) as client:
        yield client


@needs_kernel
def test_extreme_questions_are_answered_honestly(quick_client: TestClient) -> None:
    counts: dict[str, int] = {}
    for question in questions():
        answer = quick_client.post("/v1/price", json=question)
        body = answer.json()
        assert answer.status_code in (200, 422, 503), question
        kind = body["status"] if answer.status_code == 200 else body["type"]
        counts[kind] = counts.get(kind, 0) + 1
        if answer.status_code == 200:
            least, most = bounds(question)
            rounding = 1e-12 * max(float(question["spot"]), question["strike"])
            assert body["status"] in STATUSES, question
            assert least - rounding <= body["price"] <= most * (1.0 + 1e-12) + rounding, question
            if body["status"] == "ok":
                assert body["error_estimate"] <= question["tolerance"] * question["strike"], question
        elif answer.status_code == 422:
            assert body["type"] in ("/docs#out-of-domain", "/docs#invalid-input"), question
    assert counts["ok"] > 0.7 * COUNT, counts
