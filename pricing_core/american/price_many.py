"""Price a table of options, one status per row."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book import Book, read_book
from pricing_core.american.book_values import CLOSED, LEFT, BookValues, value_book
from pricing_core.american.contract import check_kind, real_number
from pricing_core.american.flat_price import price_left_over
from pricing_core.american.results import DAYS_PER_YEAR, Valuation
from pricing_core.american.scheduled import price_scheduled_many
from pricing_core.american.tolerances import DEFAULT_TOLERANCE, LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from pricing_core.american.valuation import MARCH_METHOD
from pricing_core.errors import InvalidInputError
from pricing_core.version import ENGINE_VERSION

NUMBERS = (
    "price",
    "european_price",
    "early_exercise_premium",
    "intrinsic_value",
    "delta",
    "gamma",
    "theta",
    "theta_per_day",
    "vega",
    "vega_per_point",
    "rho",
    "rho_per_point",
    "dividend_rho",
    "exercise_boundary",
    "error_estimate",
)
TEXTS = ("status", "method", "engine_version", "message")
SENSITIVITIES = "dividend_sensitivities"
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
        the one or the other. Cells are what `contract_from` takes: rate, dividend_yield and volatility may be
        curves, a column of lists holds a list per row; lists and curves may be JSON text. A single list of times
        or of dividends, and a single curve, serve all rows.
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
    table: dict[str, NDArray[Any]] = dict(zip(NUMBERS, np.empty((len(NUMBERS), count)), strict=True))
    table["exercise_now"] = np.zeros(count, dtype=bool)
    table |= {name: np.full(count, "", dtype=object) for name in TEXTS}
    if "cash_dividends" in columns:
        table[SENSITIVITIES] = np.full(count, None, dtype=object)
        table[SENSITIVITIES].fill(())

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
        _price_events(book, table, greeks=greeks, threads=workers)
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


def _price_part(
    book: Book, part: dict[str, NDArray[Any]], *, greeks: bool, threads: int, shared: bool
) -> None:
    """Fill the rows of `part` with the values of `book`."""
    values = value_book(book, greeks=greeks, threads=threads, shared=shared)
    _fill(book, values, part)
    for row in np.flatnonzero((values.path == LEFT) & ~np.isnan(book.spot)).tolist():
        try:
            valuation = price_left_over(
                book.option(row), book.market(row), tolerance=book.tolerance.item(row), greeks=greeks
            )
        except (InvalidInputError, ArithmeticError) as error:
            part["status"][row], part["message"][row] = "out_of_domain", str(error)
        else:
            _fill_row(row, valuation, part)


def _price_events(book: Book, table: dict[str, NDArray[Any]], *, greeks: bool, threads: int) -> None:
    """Fill the rows of contracts with curves, dividends or exercise times."""
    rows = sorted(book.events)
    contracts = [book.events[row] for row in rows]
    tolerances = book.tolerance[rows].tolist()
    for row, valuation in zip(
        rows, price_scheduled_many(contracts, tolerances, greeks=greeks, threads=threads), strict=True
    ):
        _fill_row(row, valuation, table)
        if valuation.price is None:
            table["message"][row] = valuation.diagnostics.solved_by  # the reason, where nothing did
        if SENSITIVITIES in table:
            table[SENSITIVITIES][row] = valuation.dividend_sensitivities or ()


def _fill(book: Book, values: BookValues, part: dict[str, NDArray[Any]]) -> None:
    numbers = {
        "price": values.value,
        "european_price": values.european,
        "early_exercise_premium": values.value - values.european,
        "intrinsic_value": np.maximum(
            np.where(book.is_put, book.strike - book.spot, book.spot - book.strike), 0.0
        ),
        "delta": values.delta,
        "gamma": values.gamma,
        "theta": values.theta,
        "theta_per_day": values.theta / DAYS_PER_YEAR,
        "vega": values.vega,
        "vega_per_point": values.vega / 100.0,
        "rho": values.rho,
        "rho_per_point": values.rho / 100.0,
        "dividend_rho": values.dividend_rho,
        "exercise_boundary": values.boundary,
        "error_estimate": values.error,
    }
    for name, column in numbers.items():
        part[name][:] = column
    part["exercise_now"][:] = values.exercised
    # One string object for a column, not one per row.
    part["status"].fill("ok")
    part["method"].fill(MARCH_METHOD)
    part["engine_version"].fill(ENGINE_VERSION)
    part["method"][values.path == CLOSED] = "closed-form"
    part["status"][values.error > book.tolerance * book.strike] = "tolerance_not_met"
    left = values.path == LEFT  # invalid, or still to be priced
    for name in TEXTS:
        part[name][left] = ""
    part["intrinsic_value"][left] = np.nan


def _fill_row(row: int, valuation: Valuation, part: dict[str, NDArray[Any]]) -> None:
    for name in NUMBERS:
        number = getattr(valuation, name)
        part[name][row] = np.nan if number is None else number
    part["exercise_now"][row] = valuation.exercise_now
    for name in TEXTS[:3]:
        part[name][row] = getattr(valuation, name)
