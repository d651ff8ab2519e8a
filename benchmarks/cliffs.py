"""Where does the time that a contract takes jump along one parameter, and how long are its tails in random books?

The sweeps show one put and one call, the least of three runs of each point: rate, yield, volatility and expiry move,
without dividends and with four; then the distance of two dividends, and the size of one. The books are random
contracts of kinds that are hard for one reason or another, each priced alone, once without Greeks and once with all.

Takes two minutes, with --full twenty. Run from the root of the project: .venv/bin/python -m benchmarks.cliffs [--full]
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from benchmarks.problems import random_contracts as kinds
from benchmarks.problems.random_contracts import Kind, Row, rows_of
from pricing_core.american import price_many
from pricing_core.american.contracts.fields import Greeks

TOLERANCE = 1e-6
RATES = (-1e-2, -1e-3, -1e-5, -1e-9, 0.0, 1e-9, 1e-5, 1e-3, 1e-2)
FIELDS: dict[str, tuple[float, ...]] = {
    "rate": RATES,
    "dividend_yield": RATES,
    "volatility": (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5),
    "expiry": (*(0.01 * 2**k for k in range(12)), 40.0),
}
DISTANCES = (1e-11, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 0.1)  # years
SIZES = (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.05, 0.1, 0.2, 0.4, 0.6)  # fractions of the spot
BOOKS: dict[str, Kind] = {
    "quarterly dividends": kinds.quarterly,
    "volatility 80-150 %": kinds.volatile,
    "specials of 20-50 %": kinds.special,
    "steep curves": kinds.steep_curves,
    "negative yields": kinds.negative_yield,
    "60 weekly dividends": kinds.weekly,
    "two boundaries": kinds.two_boundaries,
    "long-dated": kinds.long_dated,
}
QUICK, FULL = 20, 200  # Number of contracts of each book.
RUNS = 3


class Point(NamedTuple):
    """The milliseconds of one contract, its engine and its status."""

    milliseconds: float
    method: str
    status: str


def point(row: Row, greeks: Greeks = "none", runs: int = RUNS) -> Point:
    """Price one contract alone; the least time counts."""
    columns, least, table = {name: [value] for name, value in row.items()}, float("inf"), {}
    for _ in range(runs):
        start = time.perf_counter()
        table = price_many(columns, tolerance=TOLERANCE, greeks=greeks, threads=1)
        least = min(least, time.perf_counter() - start)
    return Point(1e3 * least, str(table["method"][0]), str(table["status"][0]))


def contract(option_type: str, **given: Any) -> Row:
    """Return the contract that the sweeps start from, with what is given in its place."""
    row: Row = {"option_type": option_type, "spot": 100.0, "strike": 100.0, "expiry": 1.0}
    return {**row, "rate": 0.03, "dividend_yield": 0.01, "volatility": 0.25, "cash_dividends": [], **given}


def at_field(option_type: str, name: str, dividends: int, value: float) -> Row:
    """Return the contract with one field at this value, and cash dividends of 1 spread over its life."""
    row = contract(option_type, **{name: value})
    times = (np.arange(dividends) + 0.5) / max(dividends, 1) * row["expiry"]
    return {**row, "cash_dividends": [{"time": time, "amount": 1.0} for time in times.tolist()]}


def at_distance(option_type: str, years: float) -> Row:
    """Return the contract with two cash dividends of 1, so many years apart."""
    return contract(option_type, cash_dividends=[{"time": t, "amount": 1.0} for t in (0.5, 0.5 + years)])


def at_size(option_type: str, size: float) -> Row:
    """Return the contract with one cash dividend, a fraction of the spot."""
    return contract(option_type, cash_dividends=[{"time": 0.5, "amount": 100.0 * size}])


def sweep(title: str, values: Sequence[float], row_at: Callable[[float], Row]) -> None:
    """Print the points along one parameter, and above them where the time changes most."""
    found = [point(row_at(value)) for value in values]
    ratio, k = max(
        (max(b.milliseconds / a.milliseconds, a.milliseconds / b.milliseconds), k)
        for k, (a, b) in enumerate(pairwise(found))
    )
    print(f"\n{title}: largest ratio {ratio:.1f} from {values[k]:g} on")
    for value, each in zip(values, found, strict=True):
        print(f"{value:10g}  {each.milliseconds:9.2f} ms  {each.method:24s}{each.status}", flush=True)


def sweeps() -> None:
    """Print every sweep."""
    for option_type in ("put", "call"):
        for name, values in FIELDS.items():
            for dividends in (0, 4):
                title = f"{name}, {option_type}, {dividends} dividends"
                sweep(title, values, partial(at_field, option_type, name, dividends))
        sweep(f"years between two dividends, {option_type}", DISTANCES, partial(at_distance, option_type))
        sweep(f"dividend as a share of the spot, {option_type}", SIZES, partial(at_size, option_type))


def shares(names: Sequence[str]) -> str:
    """Return how many of the names there are of each, in per cent."""
    return ", ".join(f"{name or 'none'} {n / len(names):.0%}" for name, n in Counter(names).most_common())


def book(title: str, rows: Sequence[Row]) -> None:
    """Print the quantiles of the times of contracts priced alone, their statuses and methods, and the slowest."""
    print(f"\n{f'{title}, {len(rows)} contracts':32s}      p50      p90      p99      max ms")
    asked: tuple[Greeks, ...] = ("none", "extended")
    for greeks in asked:
        found = [point(row, greeks, runs=1) for row in rows]
        times = [each.milliseconds for each in found]
        q = "".join(f"{each:9.1f}" for each in np.quantile(times, (0.5, 0.9, 0.99, 1.0)))
        print(f"{'price alone' if greeks == 'none' else 'all Greeks':32s}{q}", flush=True)
    print(f"  {shares([each.status for each in found])}; {shares([each.method for each in found])}")
    print(f"  slowest: {rows[int(np.argmax(times))]}")


def main() -> None:
    """Print every sweep and every book."""
    sweeps()
    count = FULL if "--full" in sys.argv else QUICK
    for title, kind in BOOKS.items():
        book(title, rows_of(kind, count))


if __name__ == "__main__":
    main()
