"""The rows of a table that are more, or less, than plain numbers: dividends at once, the others one by one."""

import datetime as dt
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import Option, real_number
from pricing_core.american.contracts.dates import expiry_from_dates
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.contracts.schedule import make_schedule, without_events
from pricing_core.american.contracts.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE, check_moneyness
from pricing_core.american.contracts.vocabulary import DATES, contract_from, is_missing
from pricing_core.american.events.scheduled_book import Contract, ScheduledBook, scheduled_book
from pricing_core.american.tables.columns import plain
from pricing_core.american.tables.dividend_rows import read_dividend_rows
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

DIVIDENDS = "cash_dividends"
OTHER_EVENTS: Mapping[str, object] = {  # and what a row without events holds there, if anything
    "exercise_times": "[]",
    "exercise_start": 0.0,
    "proportional_dividends": "[]",
    "dividend_model": "spot",
}
NUMBERS = ("strike", "expiry", "spot", "rate", "dividend_yield", "volatility")


@dataclass(frozen=True, slots=True, eq=False)
class Events(Mapping[int, Contract]):
    """By row of a table, the contracts that have curves, dividends or exercise times.

    Parameters
    ----------
    places : dict of int to int
        From a row of the table to one of `book`.
    book : ScheduledBook
    """

    places: dict[int, int] = field(default_factory=dict)
    book: ScheduledBook = field(default_factory=lambda: scheduled_book([]))

    def __getitem__(self, row: int) -> Contract:
        return self.book.contract(self.places[row])

    def __iter__(self) -> Iterator[int]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


def read_dates(table: Mapping[str, NDArray[Any]], expiry: Vector) -> None:
    """Write the expiries of the rows that have dates, NaN where there is a fault."""
    known: dict[tuple[object, object], float] = {}  # many rows have the same few dates
    absent = np.broadcast_to(np.array(None), expiry.shape)
    starts, ends = (table.get(name, absent).tolist() for name in DATES)
    for row, dates in enumerate(zip(starts, ends, strict=True)):
        if is_missing(dates[0]) and is_missing(dates[1]):
            continue
        if all(isinstance(date, str | dt.date | np.datetime64) for date in dates) and math.isnan(expiry[row]):
            if dates not in known:
                known[dates] = _years(*dates)
            expiry[row] = known[dates]
        else:
            expiry[row] = math.nan


def read_rows(
    table: Mapping[str, NDArray[Any]], arrays: Mapping[str, NDArray[Any]], sound: BoolVector
) -> tuple[Events, dict[int, InvalidInputError]]:
    """Return the contracts with events, and by row what is wrong with others.

    Into the arrays of the book go the numbers of rows that turn out plain, and NaN in the others.

    Parameters
    ----------
    table, arrays : mapping of str to array, shape (n,)
        The cells as they are given; the columns of the book by name.
    sound : bool array
        Where the arrays hold what is allowed.
    """

    def contract(row: int) -> Contract:
        return checked_contract({name: plain(column[row]) for name, column in table.items()})

    without = sound & np.logical_and.reduce([_is_empty(table, *column) for column in OTHER_EVENTS.items()])
    unpaid = _is_empty(table, DIVIDENDS, "[]")
    cells = table[DIVIDENDS].tolist() if DIVIDENDS in table else []
    paying, book = read_dividend_rows(cells, np.flatnonzero(without & ~unpaid), arrays, contract)
    rest = ~(without & unpaid)
    rest[paying] = False
    events, reasons = _read_singly(np.flatnonzero(rest).tolist(), table, arrays, contract)
    for name in NUMBERS:
        arrays[name][paying] = math.nan
    places = {row: place for place, row in enumerate([*paying.tolist(), *events])}
    return Events(places, book.joined(scheduled_book(list(events.values())))), reasons


def _read_singly(
    rows: list[int],
    table: Mapping[str, NDArray[Any]],
    arrays: Mapping[str, NDArray[Any]],
    contract: Callable[[int], Contract],
) -> tuple[dict[int, Contract], dict[int, InvalidInputError]]:
    """Return by row the contracts with events, and what is wrong with others; write the numbers of the rest."""
    events: dict[int, Contract] = {}
    reasons: dict[int, InvalidInputError] = {}
    for row in rows:
        simple: tuple[Option, FlatMarket] | None = None
        tolerance, cell = math.nan, plain(table["tolerance"][row])
        try:
            held = contract(row)
            tolerance = real_number("tolerance", cell, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
        except InvalidInputError as fault:
            reasons[row] = fault
        else:
            simple = without_events(*held)
            if simple is None:
                events[row] = held
        _write(arrays, row, simple, tolerance)
    return events, reasons


def checked_contract(cells: Mapping[str, Any]) -> Contract:
    """Return a row's contract.

    Raises
    ------
    InvalidInputError
        `price` would refuse it.
    """
    option, market = contract_from({name: cell for name, cell in cells.items() if name != "tolerance"})
    check_moneyness(option, market.spot)
    if market.dividend_model == "escrowed" and option.expiry > 0.0:
        make_schedule(option, market)  # refuses dividends that are worth more than the spot
    return option, market


def _is_empty(table: Mapping[str, NDArray[Any]], name: str, default: object) -> BoolVector:
    """Return which rows hold nothing in a column of events."""
    if name not in table:
        return np.ones(table["spot"].size, dtype=bool)
    return np.array([_is_default(cell, default) for cell in table[name].tolist()], dtype=bool)


def _is_default(cell: object, default: object) -> bool:
    if isinstance(cell, list | tuple | np.ndarray):
        return len(cell) == 0
    if isinstance(cell, bool | np.bool_):
        return False
    return is_missing(cell) or (isinstance(cell, str | int | float) and cell == default)


def _years(start: object, end: object) -> float:
    try:
        return expiry_from_dates(start, end)
    except InvalidInputError:
        return math.nan


def _write(
    arrays: Mapping[str, NDArray[Any]], row: int, simple: tuple[Option, FlatMarket] | None, tolerance: float
) -> None:
    if simple is None:
        numbers = [math.nan] * len(NUMBERS)
    else:
        option, market = simple
        arrays["is_put"][row], arrays["is_american"][row] = option.is_put, option.exercise == "american"
        numbers = [getattr(option if name in NUMBERS[:2] else market, name) for name in NUMBERS]
    for name, number in zip(NUMBERS, numbers, strict=True):
        arrays[name][row] = number
    arrays["tolerance"][row] = tolerance
