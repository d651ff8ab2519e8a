"""Units priced by threads of this process: the kernel, NumPy and Arrow release the interpreter."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from threading import BoundedSemaphore
from typing import Protocol

from pricing_core.american.price_book import checked_threads
from pricing_core.batch.unit import Counts, Unit, price_unit
from pricing_core.batch.work_folder import WorkFolder


def threads_or_all(stated: int | None) -> int:
    """Return how many rows are priced at a time: as stated, or as many as the process has processors.

    Raises
    ------
    InvalidInputError
        There are no such threads.
    """
    return len(os.sched_getaffinity(0)) if stated is None else checked_threads(stated)


class Executor(Protocol):
    """Prices units, by threads here or by processes elsewhere."""

    def price(self, units: Iterator[Unit], folder: WorkFolder) -> Iterator[tuple[int, Counts]]:
        """Yield the index of each unit that has its part, in any order, taking few more units than are being priced."""
        ...


class LocalThreads:
    """So many units priced at a time; one more thread waits for the disk."""

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def price(self, units: Iterator[Unit], folder: WorkFolder) -> Iterator[tuple[int, Counts]]:
        """Yield what has been priced. A unit that is being priced is not waited for where the others are given up."""
        price = partial(price_unit, folder=folder, turn=BoundedSemaphore(self._threads))
        pool = ThreadPoolExecutor(self._threads + 1, "pricing")
        running: set[Future[tuple[int, Counts]]] = set()
        try:
            for unit in units:
                running.add(pool.submit(price, unit))
                if len(running) > self._threads + 1:
                    done, running = wait(running, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
