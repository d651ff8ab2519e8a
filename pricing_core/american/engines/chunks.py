"""A book priced some rows at a time, in threads, and within the deadline of each row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from time import monotonic
from typing import TypeVar

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import Engine, Request
from pricing_core.american.engines.solve import ENGINES, solve

# Number of segments priced at a time: the memory of so few is used again and need not be asked for anew; measured.
LARGEST_CHUNK = 8192
SMALLEST_CHUNK = 256  # Number of segments: fewer are not worth a thread; measured.

T = TypeVar("T")
R = TypeVar("R")


def solve_in_chunks(
    book: Book,
    request: Request,
    take: Callable[[slice, Prices], None],
    *,
    engines: Sequence[Engine] = ENGINES,
    workers: int = 1,
) -> None:
    """Price a book some rows at a time, and hand the prices on as they come, from any of the threads.

    Parameters
    ----------
    take : callable
        Is given the rows and their prices.
    workers : int
        Number of threads; the prices do not depend on it.
    """
    whole = slice(0, book.count)
    if request.share_solves:  # contracts that share a solve stay together
        take(whole, solve_in_time(book, replace(request, threads=workers), engines))
        return

    def price(rows: slice) -> None:
        some = (book, request) if rows == whole else (book.part(rows), request.take(rows))
        take(rows, solve_in_time(*some, engines))

    mapped(price, _chunks(book, workers), workers)


def solve_in_time(book: Book, request: Request, engines: Sequence[Engine]) -> Prices:
    """Price a book no contract of which may take longer than its deadline, if there are such.

    The contracts are priced together. Those that are not ready when the shortest deadline has passed are priced
    again in two halves, and so on: a contract that is alone has all of its own deadline.
    """
    if request.deadline is None or book.count == 0:
        return solve(book, request, engines=engines)
    end = monotonic() + float(request.deadline.min())
    found = solve(book, replace(request, interrupt=lambda: monotonic() > end), engines=engines)
    late = np.flatnonzero((found.status == "deadline") | ~found.complete)
    if late.size == 0 or book.count == 1 or monotonic() <= end:
        return found
    for rows in np.array_split(late, 2):
        if rows.size:
            found = found.replaced(rows, solve_in_time(book.take(rows), request.take(rows), engines))
    return found


def mapped(do: Callable[[T], R], tasks: Sequence[T], workers: int) -> list[R]:
    """Return the results of the tasks in their order; at most `threads` of them run at a time."""
    if workers == 1 or len(tasks) < 2:
        return [do(task) for task in tasks]
    with ThreadPoolExecutor(workers) as pool:  # the kernel and NumPy release the interpreter
        return list(pool.map(do, tasks))


def _chunks(book: Book, workers: int) -> list[slice]:
    """Cut the book into consecutive rows with about as many segments each."""
    segments = int(book.first[-1])
    size = min(LARGEST_CHUNK, max(SMALLEST_CHUNK, -(-segments // workers)))
    if 0 < segments <= size:
        return [slice(0, book.count)]
    cuts = np.unique(np.searchsorted(book.first, np.arange(0, segments + size, size)))
    cuts = np.minimum(cuts, book.count)
    return [slice(int(a), int(b)) for a, b in pairwise(cuts) if a < b]
