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


class Table:
    """The results of n rows by the names of their fields, which are filled part by part, from any thread.

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
        self.columns: dict[str, NDArray[Any]] = {}
        self._lists: dict[str, list[tuple[Rows, Ragged]]] = {}
        fields = price_fields(greeks, columns, greek_errors=greek_errors, advice=advice)
        self.names = (*(field.name for field in fields), "message")
        for field in fields:
            if field.kind == "number":
                self.columns[field.name] = np.full(count, np.nan)
            elif field.kind == "flag":
                self.columns[field.name] = np.zeros(count, dtype=bool)
            elif field.kind == "text":
                self.columns[field.name] = _texts(count)
            else:
                self._lists[field.name] = []
        self.columns["message"] = _texts(count)

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
            self.columns[name][rows] = column + 0.0  # no -0.0
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
            self.columns[name][rows] = column + 0.0

    def refuse(self, faults: Mapping[int, InvalidInputError]) -> None:
        """Write into some rows why they are not contracts."""
        for row, fault in faults.items():
            self.columns["status"][row], self.columns["message"][row] = "invalid_input", str(fault)

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


def _texts(count: int) -> NDArray[np.object_]:
    """Return so many empty texts; `np.full` takes five times as long for objects."""
    texts = np.empty(count, dtype=object)
    texts[:] = ""
    return texts
