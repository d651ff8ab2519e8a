"""The table that `price_many` returns, and what fills its rows."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Rows
from pricing_core.american.book.prices import NUMBERS, Prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError
from pricing_core.kernel import instruction_set
from pricing_core.version import ENGINE_VERSION

# Greeks in another unit: the Greek and what it is divided by.
IN_OTHER_UNITS = {
    "theta_per_day": ("theta", DAYS_PER_YEAR),
    "vega_per_point": ("vega", 100.0),
    "rho_per_point": ("rho", 100.0),
}


# The types of the columns of one value for each row, by kind of field.
_TYPES = {"number": np.float64, "flag": np.bool_, "text": np.object_}
# What they hold where there is no contract, by kind of type.
_NOTHING = {"f": np.nan, "b": False, "O": ""}


class Table:
    """The results of n rows by the names of their fields, which are filled part by part, from any thread.

    Every row is either filled or refused.

    Parameters
    ----------
    count : int
        Number of rows.
    greeks : {"none", "standard", "extended"}
    columns : container of str
        Names of the columns of the table of contracts.
    greek_errors, advice : bool

    Attributes
    ----------
    names : tuple of str
        Names of all columns in their order.
    columns : dict of str to array, shape (n,)
        Numbers, NaN where there is none, flags and texts; the message as well.
    """

    def __init__(
        self, count: int, greeks: Greeks, columns: Container[str], *, greek_errors: bool, advice: bool = False
    ) -> None:
        self.count = count
        fields = price_fields(greeks, columns, greek_errors=greek_errors, advice=advice)
        self.names = (*(field.name for field in fields), "message")
        self.columns: dict[str, NDArray[Any]] = {
            field.name: np.empty(count, _TYPES[field.kind]) for field in fields if field.kind in _TYPES
        }
        self.columns["message"] = np.empty(count, dtype=object)
        self._lists: dict[str, list[tuple[Rows, Ragged]]] = {
            field.name: [] for field in fields if field.name not in self.columns
        }

    def fill(self, rows: Rows | slice, payoff: Vector, prices: Prices) -> None:
        """Write prices to some rows.

        Parameters
        ----------
        payoff : Vector
            What exercise now is worth, money.
        """
        numbers = {
            "price": prices.value,
            "european_price": prices.european,
            "early_exercise_premium": prices.value - prices.european,
            "intrinsic_value": payoff,
            "exercise_boundary": prices.boundary,
            "error_estimate": prices.error,
        }
        numbers |= {name: getattr(prices, name) for name in NUMBERS if name in self.columns}
        for name, (greek, share) in IN_OTHER_UNITS.items():
            if name in self.columns:
                numbers[name] = numbers[greek] / share
        for name, column in numbers.items():
            self._write(name, rows, column)
        self.columns["exercise_now"][rows] = prices.exercised
        for name in ("status", "method", "message"):
            self.columns[name][rows] = getattr(prices, name)
        self.columns["engine_version"][rows] = ENGINE_VERSION
        self.columns["instruction_set"][rows] = instruction_set()
        for name, parts in self._lists.items():
            lists = getattr(prices, name)
            if lists.values.size:
                parts.append((np.arange(self.count)[rows], lists))

    def advise(self, rows: Rows | slice, advice: Mapping[str, Vector]) -> None:
        """Write the columns of the exercise advice into some rows."""
        for name, column in advice.items():
            self._write(name, rows, column)

    def _write(self, name: str, rows: Rows | slice, column: Vector) -> None:
        """Write numbers, none of them -0.0."""
        if isinstance(rows, slice):
            np.add(column, 0.0, out=self.columns[name][rows])
        else:
            self.columns[name][rows] = column + 0.0

    def refuse(self, faults: Mapping[int, InvalidInputError]) -> None:
        """Write into the rows that are not filled why they are not contracts."""
        if not faults:
            return
        rows = np.array([*faults])
        for column in self.columns.values():
            column[rows] = _NOTHING[column.dtype.kind]
        self.columns["status"][rows] = "invalid_input"
        self.columns["message"][rows] = np.array([str(fault) for fault in faults.values()], dtype=object)

    def lists(self) -> dict[str, Ragged]:
        """Return the lists of all rows; empty where a number is missing."""
        found = {}
        for name, parts in self._lists.items():
            found[name] = Ragged.empty(self.count)
            if parts:
                rows = np.concatenate([rows for rows, _ in parts])
                found[name] = found[name].replaced(
                    rows, Ragged.concatenated([part for _, part in parts]).known()
                )
        return found
