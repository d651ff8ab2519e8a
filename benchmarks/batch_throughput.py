"""What does a book cost as a file: rows a second and peak memory by file kind and threads, beside `price_many`?

Every run is a process of its own, so that its peak
memory is its own; `price_many` is given the same contracts as arrays in a process as well.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.problems.portfolios import everyday
from benchmarks.reporting.report import Report, Section, table

TOLERANCE = 1e-5
THREADS = (1, 2)
CHILD = """
import json, sys, time
arguments = json.loads(sys.argv[1])
if arguments["kind"] == "price_many":
    import numpy as np
    import pyarrow.parquet as pq
    from pricing_core.american import price_many
    table = pq.read_table(arguments["source"])
    columns = {n: table[n].to_pylist() if n == "cash_dividends" else table[n].to_numpy() for n in table.schema.names}
    start = time.perf_counter()
    price_many(columns, tolerance=arguments["tolerance"], greeks=arguments["greeks"], threads=arguments["threads"])
else:
    from pricing_core.batch import run_batch
    start = time.perf_counter()
    run_batch(arguments["source"], arguments["target"], tolerance=arguments["tolerance"],
              greeks=arguments["greeks"], threads=arguments["threads"])
seconds = time.perf_counter() - start
(peak,) = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print(json.dumps([seconds, int(peak) / 1024]))
"""


class BatchRun(NamedTuple):
    """One run of a book: rows a second, its time over that of `price_many` on as many threads, and its peak memory."""

    kind: str
    threads: int
    seconds: float
    rows_a_second: float
    over_price_many: float
    peak_MB: float


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes a small book without events on one thread."""
    flat = measure(20_000 if quick else 1_000_000, (1,) if quick else THREADS)
    sections = [_section("Contracts without events, all standard Greeks", "flat", flat)]
    if not quick:
        paying = measure(50_000, THREADS, dividends=True)
        sections.append(_section("Contracts with four cash dividends, prices alone", "dividends", paying))
    return Report("batch", "Books as files", (__doc__ or "").splitlines()[0], tuple(sections))


def _section(title: str, name: str, runs: Sequence[BatchRun]) -> Section:
    fastest = max((one for one in runs if one.kind != "price_many"), key=lambda one: one.rows_a_second)
    text = f"""{fastest.kind.capitalize()} on {fastest.threads} thread{"s" * (fastest.threads > 1)} is the fastest file,
        {fastest.rows_a_second:,.0f} rows a second, {fastest.over_price_many:.2f} times the time of `price_many`; no
        run takes more than {max(one.peak_MB for one in runs):,.0f} MB."""
    return Section(title, text, (table(name, runs),))


def measure(rows: int, threads: Sequence[int] = THREADS, *, dividends: bool = False) -> list[BatchRun]:
    """Write a book, and price it as arrays and from either kind of file."""
    greeks = "none" if dividends else "standard"
    with tempfile.TemporaryDirectory(prefix="batch-") as name:
        write_books(Path(name), rows, dividends=dividends)
        return [one for count in threads for one in _runs(Path(name), rows, count, greeks)]


def write_books(folder: Path, rows: int, *, dividends: bool) -> None:
    """Write a random book as book.parquet and book.csv."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.csv as pa_csv  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    columns: dict[str, Any] = {name: pa.array(cells) for name, cells in everyday(rows).columns().items()}
    if dividends:
        times = [0.1 + 0.2 * k for k in range(4)]
        columns["expiry"] = pa.array([1.0] * rows)
        columns["cash_dividends"] = pa.array([[{"time": time, "amount": 0.5} for time in times]] * rows)
    table = pa.table(columns)
    pq.write_table(table, folder / "book.parquet")
    if dividends:
        text = json.dumps([{"time": time, "amount": 0.5} for time in times])
        place = table.schema.get_field_index("cash_dividends")
        table = table.set_column(place, "cash_dividends", pa.array([text] * rows))
    pa_csv.write_csv(table, folder / "book.csv")


def _runs(folder: Path, rows: int, threads: int, greeks: str) -> Iterator[BatchRun]:
    alone = 0.0
    for kind in ("price_many", "parquet", "csv"):
        ending = "csv" if kind == "csv" else "parquet"
        arguments = {
            "kind": kind,
            "source": str(folder / f"book.{ending}"),
            "target": str(folder / f"priced.{ending}"),
            "tolerance": TOLERANCE,
            "greeks": greeks,
            "threads": threads,
        }
        command = [sys.executable, "-c", CHILD, json.dumps(arguments)]
        found = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, peak = json.loads(found.stdout)
        alone = alone or seconds
        yield BatchRun(kind, threads, seconds, rows / seconds, seconds / alone, peak)
