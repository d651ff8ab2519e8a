"""How far is each Greek from differences of prices at the tolerance 1e-8, and does its error estimate hold?

Random contracts for each engine; central differences at the steps h, 2h and at 2h, 4h are extrapolated, and the
distance of the two extrapolations is the error of the difference. The table counts what is compared. Left out are
contracts that are exercised, bumped or not, those with a bumped price that misses its tolerance, and differences
over which the rate crosses the yield. Buckets and dividend sensitivities are not compared.

Takes a minute, with --full ten. Run from the root of the project: .venv/bin/python -m benchmarks.greeks [--full]
"""

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.problems.portfolios import STRIKE
from pricing_core.american import contract_from
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, error_of
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Vector

Row = dict[str, Any]
ENGINES = ("premium-march", "multiplier-collocation", "sdirk2")
REFERENCE = 1e-8
TOLERANCE = 1e-6
QUICK, FULL = 200, 2000  # Number of contracts for each engine.
FAR_OFF = 10.0  # A Greek so many claims off is printed with its contract; chosen.


class Greek(NamedTuple):
    """A Greek, what is bumped by how much, of what quantity, and the error that is claimed of it."""

    name: str
    bumped: str
    step: float  # h; of the spot as a fraction of it
    of: str  # column of `Prices`
    order: int  # of the derivative
    unit: float  # Greek times this is compared with the claim
    claim: float


GREEKS = (
    Greek("delta", "spot", 2e-3, "value", 1, 1.0, 1e-5),
    Greek("gamma", "spot", 4e-3, "value", 2, STRIKE, 1e-3),
    Greek("theta", "time", 1e-3, "value", 1, 1 / STRIKE, 1e-5),
    Greek("vega", "volatility", 1e-3, "value", 1, 1 / STRIKE, 1e-5),
    Greek("rho", "rate", 5e-4, "value", 1, 1 / STRIKE, 1e-5),
    Greek("dividend_rho", "dividend_yield", 5e-4, "value", 1, 1 / STRIKE, 1e-5),
    Greek("vanna", "volatility", 2e-3, "delta", 1, 1.0, 1e-4),
    Greek("volga", "volatility", 4e-3, "value", 2, 1 / STRIKE, 1e-4),
    Greek("charm", "time", 2e-3, "delta", 1, 1.0, 1e-4),
)


def random_rows(engine: str, count: int, seed: int = 8) -> list[Row]:
    """Return random contracts that mostly fall to an engine: with dividends, or with negative rates and yields."""
    random = np.random.default_rng(seed)
    rows = []
    for _ in range(count):
        row: Row = {"option_type": str(random.choice(["put", "call"])), "strike": STRIKE}
        row |= {"spot": random.uniform(70.0, 140.0), "expiry": random.uniform(0.1, 3.0)}
        row |= {"volatility": random.uniform(0.1, 0.6), "rate": random.uniform(0.005, 0.08)}
        row["dividend_yield"] = random.uniform(0.0, 0.08)
        if random.random() < 0.1:
            row["dividend_yield"] = row["rate"] + random.uniform(-0.002, 0.002)
        row["cash_dividends"] = []
        if engine == "multiplier-collocation":
            times = np.sort(random.uniform(0.05, 0.95, random.choice([1, 4]))) * row["expiry"]
            row["cash_dividends"] = [{"time": t, "amount": random.uniform(0.2, 2.0)} for t in times.tolist()]
        if engine == "sdirk2":  # the method of lines; two boundaries
            low, high = -random.uniform(0.01, 0.03), -random.uniform(0.04, 0.06)
            is_put = row["option_type"] == "put"
            row |= {"rate": low if is_put else high, "dividend_yield": high if is_put else low}
        rows.append(row)
    return rows


def moved(row: Row, greek: Greek, steps: float) -> Row:
    """Return the contract with one parameter moved by so many steps; `time` moves now towards expiry."""
    if greek.bumped == "spot":
        return {**row, "spot": row["spot"] * (1.0 + steps * greek.step)}
    if greek.bumped == "time":
        by = steps * greek.step
        paid = [{**each, "time": each["time"] - by} for each in row["cash_dividends"]]
        return {**row, "expiry": row["expiry"] - by, "cash_dividends": paid}
    return {**row, greek.bumped: row[greek.bumped] + steps * greek.step}


def priced(rows: list[Row], tolerance: float, greeks: Any = "none") -> Prices:
    """Price contracts on one thread."""
    book = Book.of([contract_from(row) for row in rows])
    return solve(book, Request(np.full(len(rows), tolerance), greeks))


def difference(rows: list[Row], greek: Greek) -> tuple[Vector, Vector]:
    """Return extrapolated central differences and their errors; NaN where a bumped price is not ok or exercised."""

    def at(steps: float) -> Vector:
        found = priced([moved(row, greek, steps) for row in rows], REFERENCE)
        return np.where((found.status == "ok") & ~found.exercised, getattr(found, greek.of), np.nan)

    step = greek.step * (np.array([row["spot"] for row in rows]) if greek.bumped == "spot" else 1.0)
    middle = at(0.0) if greek.order == 2 else np.zeros(len(rows))
    quotient: Callable[[float], Vector] = lambda k: (  # noqa: E731
        (at(k) - at(-k)) / (2 * k * step)
        if greek.order == 1
        else (at(k) - 2 * middle + at(-k)) / (k * step) ** 2
    )
    fine, mid, coarse = quotient(1.0), quotient(2.0), quotient(4.0)
    best, second = (4 * fine - mid) / 3, (4 * mid - coarse) / 3
    gap = np.array([abs(row["rate"] - row["dividend_yield"]) for row in rows])
    if greek.bumped in ("rate", "dividend_yield"):
        best = np.where(gap > 4 * greek.step, best, np.nan)
    return best, np.abs(best - second)


def report(engine: str, count: int) -> None:
    """Print one line for each Greek of an engine, then the contracts that are far off."""
    rows = random_rows(engine, count)
    found = priced(rows, TOLERANCE, "extended")
    kept = np.flatnonzero((found.method == engine) & ~found.exercised)
    rows, found = [rows[k] for k in kept], found.take(kept)
    print(f"\n{engine}: {len(rows)} of {count} contracts held and priced by it, tolerance {TOLERANCE:.0e}")
    print("Greek         compared   median      90 %      max     claim  within  honest  estimate/error")
    wrong = []
    for greek in GREEKS if rows else ():
        bump, doubt = (greek.unit * each for each in difference(rows, greek))
        off = np.abs(greek.unit * getattr(found, greek.name) - bump)
        sure = np.isfinite(off) & np.isfinite(doubt)
        if not sure.any():
            print(f"{greek.name:13s} {0:8d}")
            continue
        estimate = greek.unit * getattr(found, error_of(greek.name))
        told = sure & np.isfinite(estimate)
        q = np.quantile(off[sure], (0.5, 0.9, 1.0))
        within = np.mean(off[sure] <= greek.claim + doubt[sure])
        honest = np.mean(off[told] <= estimate[told] + doubt[told]) if told.any() else np.nan
        ratio = np.median(estimate[told]) / np.median(off[told]) if told.any() else np.nan
        print(
            f"{greek.name:13s} {sure.sum():8d}  {q[0]:.1e}  {q[1]:.1e}  {q[2]:.1e}  {greek.claim:.0e}"
            f"  {within:6.1%}  {honest:6.1%}  {ratio:8.1f}",
            flush=True,
        )
        far = np.flatnonzero(sure & (off > FAR_OFF * greek.claim + 3 * doubt))
        wrong += [(greek.name, off[k], doubt[k], rows[k]) for k in far]
    for name, error, doubtful, row in wrong:
        print(f"far off: {name} by {error:.1e} (difference to {doubtful:.0e}) {row}")


def main() -> None:
    """Report on every engine, or on those named."""
    named = [name for name in sys.argv[1:] if name in ENGINES]
    for engine in named or ENGINES:
        report(engine, FULL if "--full" in sys.argv else QUICK)


if __name__ == "__main__":
    main()
