"""The contracts that were read of a table, priced into the table of their results."""

from __future__ import annotations

from collections.abc import Callable, Container

import numpy as np

from pricing_core.american.book.prices import Prices
from pricing_core.american.book.reading import ReadBook
from pricing_core.american.book.table import Table
from pricing_core.american.engines.chunks import solve_in_chunks
from pricing_core.american.engines.engine import Request
from pricing_core.american.method import engines_of
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError

MOST_THREADS = 1024


def price_book(
    read: ReadBook,
    columns: Container[str],
    settings: PricingSettings,
    threads: int | None,
    interrupt: Callable[[], bool] | None = None,
) -> Table:
    """Price every contract.

    Parameters
    ----------
    columns : container of str
        Names of the columns that the contracts were read from: a table without curves has no buckets.
    threads : int, optional
        How many to use, >= 1; one by default.
    interrupt : callable, optional
        Asked between steps of the work; True ends it, and what is not ready then has the status "deadline".

    Raises
    ------
    InvalidInputError
        There are no such threads.
    """
    workers = checked_threads(threads)
    table = Table(
        read.count,
        settings.greeks,
        columns,
        greek_errors=settings.greek_errors,
        advice=settings.advice,
    )
    in_order = read.rows.size == read.count and bool((read.rows[1:] > read.rows[:-1]).all())
    payoff = read.book.exercise_value()

    def keep(rows: slice, prices: Prices) -> None:
        places = rows if in_order else read.rows[rows]  # a slice is copied to faster
        table.fill(places, payoff[rows], prices)
        if settings.advice:
            from pricing_core.american.advice.advice_columns import advice_columns  # noqa: PLC0415

            advice = advice_columns(read.book.part(rows), prices, request.take(rows))
            table.advise(places, {name: getattr(advice, name) for name in advice.__slots__})

    deadline = settings.deadlines(read.count)
    request = Request(
        read.tolerance,
        settings.greeks,
        settings.share_solves,
        interrupt=interrupt,
        deadline=None if deadline is None else deadline[read.rows],
    )
    solve_in_chunks(read.book, request, keep, engines=engines_of(settings.method), workers=workers)
    table.refuse(read.faults)
    return table


def checked_threads(threads: object) -> int:
    """Return how many threads are meant; None means one."""
    if threads is None:
        return 1
    if (
        isinstance(threads, int | np.integer)
        and not isinstance(threads, bool)
        and 1 <= threads <= MOST_THREADS
    ):
        return int(threads)
    raise InvalidInputError("threads", threads, f"an integer from 1 to {MOST_THREADS}")
