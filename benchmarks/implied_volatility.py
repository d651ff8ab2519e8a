"""How many implied volatilities a second does one core find, from how many prices each, and how well are they met?

Takes about half a minute. Run from the root of the project: .venv/bin/python -m benchmarks.implied_volatility
"""

import platform
import time
from typing import Any, NamedTuple

import numpy as np

import pricing_core
from benchmarks.problems.portfolios import everyday
from pricing_core.american import implied_volatility_many, price_many

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
SECONDS = 3.0  # that each measurement is repeated for, at least
ROWS, ROWS_WITH_DIVIDENDS = 20_000, 100


class Rate(NamedTuple):
    """The time of a table of quotes; `missed` is the largest distance of price and quote, in tolerances."""

    per_second: float
    pricings: float
    missed: float
    statuses: dict[str, int]


def quotes(rows: int, dividends: int = 0) -> tuple[dict[str, Any], Any]:
    """Return random everyday contracts that are not exercised now, with so many cash dividends of 1, and prices."""
    contracts = everyday(2 * rows)
    columns = with_dividends(contracts.columns(), dividends)
    table = price_many(columns, tolerance=1e-7, greeks="none")
    held = np.flatnonzero(~table["exercise_now"])[:rows]
    return with_dividends(contracts.take(held).columns(), dividends), table["price"][held]


def with_dividends(columns: dict[str, Any], dividends: int) -> dict[str, Any]:
    """Return the columns, and dividends spread over the life of each option."""
    if not dividends:
        return columns
    shares = (np.arange(dividends) + 0.5) / dividends
    cash = [
        [{"time": share * T, "amount": 1.0} for share in shares.tolist()] for T in columns["expiry"].tolist()
    ]
    return {**columns, "cash_dividends": cash}


def measure(columns: dict[str, Any], prices: Any, tolerance: float, seconds: float = SECONDS) -> Rate:
    """Time the whole table again and again on one thread; the least time counts."""
    least, begun = float("inf"), time.perf_counter()
    while time.perf_counter() - begun < seconds:
        start = time.perf_counter()
        table = implied_volatility_many(columns, prices, tolerance=tolerance, threads=1)
        least = min(least, time.perf_counter() - start)
    ok = table["status"] == "ok"
    missed = np.abs(table["price"] - prices)[ok] / (tolerance * columns["strike"][ok])
    names, counts = np.unique(table["status"].astype(str), return_counts=True)
    statuses = dict(zip(names.tolist(), counts.tolist(), strict=True))
    return Rate(prices.size / least, float(table["iterations"][ok].mean()), float(missed.max()), statuses)


def main() -> None:
    """Print one line per tolerance, without and with cash dividends."""
    print(f"kernel {pricing_core.kernel_name()}, Python {platform.python_version()}, {platform.machine()}")
    for rows, dividends in ((ROWS, 0), (ROWS_WITH_DIVIDENDS, 2)):
        columns, prices = quotes(rows, dividends)
        print(f"{rows} everyday contracts not exercised now, {dividends} cash dividends each")
        print("tolerance  per second  prices each  largest miss  statuses")
        for tolerance in TOLERANCES:
            rate = measure(columns, prices, tolerance)
            numbers = f"{rate.per_second:10.0f}  {rate.pricings:11.2f}  {rate.missed:12.2f}"
            print(f"{tolerance:9.0e}  {numbers}  {rate.statuses}")


if __name__ == "__main__":
    main()
