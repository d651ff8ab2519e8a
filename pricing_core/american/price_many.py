"""Price a table of options, one status per row."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import check_kind, real_number
from pricing_core.american.contracts.tolerances import (
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
)
from pricing_core.american.events.scheduled import price_scheduled_many
from pricing_core.american.flat_price import price_left_over
from pricing_core.american.price_table import SENSITIVITIES, Table, empty_table, fill_row, fill_rows
from pricing_core.american.priced_rows import PricedRows
from pricing_core.american.solver_settings import SolverSettings
from pricing_core.american.tables.book import Book, read_book
from pricing_core.american.tables.book_values import CLOSED, LEFT, BookValues, value_book
from pricing_core.american.valuation import MARCH_METHOD
from pricing_core.errors import InvalidInputError

MOST_THREADS = 1024
CHUNK = 16384  # rows valued at a time: their arrays stay in the cache
SMALLEST_CHUNK = 256  # fewer rows are not worth a thread


def price_many(
    columns: Mapping[str, Any],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: bool = True,
    threads: int | None = None,
    share_solves: bool = False,
) -> dict[str, NDArray[Any]]:
    """Price one option per row; a bad row gets a status and a message, never an exception.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
        option_type, spot, strike, expiry, rate, volatility, and optionally exercise, dividend_yield, tolerance, and
        those of contracts with events: exercise_times, exercise_start, cash_dividends, proportional_dividends,
        dividend_model; valuation_date and expiration_date in the place of expiry, or beside it where each row has
        the one or the other. Cells are what `contract_from` takes: with dates, exercise times may be dates; rate,
        dividend_yield and volatility may be curves, a column of lists holds a list per row; lists and
        curves may be JSON text. A single list of times or of dividends, and a single curve, serve all rows.
    tolerance : float
        For rows without a tolerance of their own.
    greeks : bool
        False leaves out vega, rho and dividend rho.
    threads : int, optional
        How many to use, >= 1; one by default. The results do not depend on it.
    share_solves : bool
        Serve rows that differ in spot and strike alone from one solve: chains and ladders are priced many times
        faster, to the same tolerance.

    Returns
    -------
    dict of str to array, shape (n,)
        The fields of `Valuation` by name, missing numbers NaN, and "message", the reason where status is
        "invalid_input"; where there are cash_dividends, also "dividend_sensitivities", a tuple per row, empty where
        none falls due by expiry. Without `share_solves` a row's numbers do not depend on the other rows, bit for bit.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ; tolerance or threads out of range.

    Examples
    --------
    >>> book = {"option_type": "put", "spot": [90.0, -1.0], "strike": 100.0, "expiry": 1.0}
    >>> table = price_many({**book, "rate": 0.05, "volatility": 0.2}, tolerance=1e-4)
    >>> table["status"].tolist(), table["message"][1]
    (['ok', 'invalid_input'], 'spot = -1.0: must be a number from 0 to 1e+30')
    """
    real_number("tolerance", tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
    check_kind("greeks", greeks, bool, "True or False")
    check_kind("share_solves", share_solves, bool, "True or False")
    workers = checked_threads(threads)
    book, reasons = read_book(columns, tolerance)
    count = book.spot.size
    table = empty_table(count)

    def fill(rows: slice) -> None:
        part = {name: column[rows] for name, column in table.items()}
        inner = workers if share_solves else 1  # rows that share a solve stay together
        _price_part(book.slice(rows), part, greeks=greeks, threads=inner, shared=share_solves)

    size = CHUNK * workers if share_solves else min(CHUNK, max(SMALLEST_CHUNK, -(-count // workers)))
    chunks = [slice(start, start + size) for start in range(0, count, size)]
    if workers == 1 or len(chunks) == 1:
        for rows in chunks:
            fill(rows)
    else:  # the kernel and NumPy release the interpreter
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(fill, chunks))
    if book.events:
        places = np.array(list(book.events))
        tolerances = book.tolerance[places]
        events = price_scheduled_many(book.events.book, tolerances, greeks=greeks, threads=workers)
        for name, column in events.items():
            table[name][places] = column
    if "cash_dividends" not in columns:
        del table[SENSITIVITIES]
    for row, fault in reasons.items():
        table["status"][row], table["message"][row] = "invalid_input", str(fault)
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


def _price_part(book: Book, part: Table, *, greeks: bool, threads: int, shared: bool) -> None:
    """Fill the rows of `part` with the values of `book`."""
    values = value_book(book, greeks=greeks, threads=threads, shared=shared)
    _fill(book, values, part)
    for row in np.flatnonzero((values.path == LEFT) & ~np.isnan(book.spot)).tolist():
        try:
            settings = SolverSettings(book.tolerance.item(row), greeks=greeks)
            valuation = price_left_over(book.option(row), book.market(row), settings)
        except (InvalidInputError, ArithmeticError) as error:
            part["status"][row], part["message"][row] = "out_of_domain", str(error)
        else:
            fill_row(part, row, valuation)


def _fill(book: Book, values: BookValues, part: Table) -> None:
    rows: NDArray[np.intp] | slice = slice(None)
    priced: PricedRows = values
    if np.any(values.path == LEFT):
        rows = np.flatnonzero(values.path != LEFT)
        book, priced = book.take(rows), values.priced(rows)
    payoff = np.maximum(np.where(book.is_put, book.strike - book.spot, book.spot - book.strike), 0.0)
    tolerance = book.tolerance * book.strike
    fill_rows(part, rows, priced, payoff=payoff, tolerance=tolerance, method=MARCH_METHOD)
    part["method"][values.path == CLOSED] = "closed-form"
