"""Contracts along one parameter, and books of random contracts that are hard for one reason or another.

The sweeps show one put and one call: rate, yield, volatility and expiry move, without dividends and with four; then the
distance of two dividends, and the size of one.
"""

import time
import warnings
from typing import Any, NamedTuple

import numpy as np

from benchmarks.problems import random_contracts as kinds
from benchmarks.problems.random_contracts import Kind, Row
from pricing_core.american import price_many
from pricing_core.american.contracts.fields import Greeks
from pricing_core.errors import UnusualColumnWarning

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
    "a tenth of the spot each year": kinds.annual,
    "steep curves": kinds.steep_curves,
    "negative yields": kinds.negative_yield,
    "60 weekly dividends": kinds.weekly,
    "two boundaries": kinds.two_boundaries,
    "long-dated": kinds.long_dated,
}
RUNS = 3


class Point(NamedTuple):
    """The milliseconds of one contract, its engine and its status."""

    milliseconds: float
    method: str
    status: str


def point(row: Row, greeks: Greeks = "none", runs: int = RUNS) -> Point:
    """Price one contract alone; the least time counts."""
    columns, least, table = {name: [value] for name, value in row.items()}, float("inf"), {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusualColumnWarning)  # forty years are meant
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
