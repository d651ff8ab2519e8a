"""Price a table of options, one status per row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.book.reading import read_book
from pricing_core.american.book.table import Table
from pricing_core.american.book.unusual import unusual_columns, warn_of
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.method import Method
from pricing_core.american.price_book import checked_threads, price_book
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.extras import needs_extra

if TYPE_CHECKING:
    from pricing_core.american.arrow.frames import AnyFrame


@overload
def price_many(
    columns: Mapping[str, Any],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    threads: int | None = None,
    share_solves: bool = False,
    deadline: ArrayLike | None = None,
    advice: bool = False,
) -> dict[str, NDArray[Any]]: ...


@overload
def price_many(
    columns: AnyFrame,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    threads: int | None = None,
    share_solves: bool = False,
    deadline: ArrayLike | None = None,
    advice: bool = False,
) -> AnyFrame: ...


def price_many(
    columns: Any,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    threads: int | None = None,
    share_solves: bool = False,
    deadline: ArrayLike | None = None,
    advice: bool = False,
) -> Any:
    """Price one option per row; a bad row gets a status and a message, never an exception.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar, or a frame
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
        Serve rows without events that differ in spot and strike alone from one solve, and without Greeks rows with
        events that differ in the spot alone: chains and ladders are priced faster, to the same tolerance. Others are
        priced as without it.
    deadline : float or array_like, shape (n,), optional
        Seconds that a row may take; one that takes longer has the status "deadline".
    advice : bool
        Whether the table also has "exercise_probability" with its error, "expected_exercise_time",
        "assignment_probability" and "cost_of_waiting" (for a day). It takes 30 ms a row, with events or a local
        volatility some tenths of a second; see `exercise_advice`.

    Returns
    -------
    dict of str to array, shape (n,), or the frame with these columns
        The fields of `Valuation` by name, missing numbers NaN, and "message", the reason where status is
        "invalid_input" or "out_of_domain", or what lies outside the nodes of a local volatility; Greeks as asked for.
        "dividend_sensitivities", where there are
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
    settings = PricingSettings(tolerance, greeks, greek_errors, share_solves, method, deadline, advice)
    checked_threads(threads)
    if hasattr(columns, "__arrow_c_stream__"):
        with needs_extra("batch"):
            from pricing_core.american.arrow.frames import price_frame  # noqa: PLC0415
        return price_frame(columns, settings, threads)
    read = read_book(columns, tolerance)
    warn_of(unusual_contracts(read.book), callers=2)
    return as_arrays(price_book(read, columns, settings, threads))


def price_columns(
    columns: Mapping[str, Any], settings: PricingSettings, threads: int | None
) -> dict[str, NDArray[Any]]:
    """Price a table of arrays as `price_many` does, without a word about its units."""
    return as_arrays(price_book(read_book(columns, settings.tolerance), columns, settings, threads))


def unusual_contracts(book: Book) -> list[str]:
    """Return one sentence for each column that looks as if it were in another unit."""
    now = book.now
    names = ("rate", "dividend_yield", "volatility")
    columns = {name: getattr(now, name) for name in names}
    return unusual_columns(columns | {"expiry": book.expiry, "spot": book.spot, "strike": book.strike})


def as_arrays(table: Table) -> dict[str, NDArray[Any]]:
    """Return the results as arrays by the names of their fields, lists as tuples, the message at the end."""
    lists = {name: _tuples(column) for name, column in table.lists().items()}
    return {name: lists[name] if name in lists else table.columns[name] for name in table.names}


def _tuples(column: Ragged) -> NDArray[np.object_]:
    tuples = np.empty(column.counts().size, dtype=object)
    tuples.fill(())
    for row in np.flatnonzero(column.counts()).tolist():
        tuples[row] = column.row(row)
    return tuples
