"""How many contracts with four cash dividends does one core price in a second, and how far are their prices off?

Random American puts and calls, apart: spot 60 to 150, strike 100, rate 0.5 to 8 %, yield nothing or up to 5 %,
volatility 10 to 60 %, 30 days to 3 years, four dividends of 0.2 to 2 % of the spot each within the first year. Errors
are distances from the collocation's own prices at the tolerance 1e-8; where QuantLib is installed, its finite
differences are held against these as well. The kernel's time is measured inside the same calls; what is left is Python.
The chapter's road, asked for by name, prices the same contracts, and is held against QuantLib at equal error.

Takes a minute, three with QuantLib. Run from the root of the project: .venv/bin/python -m benchmarks.events
"""

import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import pricing_core
from benchmarks.measuring.machine import cpu_model
from benchmarks.problems.portfolios import DAYS_PER_YEAR, STRIKE, Portfolio
from benchmarks.quantlib import cash_dividends
from pricing_core import kernel
from pricing_core.american import Greeks, contract_from, price_many
from pricing_core.american.book.book import Book
from pricing_core.american.engines.multiplier_collocation.levels import solve_at_level, solve_to_tolerance
from pricing_core.arrays import Matrix, Vector

COLLOCATED = "multiplier-collocation"
TOLERANCES = (1e-4, 1e-5, 1e-6)
LINES_TOLERANCES = (1e-3, 1e-4, 1e-5)
REFERENCE = 1e-8
LEVELS = (1, 2, 3, 4, 5)
SECONDS = 1.0  # Least time that each measurement is repeated for.
ROWS = 2000  # Number of puts, and of calls.
QUANTLIB_ROWS = 100
DIVIDENDS = 4


class Dividends(NamedTuple):
    """Cash dividends, one row per contract."""

    days: NDArray[np.int64]  # (n, 4), from now
    amounts: Matrix  # (n, 4), money

    def column(self) -> list[list[dict[str, float]]]:
        """Return what `price_many` takes."""
        return [
            [{"time": day / DAYS_PER_YEAR, "amount": amount} for day, amount in zip(*row, strict=True)]
            for row in zip(self.days.tolist(), self.amounts.tolist(), strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Payers:
    """Contracts of one type and their dividends."""

    contracts: Portfolio
    dividends: Dividends

    def columns(self) -> dict[str, Any]:
        """Return what `price_many` takes."""
        return {**self.contracts.columns(), "cash_dividends": self.dividends.column()}

    def book(self) -> Book:
        """Return what the engines take."""
        columns = self.columns()
        rows = zip(*(c if isinstance(c, list) else c.tolist() for c in columns.values()), strict=True)
        return Book.of([contract_from(dict(zip(columns, row, strict=True))) for row in rows])


def random_book(option_type: str, count: int, seed: int = 6) -> Payers:
    """Return random contracts; puts and calls of one seed differ in their type alone."""
    random = np.random.default_rng(seed)
    spot = random.uniform(60.0, 150.0, count)
    days = random.integers(30, 3 * DAYS_PER_YEAR, count, endpoint=True)
    rate = random.uniform(0.005, 0.08, count)
    dividend_yield = np.where(random.random(count) < 0.5, 0.0, random.uniform(0.0, 0.05, count))
    volatility = random.uniform(0.1, 0.6, count)
    quarter = np.minimum(days, DAYS_PER_YEAR)[:, None] / DIVIDENDS
    ex_days = np.floor((np.arange(DIVIDENDS) + random.uniform(0.2, 0.95, (count, 1))) * quarter)
    amounts = spot[:, None] * random.uniform(0.002, 0.02, (count, DIVIDENDS))
    types, strikes = np.full(count, option_type), np.full(count, STRIKE)
    contracts = Portfolio(types, spot, strikes, days, rate, dividend_yield, volatility)
    return Payers(contracts, Dividends(ex_days.astype(np.int64), amounts))


@dataclass(slots=True)
class Meter:
    """What the kernel did: schedules solved, European ones too, and seconds."""

    solves: int = 0
    seconds: float = 0.0


@contextmanager
def metered() -> Iterator[Meter]:
    """Count the kernel's schedules and time."""
    meter, solve = Meter(), kernel.solve_schedules

    def timed(sign: Vector, *others: Any) -> Any:
        start = time.perf_counter()
        found = solve(sign, *others)
        meter.seconds += time.perf_counter() - start
        meter.solves += sign.size
        return found

    with patch.object(kernel, "solve_schedules", timed):
        yield meter


class Rate(NamedTuple):
    """What a table of contracts takes, in its quickest run; errors are fractions of the strike."""

    per_second: float
    solves: float  # solves per contract
    microseconds: float  # time per solve
    kernel: float  # share of the time
    collocated: float  # share of the rows, as the next two
    ok: float
    within: float  # error at most the stated one
    error: float  # largest


def measure(
    payers: Payers, reference: Vector, tolerance: float, *, greeks: Greeks, seconds: float = SECONDS
) -> Rate:
    """Price the whole table again and again on one thread; the least time counts."""
    columns, least, used, begun = payers.columns(), float("inf"), Meter(), time.perf_counter()
    while True:
        with metered() as meter:
            start = time.perf_counter()
            table = price_many(columns, tolerance=tolerance, greeks=greeks, threads=1)
            took = time.perf_counter() - start
        if took < least:
            least, used = took, meter
        if time.perf_counter() - begun >= seconds:
            break
    error = np.abs(table["price"] - reference)
    sure = np.isfinite(error)
    return Rate(
        per_second=error.size / least,
        solves=used.solves / error.size,
        microseconds=1e6 * used.seconds / max(used.solves, 1),
        kernel=used.seconds / least,
        collocated=float(np.mean(table["method"] == COLLOCATED)),
        ok=float(np.mean(table["status"] == "ok")),
        within=float(np.mean(error[sure] <= table["error_estimate"][sure])),
        error=float(np.nanmax(error)) / STRIKE,
    )


def solve_times(book: Book, seconds: float = SECONDS) -> list[float]:
    """Return the least microseconds of one American solve at each level, all schedules in one call."""
    times = []
    for level in LEVELS:
        levels, least, begun = np.full(book.count, level, dtype=np.int64), float("inf"), time.perf_counter()
        while time.perf_counter() - begun < seconds / len(LEVELS):
            start = time.perf_counter()
            solve_at_level(book, levels, 1)
            least = min(least, time.perf_counter() - start)
        times.append(1e6 * least / book.count)
    return times


def rates(option_type: str, rows: int = ROWS, seconds: float = SECONDS) -> dict[Greeks, dict[float, Rate]]:
    """Return what a table of one option type takes at each tolerance, without and with all Greeks."""
    payers = random_book(option_type, rows)
    exact = STRIKE * solve_to_tolerance(payers.book(), np.full(rows, REFERENCE), 1).value
    asked: tuple[Greeks, ...] = ("none", "standard")
    return {
        greeks: {
            tolerance: measure(payers, exact, tolerance, greeks=greeks, seconds=seconds)
            for tolerance in TOLERANCES
        }
        for greeks in asked
    }


def report(option_type: str, rows: int = ROWS, seconds: float = SECONDS) -> None:
    """Print the table of one option type."""
    payers = random_book(option_type, rows)
    book = payers.book()
    found = solve_to_tolerance(book, np.full(rows, REFERENCE), 1)
    exact, stated = STRIKE * found.value, found.error
    print(f"\n{rows} American {option_type}s with {DIVIDENDS} cash dividends each")
    print(
        f"reference: the collocation at {REFERENCE:.0e}, own stated errors {np.nanmedian(stated):.0e} (median)",
        end="",
    )
    print(f" to {stated.max():.0e}")
    print(
        "                       contracts    solves  us each   kernel  by collo-          within    largest"
    )
    print("tolerance  Greeks     per second  each row    solve  of time    cation      ok  stated      error")
    asked: tuple[Greeks, ...] = ("none", "standard")
    for greeks in asked:
        for tolerance in TOLERANCES:
            rate = measure(payers, exact, tolerance, greeks=greeks, seconds=seconds)
            setting = f"{tolerance:9.0e}  {'without' if greeks == 'none' else 'with':7s}"
            speed = (
                f"{rate.per_second:12.0f}  {rate.solves:8.1f}  {rate.microseconds:7.0f}  {rate.kernel:7.0%}"
            )
            shares = f"{rate.collocated:9.1%}  {rate.ok:6.1%}  {rate.within:6.1%}"
            print(f"{setting}  {speed}  {shares}  {rate.error:9.1e}")
    alone = ", ".join(
        f"level {level}: {us:.0f}" for level, us in zip(LEVELS, solve_times(book, seconds), strict=True)
    )
    print(f"the kernel alone, us per American solve: {alone}")
    points = _report_quantlib(payers, exact) if cash_dividends.AVAILABLE else []
    _report_lines(payers, exact, points)


class Point(NamedTuple):
    """What a price takes and how far off it is, root of the mean square, as a fraction of the strike."""

    milliseconds: float
    error: float


def time_at_error(points: list[Point], error: float) -> float:
    """Return the milliseconds at another error, on the straight line through the logarithms of the points."""
    times, errors = np.log(np.array(points)).T
    slope, offset = np.polyfit(errors, times, 1)
    return float(np.exp(slope * np.log(error) + offset))


def _report_lines(payers: Payers, reference: Vector, quantlib: list[Point]) -> None:
    """Print what the chapter's road takes, and how often that goes into QuantLib's time at equal error."""
    columns = payers.columns()
    for tolerance in LINES_TOLERANCES:
        start = time.perf_counter()
        table = price_many(columns, tolerance=tolerance, greeks="none", method="lcs", threads=1)
        milliseconds = 1e3 * (time.perf_counter() - start) / reference.size
        error = float(np.sqrt(np.nanmean(np.square(table["price"] - reference)))) / STRIKE
        told = f"the chapter's road at {tolerance:.0e}: {milliseconds:.2f} ms each, rms error {error:.1e}"
        if quantlib:
            finest = min(quantlib, key=lambda point: point.error)
            times = time_at_error(quantlib, max(error, finest.error)) / milliseconds
            told += f"; QuantLib takes {times:.0f} x as long at "
            told += "this error" if error >= finest.error else f"{finest.error / error:.0f} x the error"
        print(told)


def _report_quantlib(payers: Payers, reference: Vector) -> list[Point]:
    """Print a line for each grid, and return them as points."""
    points = []
    chosen = payers.contracts.sample(min(QUANTLIB_ROWS, len(payers.contracts)))
    few = payers.contracts.take(chosen)
    days, amounts = payers.dividends.days[chosen], payers.dividends.amounts[chosen]
    for steps, nodes in cash_dividends.GRIDS:
        options = cash_dividends.options_with_dividends(few, days, amounts, steps, nodes)
        start = time.perf_counter()
        found = cash_dividends.prices(options)
        milliseconds = 1e3 * (time.perf_counter() - start) / len(few)
        error = np.abs(found - reference[chosen]) / STRIKE
        root = np.sqrt(np.mean(np.square(error)))
        print(
            f"QuantLib finite differences, explicit projection, {steps} steps x {nodes} nodes, {len(few)} of them: "
            f"{milliseconds:.1f} ms each, rms error {root:.1e}, largest {error.max():.1e}"
        )
        points.append(Point(milliseconds, float(root)))
    return points


def main() -> None:
    """Print one table for puts and one for calls."""
    print(
        f"{cpu_model()}, kernel {pricing_core.kernel_name()}, Python {platform.python_version()}, one thread"
    )
    print("errors as fractions of the strike; within stated: the error is at most the one stated")
    for option_type in ("put", "call"):
        report(option_type)


if __name__ == "__main__":
    main()
