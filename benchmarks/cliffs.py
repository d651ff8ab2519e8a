"""Where does the time that a contract takes jump along one parameter?

One put and one call, without dividends and with four, as the rate, the yield, the volatility or the expiry moves; the
least of three runs of each point.

Takes a minute. Run from the root of the project: .venv/bin/python -m benchmarks.cliffs
"""

import time
from itertools import pairwise
from typing import Any

from pricing_core.american import price_many

RATES = (-1e-2, -1e-3, -1e-5, -1e-9, 0.0, 1e-9, 1e-5, 1e-3, 1e-2)
SWEEPS: dict[str, tuple[float, ...]] = {
    "rate": RATES,
    "dividend_yield": RATES,
    "volatility": (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5),
    "expiry": (*(0.01 * 2**k for k in range(12)), 40.0),
}
RUNS = 3


def point(row: dict[str, Any]) -> tuple[float, str, str]:
    """Return the least milliseconds of one contract, its engine and its status."""
    columns, least, table = {name: [value] for name, value in row.items()}, float("inf"), {}
    for _ in range(RUNS):
        start = time.perf_counter()
        table = price_many(columns, tolerance=1e-6, greeks="none", threads=1)
        least = min(least, time.perf_counter() - start)
    return 1e3 * least, str(table["method"][0]), str(table["status"][0])


def sweep(name: str, values: tuple[float, ...], option_type: str, dividends: int) -> None:
    """Print the points along one parameter where the time or the engine changes most."""
    row: dict[str, Any] = {"option_type": option_type, "spot": 100.0, "strike": 100.0, "expiry": 1.0}
    row |= {"rate": 0.03, "dividend_yield": 0.01, "volatility": 0.25}
    found = []
    for value in values:
        at = {**row, name: value}
        paid = [
            {"time": (k + 0.5) / max(dividends, 1) * at["expiry"], "amount": 1.0} for k in range(dividends)
        ]
        found.append(point({**at, "cash_dividends": paid}))
    times = [each[0] for each in found]
    ratio, k = max((max(b / a, a / b), k) for k, (a, b) in enumerate(pairwise(times)))
    print(f"\n{name}, {option_type}, {dividends} dividends: largest ratio {ratio:.1f} from {values[k]:g} on")
    for value, (milliseconds, method, status) in zip(values, found, strict=True):
        print(f"{value:10g}  {milliseconds:9.2f} ms  {method:24s}{status}", flush=True)


def main() -> None:
    """Print every sweep."""
    for name, values in SWEEPS.items():
        for dividends in (0, 4):
            for option_type in ("put", "call"):
                sweep(name, values, option_type, dividends)


if __name__ == "__main__":
    main()
