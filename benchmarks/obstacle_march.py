"""What does a book by the march of obstacle problems take, how far is it off, and do its error estimates hold?

Random books of each family, strike 1, without and with Greeks, on one thread; flat puts, which the march of the premium
prices, stand beside them. Errors are distances from the same engine's prices at the tolerance 1e-8, whose own estimates
count as well where coverage is told. Times are processor times, the least of three.

Takes two minutes. Run from the root of the project: .venv/bin/python -m benchmarks.obstacle_march [--quick]
"""

import math
import sys
from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.reporting.report import table
from pricing_core.american import CashDividend, Greeks, Market, Option, ProportionalDividend
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.fields import OptionType
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import FAST_ENGINES, solve

TOLERANCES = (1e-4, 1e-5, 1e-6)
REFERENCE = 1e-8
ROWS, QUICKLY = 256, 8  # contracts of each family


class Terms(NamedTuple):
    """What is the same in all families: years, volatility, rate, yield, spot for a strike of 1."""

    expiry: float
    volatility: float
    rate: float
    dividend_yield: float
    spot: float


def random_terms(rng: np.random.Generator, *, two_boundaries: bool = False) -> Terms:
    """Return random terms: weeks to years, 10 to 70 %, within 1.2 deviations of the strike."""
    expiry = math.exp(rng.uniform(math.log(0.05), math.log(3.0)))
    volatility = math.exp(rng.uniform(math.log(0.1), math.log(0.7)))
    rate, dividend_yield = rng.uniform(-0.01, 0.1), rng.uniform(0.0, 0.06)
    if two_boundaries:
        rate = rng.uniform(-0.03, -0.005)
        dividend_yield = rate - rng.uniform(0.005, 0.04)
    spot = math.exp(rng.uniform(-1.2, 1.2) * volatility * math.sqrt(expiry))
    return Terms(expiry, volatility, rate, dividend_yield, spot)


def _times(rng: np.random.Generator, count: int, expiry: float) -> list[float]:
    times: list[float] = (np.sort(rng.uniform(0.02, 0.98, count)) * expiry).tolist()
    return times


def _plain(option_type: OptionType, *, two_boundaries: bool = False) -> Callable[..., tuple[Option, Market]]:
    def make(rng: np.random.Generator) -> tuple[Option, Market]:
        given = random_terms(rng, two_boundaries=two_boundaries)
        market = Market(given.spot, given.rate, given.volatility, given.dividend_yield)
        return Option(option_type, 1.0, given.expiry), market

    return make


def _paid(option_type: OptionType, count: int, **more: Any) -> Callable[..., tuple[Option, Market]]:
    def make(rng: np.random.Generator) -> tuple[Option, Market]:
        given = random_terms(rng)
        amounts = (rng.uniform(0.001, 0.02, count) * 4.0 / max(count, 4)).tolist()
        cash = tuple(map(CashDividend, _times(rng, count, given.expiry), amounts))
        market = Market(
            given.spot, given.rate, given.volatility, given.dividend_yield, cash_dividends=cash, **more
        )
        return Option(option_type, 1.0, given.expiry), market

    return make


def _proportional(rng: np.random.Generator) -> tuple[Option, Market]:
    given = random_terms(rng)
    fractions = rng.uniform(0.001, 0.03, 3).tolist()
    paid = tuple(map(ProportionalDividend, _times(rng, 3, given.expiry), fractions))
    market = Market(
        given.spot, given.rate, given.volatility, given.dividend_yield, proportional_dividends=paid
    )
    return Option("put", 1.0, given.expiry), market


def _bermudan(rng: np.random.Generator) -> tuple[Option, Market]:
    given = random_terms(rng)
    dates = tuple(_times(rng, 4, given.expiry))
    market = Market(given.spot, given.rate, given.volatility, given.dividend_yield)
    return Option("put", 1.0, given.expiry, exercise="bermudan", exercise_times=dates), market


FAMILIES: dict[str, Callable[[np.random.Generator], tuple[Option, Market]]] = {
    "put": _plain("put"),
    "put, two boundaries": _plain("put", two_boundaries=True),
    "put, 4 dividends": _paid("put", 4),
    "call, 4 dividends": _paid("call", 4),
    "put, 12 dividends": _paid("put", 12),
    "put, 60 dividends": _paid("put", 60),
    "call, 4 escrowed dividends": _paid("call", 4, dividend_model="escrowed"),
    "put, 3 proportional dividends": _proportional,
    "Bermudan put, 4 dates": _bermudan,
}


def random_book(family: str, count: int, seed: int = 5) -> Book:
    """Return a book of so many random contracts of a family."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
    return Book.of([FAMILIES[family](rng) for _ in range(count)])


class Line(NamedTuple):
    """What was found of one family at one tolerance; errors in strikes, times in microseconds a contract."""

    family: str
    tolerance: float
    alone_us: float
    with_greeks_us: float
    root_mean_square: float
    largest_error: float
    covered: float  # share of the errors that are at most the estimated ones
    ok: float


def priced(book: Book, tolerance: float, greeks: Greeks = "none") -> Prices:
    """Price a book on one thread."""
    request = Request(np.full(book.count, tolerance), greeks)
    return solve(book, request, engines=FAST_ENGINES)


def measure(family: str, count: int) -> list[Line]:
    """Price one book at every tolerance."""
    book = random_book(family, count)
    true, lines = priced(book, REFERENCE), []
    for tolerance in TOLERANCES:
        alone, with_greeks = (
            _least_time(partial(priced, book, tolerance, greeks)) for greeks in ("none", "standard")
        )
        found = priced(book, tolerance)
        error = np.abs(found.value - true.value)
        lines.append(
            Line(
                family,
                tolerance,
                1e6 * alone / count,
                1e6 * with_greeks / count,
                float(np.sqrt(np.mean(error**2))),
                float(error.max()),
                float(np.mean(error <= found.error + true.error)),
                float(np.mean(found.status == "ok")),
            )
        )
    return lines


def _least_time(work: Callable[[], object], repeats: int = 3) -> float:
    times = []
    for _ in range(repeats):
        begun = process_time()
        work()
        times.append(process_time() - begun)
    return min(times)


def main() -> None:
    """Print the table."""
    count = QUICKLY if "--quick" in sys.argv else ROWS
    print(table("books", [line for family in FAMILIES for line in measure(family, count)]))


if __name__ == "__main__":
    main()
