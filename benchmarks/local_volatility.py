"""Local volatility: what error for what work, and at what cost over a flat one?

Displaced diffusion sigma(F) = s (F + d)/F with q = r is the flat option at F + d and K + d, priced at 1e-9. Constant
elasticity sigma(S) = s (S/100)^(beta/2 - 1), and both with two cash dividends, are held against own prices at the
tolerance 1e-7, whose stated errors are printed: those of constant elasticity agree with an independent code to 3e-9 of
the strike (`tests/american/engines/obstacle_march/test_local_volatility.py`). Errors are shares of the strike.

The flat volatility beside is marched as well. Costs are the least of alternating rounds in one thread. Takes a minute.
Run from the root of the project: .venv/bin/python -m benchmarks.local_volatility [--quick]
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring.machine import cpu_model
from benchmarks.measuring.timing import Task, least_seconds
from pricing_core import kernel_name
from pricing_core.american import CashDividend, Greeks, LocalVolatility, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch
from pricing_core.american.engines.solve import solve

TOLERANCES = (1e-4, 1e-5, 1e-6)
REFERENCE = 1e-7
CONTRACTS = 64  # of a table
DIVIDENDS = (CashDividend(0.3, 2.0), CashDividend(0.8, 2.0))
SPOTS = np.geomspace(20.0, 500.0, 100)
ENGINE = CompiledMarch()

Contract = tuple[Option, Market]


class Case(NamedTuple):
    """Contracts with a local volatility, and flat ones that are as much work otherwise."""

    name: str
    local: list[Contract]
    flat: list[Contract]
    exact: list[Contract] | None = None  # Flat contracts with the same prices.


def displaced(count: int, rng: np.random.Generator, dividends: tuple[CashDividend, ...] = ()) -> Case:
    """Return puts and calls under displaced diffusions."""
    local, flat, exact = [], [], []
    for _ in range(count):
        d, s, rate = rng.uniform(-40.0, 40.0), rng.uniform(0.15, 0.45), rng.uniform(0.01, 0.08)
        strike, expiry = rng.uniform(75.0, 130.0), rng.uniform(0.2, 2.0)
        nodes = np.geomspace(max(2.0, 1.05 * -d), 4000.0, 400)
        surface = LocalVolatility.from_function(_displaced(s, d), [0.0], nodes)
        option = Option("put" if rng.uniform() < 0.5 else "call", strike, expiry)
        due = tuple(CashDividend(x.time * expiry, x.amount) for x in dividends)
        market = Market(100.0, rate, surface, rate, due)
        local.append((option, market))
        near = s * (100.0 + d) / 100.0
        flat.append((option, replace(market, volatility=near)))
        exact.append((replace(option, strike=strike + d), Market(100.0 + d, rate, s, rate)))
    name = "displaced diffusion" + (", two dividends" if dividends else "")
    return Case(name, local, flat, None if dividends else exact)


def constant_elasticity(
    count: int, rng: np.random.Generator, dividends: tuple[CashDividend, ...] = ()
) -> Case:
    """Return puts and calls under constant elasticities of variance."""
    local, flat = [], []
    for _ in range(count):
        beta, s = rng.uniform(0.0, 1.5), rng.uniform(0.15, 0.35)
        nodes = np.geomspace(10.0, 1000.0, 400)
        surface = LocalVolatility.from_function(_elastic(s, beta), [0.0], nodes)
        option = Option(
            "put" if rng.uniform() < 0.5 else "call", rng.uniform(80.0, 120.0), rng.uniform(0.2, 2.0)
        )
        due = tuple(CashDividend(x.time * option.expiry, x.amount) for x in dividends)
        market = Market(100.0, rng.uniform(0.0, 0.08), surface, rng.uniform(0.0, 0.08), due)
        local.append((option, market))
        flat.append((option, replace(market, volatility=s)))
    return Case("constant elasticity" + (", two dividends" if dividends else ""), local, flat)


def _displaced(s: float, d: float) -> Callable[[float, Any], Any]:
    return lambda time, spots: s * (spots + d) / spots


def _elastic(s: float, beta: float) -> Callable[[float, Any], Any]:
    return lambda time, spots: np.minimum(s * (spots / 100.0) ** (0.5 * beta - 1.0), 3.0)


def marched(book: Book, tolerance: float, greeks: Greeks = "none") -> Prices:
    """Price by the march of obstacle problems."""
    return ENGINE.solve(book, Request(np.full(book.count, tolerance), greeks))


def errors(case: Case) -> None:
    """Print error against work."""
    local, flat = Book.of(case.local), Book.of(case.flat)
    own = marched(local, REFERENCE)
    truth, known = own.value, float((own.error / local.strike).max())
    if case.exact is not None:
        exact = Book.of(case.exact)
        found = solve(exact, Request(np.full(exact.count, 1e-9), "none"))
        truth, known = found.value, float((found.error / local.strike).max())
    print(f"\n{case.name}, {local.count} contracts; errors of what is held to be true at most {known:.0e}")
    print("tolerance  root mean square  largest    within claim  ms a contract  flat: ms  ratio")
    for tolerance in TOLERANCES:
        seconds = least_seconds([Task((partial(marched, book, tolerance),)) for book in (local, flat)])
        found = marched(local, tolerance)
        error = np.abs(found.value - truth) / local.strike
        within = (error <= found.error / local.strike + known).mean()
        ms = [1e3 * each / local.count for each in seconds]
        print(
            f"{tolerance:9.0e}  {np.sqrt(np.mean(error**2)):16.1e}  {error.max():7.1e}  {within:12.1%}"
            f"  {ms[0]:13.2f}  {ms[1]:8.2f}  {ms[0] / ms[1]:5.2f}"
        )


def surfaces() -> dict[str, LocalVolatility | float]:
    """Return volatilities of the same size, from none that changes to one that changes everywhere."""
    return {
        "flat": 0.25,
        "1 x 100": LocalVolatility.from_function(_elastic(0.25, 1.0), [0.0], SPOTS),
        "20 x 100": LocalVolatility.from_function(
            lambda time, spots: (0.25 + 0.05 * time) * (spots / 100.0) ** (0.2 * time - 0.5),
            np.linspace(0.0, 1.0, 20),
            SPOTS,
        ),
    }


def costs() -> None:
    """Print the time of a table of volatilities relative to that of one number, at equal tolerance."""
    print(f"\n{CONTRACTS} puts of one year, tolerance 1e-6: ms a contract, and over the flat volatility's")
    for greeks in ("none", "standard"):
        books = {
            name: Book.of(
                [
                    (Option("put", strike, 1.0), Market(100.0, 0.05, volatility, 0.02))
                    for strike in np.linspace(70.0, 130.0, CONTRACTS).tolist()
                ]
            )
            for name, volatility in surfaces().items()
        }
        seconds = least_seconds([Task((partial(marched, book, 1e-6, greeks),)) for book in books.values()])
        pairs = zip(books, seconds, strict=True)
        told = (f"{name} {1e3 * s / CONTRACTS:.2f} ({s / seconds[0]:.2f})" for name, s in pairs)
        print(f"greeks {greeks}: " + ", ".join(told))


def main() -> None:
    """Print the tables."""
    quick = "--quick" in sys.argv[1:]
    count = 6 if quick else CONTRACTS
    print(f"{cpu_model()}; kernel: {kernel_name()}")
    rng = np.random.default_rng(11)
    for make in (displaced, constant_elasticity):
        for dividends in ((), DIVIDENDS):
            errors(make(count, rng, dividends))
    costs()


if __name__ == "__main__":
    main()
