"""A column of a table as a NumPy array."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Rows
from pricing_core.american.book.column import MISSING, NO_DATE, Dates, PlainDividends
from pricing_core.american.book.columns import as_numbers, plain
from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import CASH_DIVIDENDS
from pricing_core.american.contracts.json_text import DECODER
from pricing_core.american.contracts.vocabulary import is_missing
from pricing_core.arrays import BoolVector, Vector


@dataclass(frozen=True, slots=True, eq=False)
class ArrayColumn:
    """A `Column` of numbers, texts or objects.

    Parameters
    ----------
    field : Field
    array : ndarray, shape (n,)
    """

    field: Field
    array: NDArray[Any]

    def numbers(self) -> Vector:
        """Return a copy as floats, NaN for what is no number."""
        return as_numbers(self.array)

    def words(self) -> NDArray[np.int8]:
        """Return the places of what the cells mean among the choices of the field; -1 for none of them."""
        if self.array.size > 1 and self.array.strides == (0,):  # one cell for all rows
            return np.repeat(ArrayColumn(self.field, self.array[:1]).words(), self.array.size)
        places = np.full(self.array.size, -1, dtype=np.int8)
        for place, choice in enumerate(self.field.choices):
            places[self._equals(choice)] = place
        others = np.flatnonzero(places < 0)
        if others.size:
            known = dict(zip(self.field.choices, range(len(self.field.choices)), strict=True))
            cells = self.array[others].tolist()
            meant = {
                cell: known.get(self.field.word(cell) or "", -1) for cell in cells if isinstance(cell, str)
            }
            places[others] = [meant[cell] if isinstance(cell, str) else -1 for cell in cells]
        return places

    def is_empty(self, default: object) -> BoolVector:
        """Tell which cells hold nothing, or nothing else than the default."""
        return np.array([_is_default(cell, default) for cell in self.array.tolist()], dtype=bool)

    def dates(self) -> Dates:
        """Return the cells as dates."""
        known: dict[object, int] = {}
        return Dates(np.array([_code(cell, known) for cell in self.array.tolist()], dtype=np.int64), [*known])

    def plain_dividends(self, rows: Rows) -> PlainDividends:
        """Return the cash dividends of some rows."""
        return plain_dividends([self.array[row] for row in rows.tolist()])

    def cell(self, row: int) -> object:
        """Return one cell, NumPy's numbers and texts as Python's."""
        return plain(self.array[row])

    def _equals(self, word: str) -> BoolVector:
        """Tell which cells are the word."""
        try:
            return np.asarray(self.array == word, dtype=bool)
        except Exception:  # a stranger's cell does not know what it equals, an array equals many things
            return np.array([isinstance(cell, str) and cell == word for cell in self.array.tolist()])


def plain_dividends(cells: Sequence[object]) -> PlainDividends:
    """Return the cash dividends of cells that are lists of mappings or of pairs, or their JSON text."""
    found = [_times_and_amounts(cell) for cell in cells]
    time, amount = np.fromiter(chain.from_iterable(found), np.float64).reshape(-1, 2).T
    return PlainDividends(np.array([len(numbers) // 2 for numbers in found], dtype=np.int64), time, amount)


def _code(cell: object, known: dict[object, int]) -> int:
    if is_missing(cell):
        return MISSING
    return known.setdefault(cell, len(known)) if isinstance(cell, str | dt.date | np.datetime64) else NO_DATE


def _is_default(cell: object, default: object) -> bool:
    if isinstance(cell, list | tuple | np.ndarray):
        return len(cell) == 0
    if isinstance(cell, bool | np.bool_):
        return False
    return is_missing(cell) or (isinstance(cell, str | int | float) and cell == default)


def _times_and_amounts(cell: object) -> list[float]:
    """Return time, amount, time, amount, ...; nothing where the cell is not as plain as that."""
    try:
        entries = DECODER.decode(cell) if type(cell) is str else cell
        if type(entries) is not list or len(entries) > CASH_DIVIDENDS.most_entries:
            return []
        if set(map(len, entries)) != {2}:
            return []
        kinds = set(map(type, entries))
        if kinds == {dict}:
            numbers = [number for entry in entries for number in (entry["time"], entry["amount"])]
        elif kinds <= {list, tuple}:
            numbers = [*chain.from_iterable(entries)]
        else:
            return []
        return [float(number) for number in numbers] if set(map(type, numbers)) <= {float, int} else []
    except (TypeError, ValueError, RecursionError, KeyError, OverflowError):
        return []
