"""A table of contracts, one per row, read into a book; a row that cannot be read does not affect the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.array_column import ArrayColumn
from pricing_core.american.book.book import Book, Listed, Rows
from pricing_core.american.book.column import MISSING, Column
from pricing_core.american.book.columns import broadcast_columns
from pricing_core.american.book.dividend_rows import read_dividend_rows
from pricing_core.american.book.reduction import Reduction
from pricing_core.american.book.segments import Segments
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.dates import DAYS_PER_YEAR, expiry_from_dates
from pricing_core.american.contracts.fields import (
    COLUMN_FIELDS,
    DIVIDEND_YIELD,
    EXERCISE,
    OPTION_TYPE,
    TOLERANCE,
    UNDERLYING,
)
from pricing_core.american.contracts.market import NEGLIGIBLE_RATE, Market
from pricing_core.american.contracts.names import check_complete
from pricing_core.american.contracts.tolerances import LARGEST_RATIO, check_moneyness
from pricing_core.american.contracts.vocabulary import DATES, DEFAULTS, contract_from
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError, UnknownNameError

REQUIRED_COLUMNS = tuple(field.name for field in COLUMN_FIELDS if field.required)
LIMITS = {field.name: field.limits for field in COLUMN_FIELDS if field.kind in ("number", "curve")}
DIVIDENDS = "cash_dividends"
LONGEST_KEPT = 200  # characters of a text that is at fault; chosen: messages show forty
# Places among the choices, by which `Column.words` names them.
PUT = OPTION_TYPE.choices.index("put")
AMERICAN, EUROPEAN = map(EXERCISE.choices.index, ("american", "european"))
SPOT, FUTURE = map(UNDERLYING.choices.index, ("spot", "future"))
# Columns of what a row may state beyond a rate and a yield.
CARRY = ("underlying", "borrow_rate", "foreign_rate", "quanto_covariance", "settlement_lag")
OTHER_EVENTS: Mapping[str, object] = {  # and what a row without events holds there, if anything
    "exercise_times": "[]",
    "exercise_start": 0.0,
    "proportional_dividends": "[]",
    "dividend_model": "spot",
}


@dataclass(frozen=True, slots=True, eq=False)
class ReadBook:
    """What a table of `count` rows holds.

    Parameters
    ----------
    count : int
    book : Book
        n contracts.
    rows : int array, shape (n,)
        Where in the table each of them stands.
    tolerance : Vector, shape (n,)
        Fractions of the strikes.
    faults : dict of int to InvalidInputError
        By row of the table, why its contract is refused.
    """

    count: int
    book: Book
    rows: Rows
    tolerance: Vector
    faults: dict[int, InvalidInputError]


def read_book(
    columns: Mapping[str, Any], tolerance: float, refused: Mapping[int, InvalidInputError] | None = None
) -> ReadBook:
    """Return the contracts of a table of arrays.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
        The names of `contract_from`, and tolerance.
    tolerance : float
        For rows without one of their own.
    refused : mapping of int to InvalidInputError, optional
        Rows that are at fault already, and why.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ.
    """
    check_kind("columns", columns, Mapping, "a mapping of names to columns")
    _check_names(columns)
    arrays = broadcast_columns({**DEFAULTS, "tolerance": tolerance, **columns})
    table = {
        field.name: ArrayColumn(field, arrays[field.name]) for field in COLUMN_FIELDS if field.name in arrays
    }
    return read_columns(table, arrays["spot"].size, refused)


def read_columns(
    table: Mapping[str, Column], count: int, refused: Mapping[int, InvalidInputError] | None = None
) -> ReadBook:
    """Return the contracts of a table of columns.

    Parameters
    ----------
    table : mapping of str to Column
        Every column that is required, exercise, dividend_yield and tolerance among them.
    count : int
        Number of rows.
    refused : mapping of int to InvalidInputError, optional
        Rows that are at fault already, and why.
    """
    numbers = {name: table[name].numbers() for name in LIMITS if name in table}
    expiry = numbers.setdefault("expiry", np.full(count, np.nan))
    if any(name in table for name in DATES):
        read_dates(table, expiry)
    types, exercises = table["option_type"].words(), table["exercise"].words()
    is_put, is_american = types == PUT, exercises == AMERICAN
    sound = (types >= 0) & (is_american | (exercises == EUROPEAN))
    refused = refused or {}
    sound[list(refused)] = False
    stated = _stated(table, numbers, count)
    with np.errstate(all="ignore"):
        for name, column in numbers.items():
            least, most = LIMITS[name]
            sound &= (column >= least) & (column <= most)
        ratio = numbers["spot"] / numbers["strike"]
    # Rows next to the limits, which rounding may place on either side of them, are read one by one.
    sound &= (ratio == 0.0) | ((ratio >= 10.0 / LARGEST_RATIO) & (ratio <= 0.1 * LARGEST_RATIO))
    for name in ("rate", "dividend_yield"):
        numbers[name][np.abs(numbers[name]) < NEGLIGIBLE_RATE] = 0.0
    if stated:
        sound &= _with_carry(numbers, stated)
    arrays = {"is_put": is_put, "is_american": is_american, **numbers, **stated}
    return _joined(table, arrays, sound, refused)


def _stated(table: Mapping[str, Column], numbers: dict[str, Vector], count: int) -> dict[str, NDArray[Any]]:
    """Return what the rows state beyond a rate and a yield, by column; nothing where no row can.

    Empty cells become 0 in `numbers`.
    """
    if not any(name in table for name in CARRY):
        return {}
    nothing = np.zeros(count, dtype=bool)
    empty = {name: table[name].is_empty(None) for name in CARRY if name in numbers}
    for name, cells in empty.items():
        numbers[name][cells] = 0.0
    is_future, is_known = nothing, ~nothing
    if "underlying" in table:
        words = table["underlying"].words()
        is_future, is_known = words == FUTURE, (words == SPOT) | table["underlying"].is_empty(None)
    return {
        "is_future": is_future,
        "is_known": is_known,
        "is_quanto": ~empty["foreign_rate"] if "foreign_rate" in empty else nothing,
        "lag": numbers.get("settlement_lag", 0.0 * nothing) / DAYS_PER_YEAR,
    }


def _with_carry(numbers: dict[str, Vector], stated: Mapping[str, NDArray[Any]]) -> BoolVector:
    """Write the yields of `carry_yield`, and tell which rows may have what they state."""
    rate, dividend_yield, nothing = numbers["rate"], numbers["dividend_yield"], 0.0 * numbers["rate"]
    borrow, foreign, covariance = (
        numbers.get(name, nothing) for name in ("borrow_rate", "foreign_rate", "quanto_covariance")
    )
    is_future, is_quanto = stated["is_future"], stated["is_quanto"]
    none_of_it = (dividend_yield == 0.0) & (borrow == 0.0) & ~is_quanto
    whole = dividend_yield + borrow + covariance
    whole = np.where(is_quanto, whole + rate - foreign, whole)
    numbers["dividend_yield"] = whole = np.where(is_future, rate + covariance, whole)
    least, most = DIVIDEND_YIELD.limits
    allowed = np.where(is_future, none_of_it, stated["is_known"])
    return np.asarray(allowed & (whole >= least) & (whole <= most))


def checked_contract(cells: Mapping[str, Any]) -> tuple[Option, Market]:
    """Return a row's contract.

    Raises
    ------
    InvalidInputError
        `price` would refuse it.
    """
    option, market = contract_from({name: cell for name, cell in cells.items() if name != "tolerance"})
    check_moneyness(option, market.spot)
    if market.dividend_model == "escrowed":
        Book.of([(option, market)])  # refuses dividends that are worth more than the spot
    return option, market


def _joined(
    table: Mapping[str, Column],
    arrays: Mapping[str, NDArray[Any]],
    sound: BoolVector,
    refused: Mapping[int, InvalidInputError],
) -> ReadBook:
    """Return the rows without events, those with plain cash dividends, and the others, read one by one."""
    without = sound.copy()
    for name, default in OTHER_EVENTS.items():
        if name in table:
            without &= table[name].is_empty(default)
    unpaid = table[DIVIDENDS].is_empty("[]") if DIVIDENDS in table else np.ones(sound.size, dtype=bool)
    rest = ~(without & unpaid)
    if not rest.any():
        return ReadBook(sound.size, _without_events(arrays), np.arange(sound.size), arrays["tolerance"], {})
    rows = np.flatnonzero(~rest)
    books, places = [_without_events({name: column[rows] for name, column in arrays.items()})], [rows]
    if DIVIDENDS in table:
        paying = without & ~unpaid
        if "is_future" in arrays:  # which has no dividends
            paying &= ~arrays["is_future"]
        paid = read_dividend_rows(table[DIVIDENDS], np.flatnonzero(paying), arrays)
        if paid is not None:
            places.append(paid[0])
            books.append(paid[1])
            rest[paid[0]] = False
    rest[list(refused)] = False
    contracts, faults = _read_singly(np.flatnonzero(rest).tolist(), table, arrays["tolerance"])
    faults |= refused
    places.append(np.array([*contracts], dtype=np.intp))
    if contracts:
        books.append(Book.of([*contracts.values()]))
    book = Book.concatenated(books)
    together = np.concatenate(places)
    return ReadBook(sound.size, book, together, arrays["tolerance"][together], faults)


def _without_events(arrays: Mapping[str, NDArray[Any]]) -> Book:
    """Return the contracts of rows that are plain numbers."""
    expiry, american = arrays["expiry"], arrays["is_american"]
    nothing = np.zeros(expiry.size)
    segments = Segments(
        nothing,
        expiry,
        arrays["rate"],
        arrays["dividend_yield"],
        arrays["volatility"],
        american,
        american,
        nothing,
        nothing,
    )
    escrowed = np.zeros(expiry.size, dtype=bool)
    first, listed = np.arange(expiry.size + 1), Listed.nothing(expiry.size)
    reduction = Reduction.of_columns(arrays)
    return Book(
        arrays["is_put"], arrays["strike"], arrays["spot"], escrowed, first, segments, listed, reduction
    )


def _read_singly(
    rows: list[int], table: Mapping[str, Column], tolerance: Vector
) -> tuple[dict[int, tuple[Option, Market]], dict[int, InvalidInputError]]:
    """Return the contracts by row, and what is wrong with others; write the rows' tolerances."""
    contracts: dict[int, tuple[Option, Market]] = {}
    faults: dict[int, InvalidInputError] = {}
    for row in rows:
        try:
            contract = checked_contract({name: column.cell(row) for name, column in table.items()})
            tolerance[row] = TOLERANCE.check(table["tolerance"].cell(row))
        except InvalidInputError as fault:
            faults[row] = _kept(fault)
        else:
            contracts[row] = contract
    return contracts, faults


def _kept(fault: InvalidInputError) -> InvalidInputError:
    """Return a fault without what it would keep in memory: the calls that led to it, and the rest of a long text."""
    if isinstance(fault.value, str) and len(fault.value) > LONGEST_KEPT:
        return InvalidInputError(fault.field, fault.value[:LONGEST_KEPT], fault.allowed)
    fault.__context__ = None
    return fault.with_traceback(None)


def _check_names(columns: Mapping[str, Any]) -> None:
    """Accept the names of the columns."""
    known = [field.name for field in COLUMN_FIELDS]
    unknown = [str(name) for name in columns if name not in known]
    if unknown:
        raise UnknownNameError("column", unknown, known)
    check_complete(columns.keys())


def read_dates(table: Mapping[str, Column], expiry: Vector) -> None:
    """Write the expiries of the rows that have dates, NaN where there is a fault."""
    absent = np.full(expiry.size, MISSING)
    codes, moments = [], []
    for name in DATES:
        dates = table[name].dates() if name in table else (absent, ())
        codes.append(dates[0])
        moments.append(dates[1])
    start, end = codes
    dated = (start >= 0) & (end >= 0) & np.isnan(expiry)
    expiry[~dated & ~((start == MISSING) & (end == MISSING))] = np.nan
    # Many rows have the same few pairs of dates.
    pairs, place = np.unique(start[dated] * len(moments[1]) + end[dated], return_inverse=True)
    years = [
        _years(moments[0][pair // len(moments[1])], moments[1][pair % len(moments[1])]) for pair in pairs
    ]
    expiry[dated] = np.array(years)[place]


def _years(start: object, end: object) -> float:
    try:
        return expiry_from_dates(start, end)
    except InvalidInputError:
        return np.nan
