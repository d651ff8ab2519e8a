"""What will a price cost? Fits the cost model that the service sorts questions by, and shows how far off it is.

Random contracts: flat, with cash dividends of either model, curves, Bermudan and European ones, tolerances 1e-2 to
1e-8, all choices of Greeks. Per engine that is asked first and choice of Greeks: the coefficients fitted here, and of
those in `pricing_core/american/expected_cost.py` the share within a factor of two and of four, and what matters to the
service: the share that is cheap and called expensive, and the share that is expensive and called cheap, which it finds
out after a few milliseconds. Run from the root of the project: .venv/bin/python -m benchmarks.service_costs
"""

import math
import sys
import time
from collections import defaultdict
from typing import Any, get_args

import numpy as np

from benchmarks.measuring.machine import cpu_model
from pricing_core.american import PiecewiseConstant, contract_from
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.american.expected_cost import expected_seconds, features, first_engine
from pricing_core.errors import InvalidInputError

CHEAP, EXPENSIVE = 2e-3, 5e-3  # seconds
STRIKE = 100.0


def random_book(rng: np.random.Generator) -> Book:
    """Return one random contract."""
    expiry = 10.0 ** rng.uniform(-2.5, 1.5)
    volatility = 10.0 ** rng.uniform(-1.5, 0.3)
    rate = rng.choice([rng.uniform(0.0, 0.1), rng.uniform(-0.02, 0.2)])
    dividend_yield = rng.choice([0.0, rng.uniform(0.0, 0.1), rng.uniform(-0.03, 0.1)])
    spot = STRIKE * math.exp(rng.normal() * min(volatility * math.sqrt(expiry), 1.0))
    fields: dict[str, Any] = {
        "option_type": rng.choice(["put", "call"]),
        "strike": STRIKE,
        "expiry": expiry,
        "spot": spot,
        "rate": rate,
        "volatility": volatility,
        "dividend_yield": dividend_yield,
    }
    kind = rng.choice(["flat", "spot", "escrowed", "curve", "bermudan", "european"])
    if kind in ("spot", "escrowed"):
        count = int(rng.choice([1, 4, 12, 50]))
        amounts = STRIKE * 0.03 / count * rng.uniform(size=count)
        times = expiry * (np.arange(count) + 0.5) / count
        fields["cash_dividends"] = [*zip(times.tolist(), amounts.tolist(), strict=True)]
        fields["dividend_model"] = kind
    elif kind == "curve":
        fields["rate"] = PiecewiseConstant((0.3 * expiry, 0.7 * expiry), (rate, rate + 0.01))
    elif kind == "bermudan":
        fields |= {"exercise": kind, "exercise_times": [expiry * k / 4 for k in range(1, 5)]}
    elif kind == "european":
        fields["exercise"] = kind
    return Book.of([contract_from(fields)])


def measured_seconds(book: Book, tolerance: float, greeks: Greeks) -> float:
    """Return the shorter of two times, or one where it is long."""
    request, best = Request(np.array([tolerance]), greeks), math.inf
    for _ in range(2):
        begun = time.perf_counter()
        solve(book, request)
        best = min(best, time.perf_counter() - begun)
        if best > 0.1:
            break
    return best


def main(count: int) -> None:
    """Measure, fit and print."""
    rng = np.random.default_rng(29)
    rows: defaultdict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    while sum(map(len, rows.values())) < count:
        try:
            book = random_book(rng)
        except InvalidInputError:  # the escrow exceeds the spot
            continue
        tolerance = float(rng.choice([1e-2, 1e-4, 1e-6, 1e-6, 1e-6, 1e-8]))
        greeks: Greeks = rng.choice(get_args(Greeks))
        seconds = measured_seconds(book, tolerance, greeks)
        expected = expected_seconds(book, tolerance, greeks)
        rows[first_engine(book), greeks].append((seconds, expected, *features(book, tolerance)))
    print(f"{cpu_model()}, {count} contracts; coefficients of ln(milliseconds)\n")
    for kind, found in sorted(rows.items()):
        print(f"{kind[0]}, {kind[1]}: {summary(np.array(found))}")
    print(f"\ntogether: {summary(np.array([row for found in rows.values() for row in found]), fit=False)}")


def summary(found: np.ndarray, *, fit: bool = True) -> str:
    """Return one line about measured and expected seconds."""
    seconds, expected, known = found[:, 0], found[:, 1], found[:, 2:]
    coefficients, *_ = np.linalg.lstsq(known, np.log(1e3 * seconds), rcond=1e-6)
    off = np.abs(np.log2(seconds / expected))
    late, early = (seconds > EXPENSIVE) & (expected < CHEAP), (seconds < CHEAP) & (expected >= CHEAP)
    fitted = f"{np.array2string(coefficients, precision=2)}, " if fit else ""
    factors = f"within a factor of 2 {np.mean(off < 1.0):.0%}, of 4 {np.mean(off < 2.0):.0%}"
    lanes = f"cheap {np.mean(seconds < CHEAP):.0%}, called expensive {np.mean(early):.1%}"
    return f"{len(found)} contracts, {fitted}{factors}; {lanes}; over 5 ms called cheap {np.mean(late):.1%}"


if __name__ == "__main__":
    main(300 if "--quick" in sys.argv[1:] else 3_000)
