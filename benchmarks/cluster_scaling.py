"""How does a book scale over the worker processes of a cluster on this machine, beside threads of one process?

Run as `python -m benchmarks.cluster_scaling [ROWS] [--dividends]`. The scheduler and its workers are there before
the clock starts and have priced the book once. The efficiency is the rate over the number of workers times the rate of
one; with more workers than processors it can be no more than processors / workers.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import distributed

from benchmarks.batch_throughput import TOLERANCE, write_books
from pricing_core.batch import run_batch

WORKERS = (1, 2, 4)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=int, nargs="?", default=200_000)
    parser.add_argument("--dividends", action="store_true", help="four cash dividends a contract")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="cluster-") as name:
        folder = Path(name)
        write_books(folder, options.rows, dividends=options.dividends)
        processors = len(os.sched_getaffinity(0))
        print(f"{options.rows:,} contracts, prices alone, tolerance {TOLERANCE:g}, {processors} processors")
        print(f"{'':14}{'seconds':>9}{'rows/s':>10}{'efficiency':>12}")
        alone = options.rows / _seconds(folder, engine="local", threads=1)
        print(f"{'one thread':14}{options.rows / alone:9.2f}{alone:10,.0f}")
        first = 0.0
        for workers in WORKERS:
            rate = options.rows / _on_cluster(folder, workers)
            first = first or rate
            efficiency = rate / (workers * first)
            print(
                f"{workers:6} worker{'s' * (workers > 1):7}{options.rows / rate:9.2f}{rate:10,.0f}{efficiency:12.2f}"
            )


def _on_cluster(folder: Path, workers: int) -> float:
    """Return the seconds of a run on so many worker processes."""
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        _seconds(
            folder, engine="dask", scheduler=cluster.scheduler_address
        )  # the workers import what they need
        return _seconds(folder, engine="dask", scheduler=cluster.scheduler_address)


def _seconds(folder: Path, *, engine: str, scheduler: str | None = None, threads: int | None = None) -> float:
    start = time.perf_counter()
    run_batch(
        folder / "book.parquet",
        folder / "priced.parquet",
        tolerance=TOLERANCE,
        greeks="none",
        engine=engine,
        scheduler=scheduler,
        threads=threads,
    )
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
