"""The rows of a table that are more, or less, than plain numbers, read one by one."""

import datetime as dt
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.columns import plain
from pricing_core.american.contract import Option, real_number
from pricing_core.american.dates import expiry_from_dates
from pricing_core.american.market import FlatMarket, Market
from pricing_core.american.schedule import make_schedule, without_events
from pricing_core.american.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE, check_moneyness
from pricing_core.american.vocabulary import DATES, contract_from, is_missing
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

Events = dict[int, tuple[Option, Market]]
EVENT_COLUMNS: Mapping[str, object] = {  # and what a row without events holds there, if anything
    "exercise_times": "[]",
    "exercise_start": 0.0,
    "cash_dividends": "[]",
    "proportional_dividends": "[]",
    "dividend_model": "spot",
}


class RowsRead(NamedTuple):
    """By row: the contracts with curves, dividends or exercise times, and what is wrong with others."""

    events: Events
    reasons: dict[int, InvalidInputError]


def without_event_cells(table: Mapping[str, NDArray[Any]]) -> BoolVector:
    """Return which rows hold nothing in the columns of events."""
    empty = np.ones(table["spot"].size, dtype=bool)
    for name, default in EVENT_COLUMNS.items():
        if name in table:
            empty &= np.array([_is_default(cell, default) for cell in table[name].tolist()], dtype=bool)
    return empty


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


def read_singly(
    table: Mapping[str, NDArray[Any]], arrays: Mapping[str, NDArray[Any]], rows: list[int]
) -> RowsRead:
    """Read rows, and write into the arrays of the book those that turn out plain; NaN in the others.

    Parameters
    ----------
    table, arrays : mapping of str to array, shape (n,)
        The cells as they are given; the columns of the book by name.
    rows : list of int
    """
    read = RowsRead({}, {})
    for row in rows:
        cells = {name: plain(column[row]) for name, column in table.items()}
        simple: tuple[Option, FlatMarket] | None = None
        tolerance = math.nan
        try:
            contract = checked_contract(cells)
            tolerance = real_number("tolerance", cells["tolerance"], SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
        except InvalidInputError as fault:
            read.reasons[row] = fault
        else:
            simple = without_events(*contract)
            if simple is None:
                read.events[row] = contract
        _write(arrays, row, simple, tolerance)
    return read


def checked_contract(cells: Mapping[str, Any]) -> tuple[Option, Market]:
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
    names = ("strike", "expiry", "spot", "rate", "dividend_yield", "volatility")
    if simple is None:
        numbers = [math.nan] * len(names)
    else:
        option, market = simple
        arrays["is_put"][row], arrays["is_american"][row] = option.is_put, option.exercise == "american"
        numbers = [getattr(option if name in names[:2] else market, name) for name in names]
    for name, number in zip(names, numbers, strict=True):
        arrays[name][row] = number
    arrays["tolerance"][row] = tolerance
