"""Which figures do README and documentation show? Measures them again, and writes them into the texts.

    .venv/bin/python -m benchmarks.figures                   # all of them: `make figures`, about twenty minutes
    .venv/bin/python -m benchmarks.figures accuracy speed    # some of them
    .venv/bin/python -m benchmarks.figures --fill            # fill the texts alone

`--conditions` says how busy the machine is, and stands beside the figures.
"""

import argparse
import os
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks import (
    batch_throughput,
    engine_frontier,
    greeks,
    obstacle_march,
    reference_values,
    service_load,
)
from benchmarks.lcs.large_problems import sparse_runs
from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.option_engine.portfolio_study import study_portfolio
from benchmarks.problems.cost_sweeps import contract
from benchmarks.problems.portfolios import everyday
from benchmarks.problems.random_contracts import Row, rows_of, two_boundaries
from benchmarks.quantlib import american_engines
from benchmarks.quantlib.american_engines import QD_FP
from benchmarks.reporting.figures import ROOT, Figures, filled, shown, source_of, write
from benchmarks.reporting.report import table
from benchmarks.serving.load import CONSTANT, NO_OP, SERVE, server
from pricing_core.american import Greeks, contract_from, price
from pricing_core.replacement import replacement

SHOWN_TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7)
BUSY = 0.5  # running processes on each core, of the load average, from which on a machine is not called quiet


class Measured(NamedTuple):
    """How a file of figures comes about: the command that a reader would type, and what measures."""

    command: str
    measure: Callable[[], Figures]


def _at(tolerance: float) -> str:
    return shown(tolerance, "{:.0e}")


def accuracy() -> Figures:
    """Price 86 known contracts at every tolerance."""
    found, single = list(reference_values.rows()), {}
    for row in found:
        single[f"{_at(row.tolerance)}.error"] = (row.largest_error, "{:.1e}")
        single[f"{_at(row.tolerance)}.price"] = (1e3 * row.milliseconds, "{:,.0f} us")
        single[f"{_at(row.tolerance)}.greeks"] = (1e3 * row.with_greeks, "{:,.0f} us")
    rows = [
        {
            "tolerance": row.tolerance,
            "largest error": row.largest_error,
            "median estimate": row.median_claim,
            "status `ok`": row.ok,
            "price alone": 1e3 * row.milliseconds,
            "with all Greeks": 1e3 * row.with_greeks,
        }
        for row in found
        if row.tolerance in SHOWN_TOLERANCES
    ]
    formats = ("{:.0e}", "{:.1e}", "{:.1e}", "{:.0f} of 86", "{:,.0f} us", "{:,.0f} us")
    return Figures(table("accuracy", rows), formats, single)


def single() -> Figures:
    """Price one contract by one call, by each engine."""
    dividends = [{"time": 0.125 + 0.25 * k, "amount": 1.0} for k in range(4)]
    cases: dict[str, tuple[Row, Greeks]] = {
        "closed": (contract("put", exercise="european"), "none"),
        "march": (contract("put"), "none"),
        "dividends": (contract("put", cash_dividends=dividends), "none"),
        "greeks": (contract("put"), "standard"),
        "greeks-dividends": (contract("put", cash_dividends=dividends), "standard"),
    }
    times: dict[str, tuple[float | list[float], str]] = {
        name: (_milliseconds(row, asked), "{:.2f} ms") for name, (row, asked) in cases.items()
    }
    two = [_milliseconds(row, "none") for row in rows_of(two_boundaries, 100)]
    times["two"] = float(np.median(two)), "{:.2f} ms"
    return Figures(single=times)


def _milliseconds(row: Row, asked: Greeks) -> float:
    call = partial(price, *contract_from(row), tolerance=1e-6, greeks=asked)
    return 1e3 * least_seconds([Task((call,))])[0]


def speed() -> Figures:
    """Price random puts and calls beside QuantLib's fastest engine, at equal errors."""
    contracts = everyday(engine_frontier.FULL.everyday)
    overhead = american_engines.call_overhead(everyday(engine_frontier.OVERHEAD_ROWS))
    study = study_portfolio("Random puts and calls", contracts, engine_frontier.FULL.effort, overhead)
    chosen = [ratio for ratio in study.ratios if ratio.peer == QD_FP]
    rows = [
        {
            "root mean square error, of the strike": ratio.rmse,
            "this engine": ratio.engine_time,
            "QuantLib QdFp": ratio.peer_time,
            "times as fast": ratio.ratio,
        }
        for ratio in chosen
    ]
    single = {_at(r.rmse): (r.engine_time or 0.0, "{:.1f} us") for r in chosen}
    return Figures(table("speed", rows), ("{:.0e}", "{:.1f} us", "{:.2g} us", "{:.2g}"), single)


def dividends() -> Figures:
    """Price books of puts and of calls with four cash dividends each, on one thread."""
    rows, single = [], {}
    lines = {
        kind: obstacle_march.measure(f"{kind}, 4 dividends", obstacle_march.ROWS) for kind in ("put", "call")
    }
    for tolerance, *both in zip(obstacle_march.TOLERANCES, *lines.values(), strict=True):
        row: dict[str, float] = {"tolerance": tolerance}
        for kind, line in zip(lines, both, strict=True):
            row |= {
                f"{kind}, price alone": line.alone_us,
                f"{kind}, with all Greeks": line.with_greeks_us,
                f"{kind}, largest error": line.largest_error,
            }
            single[f"{kind}.{_at(tolerance)}"] = (line.alone_us, "{:.0f} us")
        rows.append(row)
    return Figures(table("dividends", rows), ("{:.0e}", *(("{:.0f} us", "{:.0f} us", "{:.1e}") * 2)), single)


def greeks_cost() -> Figures:
    """Price contracts with and without Greeks, by their number of cash dividends."""
    rows = []
    for number, count in ((0, greeks.FLAT_COSTED), (4, greeks.COSTED), (60, greeks.WEEKLY_COSTED)):
        for option_type in ("put", "call"):
            alone, standard, extended = greeks.seconds_of(
                greeks.costed_rows(number, "cash", option_type, count)
            )
            rows.append(
                {
                    "contracts": f"{option_type}s, {number} cash dividends"
                    if number
                    else f"{option_type}s without events",
                    "standard Greeks, times the price alone": standard / alone,
                    "extended Greeks, times the price alone": extended / alone,
                }
            )
    return Figures(table("greeks", rows), ("{}", "{:.1f}", "{:.1f}"))


def batch() -> Figures:
    """Price a book of a million rows by file kind and threads."""
    rows = batch_throughput.measure(1_000_000)
    chosen = [
        {
            "kind": row.kind,
            "threads": row.threads,
            "seconds": row.seconds,
            "rows a second": row.rows_a_second,
            "times the arrays alone": row.over_price_many,
            "peak MB": row.peak_MB,
        }
        for row in rows
        if row.kind != "price_many"
    ]
    formats = ("{}", "{}", "{:.2f}", "{:,.0f}", "{:.2f}", "{:.0f}")
    single = {f"{row.kind}.{row.threads}": (row.over_price_many, "{:.1f}") for row in rows}
    single |= {
        f"{row.kind}.hours": (_hours_of_a_billion(row.rows_a_second), "{:.1f}")
        for row in rows
        if row.threads == 1
    }
    return Figures(table("batch", chosen), formats, single)


def _hours_of_a_billion(rows_a_second: float) -> float:
    return 1e9 / rows_a_second / 3600


def service() -> Figures:
    """Ask the service again and again, beside a constant answer of the same server."""
    with server(CONSTANT) as constant, server(NO_OP + SERVE) as empty, server(SERVE) as port:
        loops = service_load.closed_loops((constant, empty, port), 10.0)
    best = max(loops, key=lambda one: one.prices_a_second)
    processor = 1e3 / best.prices_a_second  # it has one to itself
    single = {
        "most": (best.prices_a_second, "{:,.0f}"),
        "processor": (processor, "{:.1f} ms"),
        "processor.constant": (processor * best.of_the_no_op_rate, "{:.1f} ms"),
    }
    rows = [
        {
            "clients that ask again when they have their answer": one.clients,
            "prices a second": one.prices_a_second,
            "of the constant answer's rate": one.of_the_no_op_rate,
            "median, 99 of 100": f"{one.median_ms:.2g} ms, {one.p99_ms:.2g} ms",
        }
        for one in loops
    ]
    return Figures(table("service", rows), ("{}", "{:,.0f}", "{:.2f}", "{}"), single)


def complementarity() -> Figures:
    """Solve the obstacle problem by its order."""
    runs = [one for one in sparse_runs((10_000, 100_000, 1_000_000), ("obstacle",)) if one.solver == "solve"]
    rows = [
        {
            "unknowns": one.unknowns,
            "seconds": one.seconds,
            "residual": one.residual,
            "iterations": one.iterations,
        }
        for one in runs
    ]
    return Figures(table("complementarity", rows), ("{:,}", "{:.2g} s", "{:.0e}", "{}"))


MEASURED = {
    "accuracy": Measured(".venv/bin/python -m benchmarks.reference_values", accuracy),
    "single": Measured(".venv/bin/python -m benchmarks.figures single", single),
    "speed": Measured(".venv/bin/pricing benchmark engine-frontier --output DIR", speed),
    "dividends": Measured(".venv/bin/python -m benchmarks.figures dividends", dividends),
    "greeks": Measured(".venv/bin/python -m benchmarks.greeks", greeks_cost),
    "batch": Measured(".venv/bin/pricing benchmark batch --output DIR", batch),
    "service": Measured(".venv/bin/pricing benchmark service --output DIR", service),
    "complementarity": Measured(".venv/bin/pricing benchmark complementarity --output DIR", complementarity),
}


def load() -> str:
    """Return how busy the machine is, in words."""
    busy = os.getloadavg()[0] / (os.cpu_count() or 1)
    return (
        "quiet machine"
        if busy < BUSY
        else f"busy machine, {busy:.1f} running processes a core: times are rough"
    )


def fill_texts() -> None:
    """Write what the JSON files say into README and documentation."""
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = path.read_text()
        if (new := filled(text)) != text:
            with replacement(path) as file:
                file.write(new.encode())
            print("wrote", path.relative_to(ROOT))


def main() -> None:
    """Measure, and fill the texts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", choices=[[], *MEASURED], metavar="NAME", help=", ".join(MEASURED))
    parser.add_argument("--fill", action="store_true", help="measure nothing")
    parser.add_argument("--conditions", help="how busy the machine is; by default by its load")
    given = parser.parse_args()
    for name in () if given.fill else given.names or MEASURED:
        conditions = given.conditions or load()
        found = MEASURED[name].measure()
        write(name, found, source_of(MEASURED[name].command, conditions))
        print("measured", name, flush=True)
    fill_texts()


if __name__ == "__main__":
    main()
