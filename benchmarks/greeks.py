"""What do Greeks cost, how far is each from differences of prices at 1e-8, and do their error estimates hold?

The costs are those of `price_many` over the price alone, one thread, least of alternating rounds. For the errors,
central differences at h, 2h, ..., 32h are extrapolated in pairs. The distances of an extrapolation from its
neighbours, and what the stated errors of the bumped prices can make of it, are its own error, and the pair with the
smallest counts. A Greek is compared where that error is at most the claim; `unsure` counts the others. Contracts that
are exercised are left out, and differences over prices of exercised contracts. Differences of delta give vanna and
charm, those of vega give volga.

Takes two minutes, with --full half an hour. Run from the root of the project:
.venv/bin/python -m benchmarks.greeks [--full] [cost] [ENGINE ...]
"""

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.problems import random_contracts as kinds
from benchmarks.problems.portfolios import STRIKE
from benchmarks.problems.random_contracts import Kind, Row, rows_of
from pricing_core.american import contract_from, price_many
from pricing_core.american.book.book import CURVES, Book
from pricing_core.american.book.prices import GREEK_LISTS, Prices, error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Matrix, Vector

REFERENCE = 1e-8
TOLERANCE = 1e-6
ENGINES: dict[str, tuple[Kind, ...]] = {
    "premium-march": (kinds.flat, kinds.rate_near_yield, kinds.hours_to_expiry),
    "obstacle-march": (
        *(kinds.cash, kinds.proportional, kinds.mixed, kinds.curves, kinds.escrowed),
        *(kinds.hours_to_expiry_and_ex_date, kinds.hours_to_ex_date, kinds.near_yield_with_cash),
        *(kinds.two_boundaries, kinds.two_boundaries_with_cash),
    ),
}
COUNTS = {"premium-march": (60, 600), "obstacle-march": (20, 200)}  # Number of contracts of each kind.
# Number of contracts of each row of the table of costs; those of flat ones take 10 us each.
FLAT_COSTED, COSTED, WEEKLY_COSTED = 400, 40, 4
DIVIDENDS, WEEKLY = (0, 1, 4, 12, 60), 60  # Number of dividends; from WEEKLY on they are weekly and small.
PAID: tuple[kinds.DividendKind, ...] = ("cash", "proportional")
STEPS = 2.0 ** np.arange(6)  # The steps of the differences, in smallest ones.
FAR_OFF = 10.0  # A Greek so many claims off is printed with its contract; chosen.


class Greek(NamedTuple):
    """A Greek, the derivative by what of which column of `Prices`, and the error that is claimed of it."""

    name: str
    by: str
    of: str
    order: int
    unit: float  # Greek times this is compared with the claim
    claim: float


GREEKS = (
    Greek("delta", "spot", "value", 1, 1.0, 1e-5),
    Greek("gamma", "spot", "value", 2, STRIKE, 1e-3),
    Greek("theta", "time", "value", 1, 1 / STRIKE, 1e-5),
    Greek("charm", "time", "delta", 1, 1.0, 1e-4),
    Greek("vega", "volatility", "value", 1, 1 / STRIKE, 1e-5),
    Greek("vanna", "volatility", "delta", 1, 1.0, 1e-4),
    Greek("volga", "volatility", "vega", 1, 1 / STRIKE, 1e-4),
    Greek("rho", "rate", "value", 1, 1 / STRIKE, 1e-5),
    Greek("dividend_rho", "dividend_yield", "value", 1, 1 / STRIKE, 1e-5),
    Greek("dividend_sensitivities", "cash_dividends", "value", 1, 1.0, 1e-5),
    *(Greek(f"{name}_buckets", name, "value", 1, 1 / STRIKE, 1e-5) for name in CURVES),
)
PARALLEL = {"rate": "rho", "dividend_yield": "dividend_rho", "volatility": "vega"}


def moved(row: Row, name: str, entry: int | None, by: float) -> Row:
    """Return the contract with one parameter moved, or one entry of its list or curve; `time` moves now."""
    value = row.get(name)
    if name == "time":
        lists = {
            key: [{**each, "time": each["time"] - by} for each in row[key]]
            for key in ("cash_dividends", "proportional_dividends")
        }
        given = {key: row[key] for key in CURVES if isinstance(row[key], dict)}
        later = {key: {**each, "times": [t - by for t in each["times"]]} for key, each in given.items()}
        return {**row, **lists, **later, "expiry": row["expiry"] - by}
    if isinstance(value, list):
        entries = [{**each, "amount": each["amount"] + by * (k == entry)} for k, each in enumerate(value)]
        return {**row, name: entries}
    if isinstance(value, dict):
        values = [each + by * (entry in (None, k)) for k, each in enumerate(value["values"])]
        return {**row, name: {**value, "values": values}}
    return {**row, name: row[name] + by}


def smallest_step(row: Row, name: str, entry: int | None) -> float:
    """Return h: the largest step, 32h, is a fraction of what the value changes over, and keeps the order of events."""
    if name in ("rate", "dividend_yield"):
        return 5e-4
    if name == "cash_dividends":
        return float(row[name][entry]["amount"]) / 33
    volatility = row["volatility"]
    low = min(volatility["values"]) if isinstance(volatility, dict) else volatility
    if name == "volatility":
        return 5e-3 * float(low)
    if name == "spot":
        return 5e-3 * float(row["spot"] * min(0.4, low * np.sqrt(row["expiry"])))
    events = [each["time"] for key in ("cash_dividends", "proportional_dividends") for each in row[key]]
    events += [row[key]["times"][0] for key in CURVES if isinstance(row[key], dict)]
    return min(2.5e-4, 0.01 * float(min([row["expiry"], *events])))


def priced(rows: Sequence[Row], tolerance: float, greeks: Greeks = "none") -> Prices:
    """Price contracts on one thread."""
    book = Book.of([contract_from(row) for row in rows])
    return solve(book, Request(np.full(len(rows), tolerance), greeks))


def difference(found: Prices, greek: Greek, h: Vector) -> tuple[Vector, Vector]:
    """Return extrapolated central differences and their errors; NaN where too few prices are held.

    The prices are those of all contracts at the steps STEPS, -STEPS and 0, one step behind the other.
    """
    held = (found.status != "out_of_domain") & ~found.exercised
    shape = (2 * STEPS.size + 1, h.size)
    value: Matrix = np.where(held, getattr(found, greek.of), np.nan).reshape(shape)
    stated: Vector = getattr(found, error_of(greek.of) if greek.of != "value" else "error")
    usual = 10.0 * REFERENCE * (STRIKE if greek.of == "vega" else 1.0)
    error: Matrix = np.where(np.isnan(stated), usual, stated).reshape(shape)
    up, down, k = slice(STEPS.size), slice(STEPS.size, -1), STEPS[:, None] * h
    if greek.order == 1:
        quotient, noise = (value[up] - value[down]) / (2 * k), (error[up] + error[down]) / (2 * k)
    else:
        quotient = (value[up] - 2 * value[-1] + value[down]) / k**2
        noise = (error[up] + 2 * error[-1] + error[down]) / k**2
    best, noise = (4 * quotient[:-1] - quotient[1:]) / 3, (4 * noise[:-1] + noise[1:]) / 3
    apart = np.abs(np.diff(best, axis=0))
    doubt = apart + noise[:-1]
    doubt[1:] += np.fmax(apart[:-1] - noise[:-2], 0.0)  # coarse differences may agree by chance
    chosen = np.argmin(np.where(np.isnan(doubt), np.inf, doubt), axis=0)
    columns = np.arange(h.size)
    return best[chosen, columns], doubt[chosen, columns]


def compared(rows: list[Row], found: Prices, by: str, *, entries: bool) -> list[str]:
    """Print a line for each Greek by one parameter, or by the entries of its list; return what is far off."""
    greeks = [greek for greek in GREEKS if greek.by == by and (greek.name in GREEK_LISTS) == entries]
    cases: list[tuple[int, int | None]] = [(k, None) for k in range(len(rows))]
    if entries:
        column: Ragged = getattr(found, greeks[0].name)
        cases = [(k, j) for k, count in enumerate(column.counts().tolist()) for j in range(count)]
    if not cases:
        return []
    h = np.array([smallest_step(rows[k], by, j) for k, j in cases])
    steps = [*STEPS, *-STEPS, 0.0]
    bumped = [
        moved(rows[k], by, j, float(s * each)) for s in steps for (k, j), each in zip(cases, h, strict=True)
    ]
    needs: Greeks = "standard" if any(greek.of == "vega" for greek in greeks) else "none"
    prices, far = priced(bumped, REFERENCE, needs), []
    for greek in greeks:
        bump, doubt = (greek.unit * each for each in difference(prices, greek, h))
        given, estimate = (
            greek.unit * (each.values if isinstance(each, Ragged) else each)
            for each in (getattr(found, greek.name), getattr(found, error_of(greek.name)))
        )
        estimate = estimate if estimate.size else np.full(h.size, np.nan)
        off = np.abs(given - bump)
        print(line(greek, off, doubt, estimate), flush=True)
        for at in np.flatnonzero(off > FAR_OFF * greek.claim + doubt).tolist():
            k, j = cases[at]
            which = greek.name if j is None else f"{greek.name}[{j}]"
            numbers = f"by {off[at]:.1e} (difference to {doubt[at]:.0e}, estimate {estimate[at]:.0e})"
            far.append(f"far off: {which} {numbers} {rows[k]}")
    return far


def line(greek: Greek, off: Vector, doubt: Vector, estimate: Vector) -> str:
    """Return the table's line of one Greek."""
    sure = np.isfinite(off) & (doubt <= greek.claim)
    text = f"{greek.name:22s} {sure.sum():8d} {np.sum(np.isfinite(off) & ~sure):7d}"
    if not sure.any():
        return text
    told = sure & np.isfinite(estimate)
    q = np.quantile(off[sure], (0.5, 0.98, 1.0))
    within = np.mean(off[sure] <= greek.claim + doubt[sure])
    text += f"  {q[0]:.1e}  {q[1]:.1e}  {q[2]:.1e}  {greek.claim:.0e}  {within:6.1%}"
    if not told.any():
        return f"{text}      -"
    honest = np.mean(off[told] <= estimate[told] + doubt[told])
    return f"{text}  {honest:6.1%}  {np.median(estimate[told]) / max(np.median(off[told]), 1e-300):8.1f}"


def report(engine: str, count: int) -> None:
    """Print one line for each Greek of an engine, then the contracts that are far off."""
    rows = [row for kind in ENGINES[engine] for row in rows_of(kind, count)]
    found, asked = priced(rows, TOLERANCE, "extended"), len(rows)
    kept = np.flatnonzero((found.method == engine) & ~found.exercised)
    rows, found = [rows[k] for k in kept], found.take(kept)
    print(f"\n{engine}: {len(rows)} of {asked} contracts held and priced by it, tolerance {TOLERANCE:.0e}")
    print(
        "Greek                  compared  unsure   median     98 %      max  claim   within  honest  est./error"
    )
    lines = dict.fromkeys((greek.by, greek.name in GREEK_LISTS) for greek in GREEKS)
    far = [each for by, entries in lines for each in compared(rows, found, by, entries=entries)]
    for name, total in PARALLEL.items():
        buckets: Ragged = getattr(found, f"{name}_buckets")
        listed = np.flatnonzero(buckets.counts())
        sums = np.bincount(buckets.owner(), buckets.values, len(rows))[listed]
        if listed.size:
            apart = np.abs(sums - getattr(found, total)[listed]).max() / STRIKE
            print(f"the sum of {name}_buckets is within {apart:.1e} strikes of {total}")
    for each in far:
        print(each)


def seconds_of(rows: Sequence[Row]) -> Sequence[float]:
    """Return how long contracts take without, with the standard and with the extended Greeks, in seconds."""
    columns: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
    asked: tuple[Greeks, ...] = ("none", "standard", "extended")
    tasks = [
        Task((partial(price_many, columns, tolerance=TOLERANCE, greeks=greeks, threads=1),))
        for greeks in asked
    ]
    return least_seconds(tasks, turns=5)


def cost(title: str, rows: Sequence[Row]) -> None:
    """Print what contracts cost without, with the standard and with the extended Greeks."""
    price, standard, extended = seconds_of(rows)
    print(
        f"{title:22s}{len(rows):5d}{1e3 * price / len(rows):10.3f} ms"
        f"{standard / price:10.1f}{extended / price:10.1f}",
        flush=True,
    )


def costed_rows(number: int, kind: kinds.DividendKind, option_type: str, count: int) -> list[Row]:
    """Return contracts with so many dividends."""
    random, rows = np.random.default_rng(9), []
    for _ in range(count):
        row = {**kinds.flat(random), "option_type": option_type}
        if number < WEEKLY:
            rows.append(kinds.paying(row, kinds.spread_out(row, number, random), random, kind))
        else:
            rows.append(kinds.paying_weekly(row, number, random, kind))
    return rows


def costs(count: int, weekly: int, dividends: Sequence[int] = DIVIDENDS) -> None:
    """Print the table of costs; `weekly` is the number of contracts with weekly dividends."""
    print(f"\ncosts at the tolerance {TOLERANCE:.0e}, one thread; Greeks in times the price alone")
    print("dividends         contracts  price alone  standard  extended")
    for number in dividends:
        for kind in PAID if number else PAID[:1]:
            for option_type in ("put", "call"):
                wanted = weekly if number >= WEEKLY else count if number else FLAT_COSTED
                rows = costed_rows(number, kind, option_type, wanted)
                cost(f"{number} {kind if number else ''} {option_type}s", rows)


def main() -> None:
    """Print the costs and the errors of both engines, of more contracts with --full, or what is named."""
    full = "--full" in sys.argv
    wanted = [name for name in sys.argv[1:] if name in ("cost", *ENGINES)] or ["cost", *ENGINES]
    if "cost" in wanted:
        costs(COSTED, COSTED if full else WEEKLY_COSTED)
        cost("1, two boundaries", rows_of(kinds.two_boundaries_with_cash, COSTED))
    for engine in wanted:
        if engine != "cost":
            report(engine, COUNTS[engine][full])


if __name__ == "__main__":
    main()
