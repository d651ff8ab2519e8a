"""How far from the true values of 86 reference contracts is a price, what does it cost, and what does it claim?

"beyond" counts the prices with status "ok" whose error exceeds the tolerance all the same.

Takes about two minutes. Run from the root of the project: .venv/bin/python -m benchmarks.reference_values
"""

import csv
import platform
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import pricing_core
from benchmarks.reporting.report import table
from pricing_core.american import Greeks, Market, Option, price

TABLE = Path(__file__).parents[1] / "tests" / "data" / "american_true_values.csv"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
REPEATS = 3


def contracts() -> list[tuple[Option, Market, float, float]]:
    """Return (option, market, true price, its own error as a fraction of the strike)."""
    with TABLE.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return [
        (
            Option(
                "put" if row["option_type"] == "put" else "call", float(row["strike"]), float(row["expiry"])
            ),
            Market(
                float(row["spot"]),
                float(row["rate"]),
                float(row["volatility"]),
                float(row["dividend_yield"]),
            ),
            float(row["price"]),
            float(row["reference_error"]),
        )
        for row in rows
    ]


class Priced(NamedTuple):
    """A price and what it claims, in strikes, whether its status is "ok", and the least of a few times."""

    price: float
    claim: float
    ok: bool
    milliseconds: float


def timed(option: Option, market: Market, tolerance: float, greeks: Greeks) -> Priced:
    """Price one contract a few times."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        valuation = price(option, market, tolerance=tolerance, greeks=greeks)
        times.append(1e3 * (time.perf_counter() - start))
    found, claim = valuation.price, valuation.error_estimate
    if found is None or claim is None:  # only a deadline does that
        raise ArithmeticError(f"{option} has no price: {valuation.status}")
    return Priced(found / option.strike, claim / option.strike, valuation.status == "ok", min(times))


class Row(NamedTuple):
    """One tolerance: errors as fractions of the strike, less that of the reference, times the means of single calls."""

    tolerance: float
    largest_error: float
    rms_error: float
    median_claim: float
    ok: int
    beyond: int
    milliseconds: float
    with_greeks: float


def rows() -> Iterator[Row]:
    """Price every contract at every tolerance."""
    for tolerance in TOLERANCES:
        errors, found, greeks = [], [], []
        for option, market, true, reference_error in contracts():
            found.append(timed(option, market, tolerance, greeks="none"))
            errors.append(max(abs(found[-1].price - true / option.strike) - reference_error, 0.0))
            greeks.append(timed(option, market, tolerance, greeks="standard").milliseconds)
        yield Row(
            tolerance=tolerance,
            largest_error=max(errors),
            rms_error=float(np.sqrt(np.mean(np.square(errors)))),
            median_claim=float(np.median([one.claim for one in found])),
            ok=sum(one.ok for one in found),
            beyond=sum(one.ok and error > tolerance for one, error in zip(found, errors, strict=True)),
            milliseconds=float(np.mean([one.milliseconds for one in found])),
            with_greeks=float(np.mean(greeks)),
        )


def main() -> None:
    """Print one line per tolerance."""
    print(f"kernel {pricing_core.kernel_name()}, Python {platform.python_version()}, {platform.machine()}")
    print(table("accuracy", rows()))


if __name__ == "__main__":
    main()
