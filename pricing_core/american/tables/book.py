"""A table of contracts as arrays, one option per row, each row checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import (
    LARGEST_EXPIRY,
    LARGEST_MONEY,
    SMALLEST_MONEY,
    Option,
    check_kind,
)
from pricing_core.american.contracts.market import (
    LARGEST_RATE,
    LARGEST_VOLATILITY,
    NEGLIGIBLE_RATE,
    SMALLEST_RATE,
    FlatMarket,
)
from pricing_core.american.contracts.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from pricing_core.american.contracts.vocabulary import DATES, NAMES
from pricing_core.american.tables.book_rows import Events, read_dates, read_rows
from pricing_core.american.tables.columns import as_numbers, broadcast_columns, equals
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

REQUIRED_COLUMNS = ("option_type", "spot", "strike", "expiry", "rate", "volatility")
DEFAULTS: Mapping[str, object] = {"exercise": "american", "dividend_yield": 0.0}
LIMITS = {
    "spot": (0.0, LARGEST_MONEY),
    "strike": (SMALLEST_MONEY, LARGEST_MONEY),
    "expiry": (0.0, LARGEST_EXPIRY),
    "rate": (SMALLEST_RATE, LARGEST_RATE),
    "dividend_yield": (SMALLEST_RATE, LARGEST_RATE),
    "volatility": (0.0, LARGEST_VOLATILITY),
    "tolerance": (SMALLEST_TOLERANCE, LARGEST_TOLERANCE),
}


@dataclass(frozen=True, slots=True, eq=False)
class Book:
    """Options and the markets they are valued in; every array has shape (n,). Units as in `Option` and `FlatMarket`.

    Parameters
    ----------
    is_put, is_american : bool array
    spot, strike, expiry, rate, dividend_yield, volatility : Vector
    tolerance : Vector
        Fractions of the strike.
    events : Events
        The contracts with curves, dividends or exercise times; the numbers of their rows here are NaN.
    """

    is_put: BoolVector
    is_american: BoolVector
    spot: Vector
    strike: Vector
    expiry: Vector
    rate: Vector
    dividend_yield: Vector
    volatility: Vector
    tolerance: Vector
    events: Events = field(default_factory=Events)

    def take(self, rows: NDArray[np.intp]) -> "Book":
        """Return some of the rows, without events."""
        return self._part(rows)

    def slice(self, rows: slice) -> "Book":
        """Return consecutive rows, without events and without copying them."""
        return self._part(rows)

    def _part(self, rows: Any) -> "Book":
        return Book(*(getattr(self, name)[rows] for name in self.__slots__ if name != "events"))

    def option(self, row: int) -> Option:
        """Return the contract of one row."""
        return Option(
            "put" if self.is_put[row] else "call",
            self.strike.item(row),
            self.expiry.item(row),
            "american" if self.is_american[row] else "european",
        )

    def market(self, row: int) -> FlatMarket:
        """Return the market of one row."""
        numbers = (self.spot, self.rate, self.volatility, self.dividend_yield)
        return FlatMarket(*(column.item(row) for column in numbers))


def single_row(option: Option, market: FlatMarket, tolerance: float) -> Book:
    """Return the book of one contract."""
    numbers = (
        market.spot,
        option.strike,
        option.expiry,
        market.rate,
        market.dividend_yield,
        market.volatility,
        tolerance,
    )
    return Book(
        np.array([option.is_put]),
        np.array([option.exercise == "american"]),
        *np.array(numbers).reshape(-1, 1),
    )


def read_book(columns: Mapping[str, Any], tolerance: float) -> tuple[Book, dict[int, InvalidInputError]]:
    """Return the book, and by row the reason why its contract is refused; such a row holds NaN.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
        Those of `contract_from`, and tolerance.
    tolerance : float
        For rows without one of their own.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ.
    """
    check_kind("columns", columns, Mapping, "a mapping of names to columns")
    _check_names(columns)
    table = broadcast_columns({**DEFAULTS, "tolerance": tolerance, **columns})
    numbers = {name: as_numbers(table[name]) for name in LIMITS if name in table}
    expiry = numbers.setdefault("expiry", np.full(table["spot"].size, np.nan))
    if any(name in table for name in DATES):
        read_dates(table, expiry)
    types, exercises = table["option_type"], table["exercise"]
    is_put, is_american = equals(types, "put"), equals(exercises, "american")
    sound = (is_put | equals(types, "call")) & (is_american | equals(exercises, "european"))
    with np.errstate(all="ignore"):
        for name, (least, most) in LIMITS.items():
            sound &= (numbers[name] >= least) & (numbers[name] <= most)
        ratio = numbers["spot"] / numbers["strike"]
    sound &= (ratio == 0.0) | ((ratio >= 1e-29) & (ratio <= 1e29))
    for name in ("rate", "dividend_yield"):
        numbers[name][np.abs(numbers[name]) < NEGLIGIBLE_RATE] = 0.0
    arrays: dict[str, Any] = {"is_put": is_put, "is_american": is_american, **numbers}
    events, reasons = read_rows(table, arrays, sound)
    return Book(**arrays, events=events), reasons


def _check_names(columns: Mapping[str, Any]) -> None:
    """Accept the names of the columns."""
    dated = all(name in columns for name in DATES)
    for name in REQUIRED_COLUMNS:
        if name not in columns and not (name == "expiry" and dated):
            raise InvalidInputError(name, "missing", "given as a column or a scalar")
    allowed = (*NAMES, "tolerance")
    for name in columns:
        if name not in allowed:
            raise InvalidInputError("columns", name, "named " + ", ".join(allowed))
