"""What does a book cost as a file: rows a second and peak memory by file kind and threads, beside `price_many`?

Run as `python -m benchmarks.batch_throughput [ROWS] [--dividends]`. Every run is a process of its own, so that its peak
memory is its own; `price_many` is given the same contracts as arrays in a process as well.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.problems.portfolios import everyday

TOLERANCE = 1e-5
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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=int, nargs="?", default=200_000)
    parser.add_argument(
        "--dividends", action="store_true", help="four cash dividends a contract, prices alone"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="batch-") as name:
        folder = Path(name)
        write_books(folder, options.rows, dividends=options.dividends)
        print(f"{options.rows:,} contracts, tolerance {TOLERANCE:g}")
        print(f"{'':12}{'threads':>8}{'seconds':>9}{'rows/s':>10}{'price_many x':>14}{'peak MB':>9}")
        for threads in (1, 2):
            _measure(folder, options.rows, threads, "none" if options.dividends else "standard")


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


def _measure(folder: Path, rows: int, threads: int, greeks: str) -> None:
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
        print(
            f"{kind:12}{threads:8}{seconds:9.2f}{rows / seconds:10,.0f}{seconds / alone:14.2f}{peak:9.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
