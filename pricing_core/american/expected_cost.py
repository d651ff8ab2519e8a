"""How long a price will take, told before the work begins."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.solve import ENGINES
from pricing_core.arrays import Vector

LEAST = 1e-3  # Smallest standard deviation and sum of rates that count as different; chosen.
# ln(milliseconds) by engine and Greeks: a constant, and factors of the logarithms that `features` returns. Fitted by
# `python -m benchmarks.service_costs`, which prints them and how far off they are.
COEFFICIENTS: Mapping[tuple[str, str], tuple[float, ...]] = {
    ("closed form", "none"): (-2.7, 0.0, 0.3, 0.0, 0.0),
    ("closed form", "standard"): (-2.3, 0.0, 0.3, 0.0, 0.0),
    ("closed form", "extended"): (-1.9, 0.0, 0.3, 0.0, 0.0),
    ("premium march", "none"): (-1.2, 0.27, 0.0, 0.0, 0.17),
    ("premium march", "standard"): (0.0, 0.41, 0.0, 0.2, 0.36),
    ("premium march", "extended"): (1.4, 0.46, 0.0, 0.3, 0.4),
    ("compiled march", "none"): (-1.9, 0.1, 0.7, 0.1, 0.13),
    ("compiled march", "standard"): (-0.6, 0.12, 0.75, 0.2, 0.29),
    ("compiled march", "extended"): (0.5, 0.13, 0.64, 0.24, 0.36),
    ("hardly diffusing", "none"): (5.5, 0.3, 0.7, 0.0, 0.0),
    ("hardly diffusing", "standard"): (6.0, 0.3, 0.7, 0.0, 0.0),
    ("hardly diffusing", "extended"): (7.0, 0.3, 0.7, 0.0, 0.0),
    ("obstacle march", "none"): (4.5, 0.7, 0.7, 0.5, 0.0),
    ("obstacle march", "standard"): (6.5, 0.7, 0.7, 0.5, 0.0),
    ("obstacle march", "extended"): (7.5, 0.7, 0.7, 0.5, 0.0),
}


def expected_seconds(book: Book, tolerance: float, greeks: Greeks) -> float:
    """Return how long a price is expected to take: a typical value, off by a factor of two as often as not.

    Parameters
    ----------
    book : Book
        One contract.
    tolerance : float
        As in `price`.

    Examples
    --------
    >>> from pricing_core.american import Market, Option
    >>> book = Book.of([(Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2))])
    >>> expected_seconds(book, 1e-6, "standard") < expected_seconds(book, 1e-8, "extended") < 0.1
    True
    """
    factors = COEFFICIENTS[first_engine(book), greeks]
    return 1e-3 * math.exp(sum(map(float.__mul__, factors, features(book, tolerance))))


def first_engine(book: Book) -> str:
    """Return the name of the engine that is asked first for one contract."""
    return next((engine.name for engine in ENGINES if engine.serves(book)[0]), ENGINES[-1].name)


def features(book: Book, tolerance: float) -> tuple[float, ...]:
    """Return 1 and the numbers of one contract on which the logarithm of the cost depends linearly.

    The tolerance, the number of segments, and the standard deviation of ln S and the sum of the rates to the expiry.
    """
    columns = book.segments
    spread = math.sqrt(_total(columns.volatility**2, columns.duration))
    rates = _total(np.abs(columns.rate), columns.duration)
    return (
        1.0,
        math.log10(1e-6 / tolerance),
        math.log2(columns.end.size),
        math.log10(max(spread, LEAST)),
        math.log10(max(rates, LEAST)),
    )


def _total(numbers: Vector, durations: Vector) -> float:
    return float(np.dot(numbers, durations))
