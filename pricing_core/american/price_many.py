"""Price a table of options, one status per row."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.prices import Prices
from pricing_core.american.book.reading import read_book
from pricing_core.american.book.table import empty_table, fill
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, GREEKS, TOLERANCE, Greeks
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve_in_chunks
from pricing_core.american.method import Method, engines_of
from pricing_core.errors import InvalidInputError

MOST_THREADS = 1024


def price_many(
    columns: Mapping[str, Any],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    greeks: Greeks = "standard",
    greek_errors: bool = False,
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
    method : {"auto", "lcs", "crank-nicolson"}
        As in `price`.
    greeks : {"none", "standard", "extended"}
        As in `price`.
    greek_errors : bool
        Whether the table also has the estimated error of each of these Greeks: "delta_error", "vega_error", ...
    threads : int, optional
        How many to use, >= 1; one by default. The results do not depend on it.
    share_solves : bool
        Serve rows that differ in spot and strike alone from one solve: chains and ladders are priced many times
        faster, to the same tolerance. The method of lines solves every row on its own all the same.

    Returns
    -------
    dict of str to array, shape (n,)
        The fields of `Valuation` by name, missing numbers NaN, and "message", the reason where status is
        "invalid_input" or "out_of_domain"; Greeks as asked for. "dividend_sensitivities", where there are
        cash_dividends, and the buckets of curves hold a tuple per row. Without `share_solves` a row's numbers do not
        depend on the other rows, bit for bit.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ; tolerance, method or threads out of range.

    Examples
    --------
    >>> book = {"option_type": "put", "spot": [90.0, -1.0], "strike": 100.0, "expiry": 1.0}
    >>> table = price_many({**book, "rate": 0.05, "volatility": 0.2}, tolerance=1e-4)
    >>> table["status"].tolist(), table["message"][1]
    (['ok', 'invalid_input'], 'spot = -1.0: must be a number from 0 to 1e+30')
    """
    TOLERANCE.check(tolerance)
    GREEKS.check_choice(greeks)
    check_kind("greek_errors", greek_errors, bool, "True or False")
    check_kind("share_solves", share_solves, bool, "True or False")
    engines, workers = engines_of(method), checked_threads(threads)
    read = read_book(columns, tolerance)
    table = empty_table(read.count, greeks, columns, greek_errors=greek_errors)
    in_order = read.book.is_simple and read.rows.size == read.count
    payoff = read.book.payoff()

    def keep(rows: slice, prices: Prices) -> None:
        places = rows if in_order else read.rows[rows]  # a slice is copied to faster
        fill(table, places, payoff[rows], prices)

    request = Request(read.tolerance, greeks, share_solves)
    solve_in_chunks(read.book, request, keep, engines=engines, workers=workers)
    for row, fault in read.faults.items():
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
