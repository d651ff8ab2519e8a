"""What does the march of obstacle problems cost a book, and how far is it off, beside the engines that price it today?

Random books of each family, prices alone, by the compiled march and by the engines in their order, at the tolerances
1e-4, 1e-5 and 1e-6 of the strike; true values are the engines' own at 1e-7. Times are processor times of one thread,
the least of three. Run from the root of the project: .venv/bin/python -m benchmarks.obstacle_march [--quick]
"""

import math
import sys
from collections.abc import Callable
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.reporting.report import table
from pricing_core.american import CashDividend, Market, Option, ProportionalDividend
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import OptionType
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march.march_book import march_book
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Vector

TOLERANCES = (1e-4, 1e-5, 1e-6)


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
    root_mean_square: float
    largest_error: float
    within_estimates: float
    march_us: float
    engines_us: float
    times_faster: float
    cells: float


def _least_time(work: Callable[[], Any], repeats: int = 3) -> float:
    times = []
    for _ in range(repeats):
        begun = process_time()
        work()
        times.append(process_time() - begun)
    return min(times)


def compare(family: str, count: int, tolerance: float) -> Line:
    """Price a book in both ways."""
    book, wanted = random_book(family, count), np.full(count, tolerance)
    true = solve(book, Request(np.full(count, 1e-7), greeks="none"))
    found = march_book(book, wanted)
    error: Vector = np.abs(found.value - true.value)
    own = _least_time(lambda: march_book(book, wanted))
    engines = _least_time(lambda: solve(book, Request(wanted, greeks="none")))
    return Line(
        family,
        tolerance,
        float(np.sqrt(np.mean(error**2))),
        float(error.max()),
        float(np.mean(error <= found.error_estimate + true.error)),
        1e6 * own / count,
        1e6 * engines / count,
        engines / own,
        float(found.cells.mean()),
    )


def main() -> None:
    """Print the table."""
    count = 32 if "--quick" in sys.argv else 512
    lines = [compare(family, count, tolerance) for family in FAMILIES for tolerance in TOLERANCES]
    print(table("books", lines))


if __name__ == "__main__":
    main()
