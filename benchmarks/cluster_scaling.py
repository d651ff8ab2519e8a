"""How does a book scale over the worker processes of a cluster on this machine, beside threads of one process?

The scheduler and its workers are there before the clock starts and have priced the book once. The efficiency is the
rate over the number of workers times the rate of one; with more workers than processors it can be no more than
processors / workers.
"""

import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import distributed

from benchmarks.batch_throughput import TOLERANCE, write_books
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table
from pricing_core.batch import run_batch

WORKERS = (1, 2, 4)


class ClusterRun(NamedTuple):
    """One run: local threads, or workers with their efficiency."""

    who: str
    seconds: float
    rows_a_second: float
    efficiency: float | None


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes a small book and one worker."""
    flat = measure(5_000 if quick else 200_000, WORKERS[:1] if quick else WORKERS)
    sections = [_section("Contracts without events", "flat", flat)]
    if not quick:
        paying = measure(50_000, WORKERS, dividends=True)
        sections.append(_section("Contracts with four cash dividends", "dividends", paying))
    return Report("cluster", "Books on a cluster", (__doc__ or "").splitlines()[0], tuple(sections))


def _section(title: str, name: str, runs: Sequence[ClusterRun]) -> Section:
    alone, *workers = runs
    processors = len(os.sched_getaffinity(0))
    best = max(workers, key=lambda one: one.rows_a_second)
    text = f"""Prices alone, tolerance {TOLERANCE:g}, {processors} processors. The most, {best.who}, price
        {best.rows_a_second:,.0f} rows a second, {best.rows_a_second / alone.rows_a_second:.2f} times one thread of
        one process."""
    pairs = [(float(one.who.split()[0]), one.rows_a_second) for one in workers]
    figure = curves(
        {"": {"cluster": pairs, "one thread": [(1.0, alone.rows_a_second)]}}, "workers", "rows a second"
    )
    return Section(title, text, (table(name, runs),), {name: figure})


def measure(rows: int, workers: Sequence[int] = WORKERS, *, dividends: bool = False) -> list[ClusterRun]:
    """Price a book on one thread, and on so many workers."""
    with tempfile.TemporaryDirectory(prefix="cluster-") as name:
        folder = Path(name)
        write_books(folder, rows, dividends=dividends)
        alone = _seconds(folder, engine="local", threads=1)
        found = [ClusterRun("one thread", alone, rows / alone, None)]
        first = 0.0
        for count in workers:
            seconds = _on_cluster(folder, count)
            first = first or count * seconds
            who = f"{count} worker{'s' * (count > 1)}"
            found.append(ClusterRun(who, seconds, rows / seconds, first / (count * seconds)))
    return found


def _on_cluster(folder: Path, workers: int) -> float:
    """Return the seconds of a run on so many worker processes."""
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        for _ in range(2):  # in the first the workers import what they need
            seconds = _seconds(folder, engine="dask", scheduler=cluster.scheduler_address)
    return seconds


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
