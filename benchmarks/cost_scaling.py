"""What does a price cost, by every parameter: scaling laws, jumps along one parameter, and tails in random books?"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.option_engine.throughput import TOLERANCE as BOOK_TOLERANCE
from benchmarks.problems.cost_sweeps import (
    BOOKS,
    DISTANCES,
    FIELDS,
    SIZES,
    Point,
    at_distance,
    at_field,
    at_size,
    contract,
    point,
)
from benchmarks.problems.portfolios import everyday
from benchmarks.problems.random_contracts import Row, rows_of
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table
from benchmarks.reporting.scaling import exponent
from pricing_core.american import price_many
from pricing_core.american.contracts.fields import Greeks

FULL, QUICK = 100, 3  # contracts of each book
TURNS = {False: 3, True: 1}


class Law(NamedTuple):
    """A parameter, its values, what a call costs at each, in milliseconds, and the exponent over the larger half."""

    parameter: str
    values: tuple[float, ...]
    milliseconds: tuple[float, ...]

    @property
    def power(self) -> float:
        """The exponent with which the cost grows along the larger half of the values."""
        return exponent(list(zip(self.values, self.milliseconds, strict=True)), len(self.values) // 2 + 1)


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes a few points of each law, one sweep, and few contracts of each book."""
    return Report(
        "cost-scaling",
        "The cost of a price",
        (__doc__ or "").splitlines()[0],
        (
            _law_section(list(_laws(quick=quick))),
            _sweep_section(quick=quick),
            _book_section(QUICK if quick else FULL),
        ),
    )


def _laws(*, quick: bool) -> Sequence[Law]:
    def some(values: Sequence[float]) -> Sequence[float]:
        return values[:: 3 if quick else 1]

    dividends = some(range(6, 61, 6))
    tolerances = some([10.0**-k for k in range(3, 9)])
    cases: dict[str, tuple[Sequence[float], Callable[[Any], tuple[dict[str, Any], dict[str, Any]]]]] = {
        "1 / tolerance, without events": (
            tuple(1.0 / each for each in tolerances),
            lambda inverse: (_columns(contract("put")), {"tolerance": 1.0 / inverse}),
        ),
        "1 / tolerance, four cash dividends": (
            tuple(1.0 / each for each in tolerances),
            lambda inverse: (_columns(at_field("put", "expiry", 4, 1.0)), {"tolerance": 1.0 / inverse}),
        ),
        "cash dividends": (dividends, lambda count: (_columns(at_field("put", "expiry", count, 1.0)), {})),
        "exercise dates": (
            some((4, 12, 52, 252)),
            lambda count: (_columns(_bermudan(count)), {}),
        ),
        "rows per call": (
            some((1, 16, 256, 4096)),
            lambda rows: (everyday(rows).columns(), {"tolerance": BOOK_TOLERANCE}),
        ),
        "expiry in years, without events": (
            some((0.1, 0.5, 2.0, 10.0)),
            lambda years: (_columns(contract("put", expiry=years)), {}),
        ),
        "volatility, without events": (
            some((0.05, 0.1, 0.2, 0.4, 0.8)),
            lambda each: (_columns(contract("put", volatility=each)), {}),
        ),
    }
    return [
        Law(name, tuple(values), _milliseconds(values, make, TURNS[quick]))
        for name, (values, make) in cases.items()
    ]


def _milliseconds(
    values: Sequence[float], make: Callable[[Any], tuple[dict[str, Any], dict[str, Any]]], turns: int
) -> tuple[float, ...]:
    tasks = []
    for value in values:
        columns, asked = make(value)
        tasks.append(
            Task(
                (
                    partial(
                        price_many, columns, **{"tolerance": 1e-6, "greeks": "none", "threads": 1, **asked}
                    ),
                )
            )
        )
    return tuple(1e3 * seconds for seconds in least_seconds(tasks, turns))


def _columns(row: Row) -> dict[str, Any]:
    return {name: [value] for name, value in row.items()}


def _bermudan(count: int) -> Row:
    times = [(k + 1.0) / count for k in range(count)]
    return contract("put", exercise="bermudan", exercise_times=times)


def _law_section(laws: Sequence[Law]) -> Section:
    rows = [
        {
            "parameter": law.parameter,
            "from": law.values[0],
            "to": law.values[-1],
            "ms at the first": law.milliseconds[0],
            "ms at the last": law.milliseconds[-1],
            "exponent": law.power,
        }
        for law in laws
    ]
    powers = "; ".join(f"the power {law.power:.2f} of {law.parameter}" for law in laws)
    text = f"""Single calls of `price_many`, one thread, 1e-6 unless the parameter is the tolerance, rows at 1e-5.
        Over the larger half of the values the cost grows as {powers}."""
    lines = {law.parameter: list(zip(law.values, law.milliseconds, strict=True)) for law in laws}
    figure = curves({"": lines}, "parameter", "milliseconds a call")
    return Section("Scaling laws", text, (table("laws", rows),), {"laws": figure})


def _sweep_section(*, quick: bool) -> Section:
    rows = []
    for option_type in ("put",) if quick else ("put", "call"):
        ways: dict[str, tuple[Sequence[float], Callable[[float], Row]]] = {
            f"{name}, {count} dividends": (values, partial(at_field, option_type, name, count))
            for name, values in FIELDS.items()
            for count in (0, 4)
        }
        ways["years between two dividends"] = (DISTANCES, partial(at_distance, option_type))
        ways["dividend as a share of the spot"] = (SIZES, partial(at_size, option_type))
        for what, (values, row_at) in ways.items():
            found = [point(row_at(value), runs=1 if quick else 3) for value in values]
            rows.append({"option": option_type, "along": what, **_largest_jump(values, found)})
    worst = max(rows, key=lambda row: row["largest ratio of neighbours"])
    text = f"""One contract alone at the tolerance 1e-6. The largest jump between two neighbouring values is
        {worst["largest ratio of neighbours"]:.2g}, of a {worst["option"]} along {worst["along"]}."""
    return Section("Jumps along one parameter", text, (table("jumps", rows),))


def _largest_jump(values: Sequence[float], found: Sequence[Point]) -> dict[str, Any]:
    times = [each.milliseconds for each in found]
    ratio, k = max((max(a / b, b / a), k) for k, (a, b) in enumerate(pairwise(times)))
    return {
        "least ms": min(times),
        "most ms": max(times),
        "largest ratio of neighbours": ratio,
        "from": values[k],
        "to": values[k + 1],
        "methods": ", ".join(dict.fromkeys(each.method for each in found[k : k + 2])),
    }


def _book_section(count: int) -> Section:
    rows: list[dict[str, Any]] = []
    asked: dict[str, Greeks] = {"alone": "none", "all Greeks": "extended"}
    for title, kind in BOOKS.items():
        book = rows_of(kind, count)
        for what, greeks in asked.items():
            found = [point(row, greeks, runs=1) for row in book]
            times = [each.milliseconds for each in found]
            levels = {"p50 ms": 0.5, "p90 ms": 0.9, "p99 ms": 0.99, "max ms": 1.0}
            quantiles = {name: float(np.quantile(times, level)) for name, level in levels.items()}
            ok = sum(each.status == "ok" for each in found) / len(found)
            rows.append({"book": title, "priced": what, **quantiles, "ok": ok})
    worst = max(rows, key=lambda row: float(row["max ms"]))
    text = f"""{count} random contracts of each kind, each priced alone at 1e-6. The slowest of all takes
        {worst["max ms"]:.2g} ms, among {worst["book"]}."""
    return Section("Tails in random books", text, (table("books", rows),))
