"""The quotes of one underlying at one moment, as columns of numbers."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Vector
from pricing_core.chains.canonical import MESSAGE
from pricing_core.chains.expiry_time import Moment, time_to_expiry, valuation_moment
from pricing_core.errors import InvalidInputError, Told

LARGEST_EXPIRY = 50.0  # years: a longer one is a slip; chosen


@dataclass(frozen=True, slots=True, eq=False)
class Quotes:
    """The rows of a canonical table; every array has shape (n,).

    Parameters
    ----------
    table : pyarrow.Table
        As `read_chain` returns it.
    valuation : date or datetime
        Local time of the market.
    spot : float
        Money.
    exercise : {"american", "european"}
    readable : bool array
        Rows with an expiration, a strike and a side.
    expiry : Vector
        Years; NaN where not readable.
    strike, bid, ask : Vector
        Money per unit of the underlying; NaN where there is none.
    is_call : bool array
    """

    table: pa.Table
    valuation: Moment
    spot: float
    exercise: str
    readable: BoolVector
    expiry: Vector
    strike: Vector
    bid: Vector
    ask: Vector
    is_call: BoolVector

    @property
    def option_type(self) -> NDArray[np.object_]:
        """The side of every row, "call" or "put"."""
        return np.where(self.is_call, "call", "put").astype(object)

    @property
    def intrinsic(self) -> Vector:
        """The payoff of exercise now, money, shape (n,)."""
        return np.maximum(np.where(self.is_call, self.spot - self.strike, self.strike - self.spot), 0.0)

    def column(self, name: str) -> list[Any]:
        """Return a canonical column."""
        cells: list[Any] = self.table[name].to_pylist()
        return cells


def read_quotes(table: pa.Table, valuation_date: object = None) -> Quotes:
    """Return the rows of a canonical table as numbers.

    Parameters
    ----------
    valuation_date : str, date or datetime, optional
        The latest date of the quotes unless given.

    Raises
    ------
    InvalidInputError
        There is no row that can be read, or rows are of several underlyings, currencies or exercise styles.
    """
    for name in ("underlying_symbol", "currency", "exercise"):
        _check_single(table, name)
    exercise = next((word for word in table["exercise"].to_pylist() if word is not None), "american")
    readable = np.array([message is None for message in table[MESSAGE].to_pylist()], dtype=bool)
    strike, bid, ask, price = (_numbers(table, name) for name in ("strike", "bid", "ask", "underlying_price"))
    readable &= (strike > 0.0) & (price > 0.0)
    if not readable.any():
        first = next((text for text in table[MESSAGE].to_pylist() if text), "the table is empty")
        raise InvalidInputError(
            "quotes", Told("no row that can be read"), f"quotes; of the first row: {first}"
        )
    dates = table["quote_date"].to_pylist()
    valuation = _latest(dates, readable) if valuation_date is None else valuation_moment(valuation_date)
    times = {day: time_to_expiry(valuation, day) for day in set(table["expiration"].to_pylist()) - {None}}
    expiry = np.array([times.get(day, np.nan) for day in table["expiration"].to_pylist()], dtype=np.float64)
    readable &= expiry <= LARGEST_EXPIRY
    is_call = np.array([side == "call" for side in table["option_type"].to_pylist()], dtype=bool)
    return Quotes(
        table,
        valuation,
        _spot(price, dates, valuation, readable),
        exercise,
        readable,
        expiry,
        strike,
        bid,
        ask,
        is_call,
    )


def as_date(moment: Moment) -> dt.date:
    """Return the day of a moment."""
    return moment.date() if isinstance(moment, dt.datetime) else moment


def _check_single(table: pa.Table, name: str) -> None:
    counted = Counter(value for value in table[name].to_pylist() if value is not None)
    if len(counted) > 1:
        found = ", ".join(word for word, _ in counted.most_common(3))
        raise InvalidInputError(name, Told(found), "one for all quotes: fit the chains one by one")


def _latest(dates: list[Any], readable: BoolVector) -> Moment:
    known = [date for date, good in zip(dates, readable, strict=True) if good and date is not None]
    return valuation_moment(max(known))


def _spot(price: Vector, dates: list[Any], valuation: Moment, readable: BoolVector) -> float:
    """Return the middle of the underlying's prices on the day of the valuation, or of all where there is none then."""
    today = np.array([date is not None and as_date(date) == as_date(valuation) for date in dates], dtype=bool)
    of_day = price[readable & today]
    return float(np.median(of_day if of_day.size else price[readable]))


def _numbers(table: pa.Table, name: str) -> Vector:
    return np.array(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)
