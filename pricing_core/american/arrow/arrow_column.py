"""A column of a table as an Arrow array: no Python object per row, unless a cell must be read by itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pricing_core.american.arrow.cells import is_empty, python_value
from pricing_core.american.book.array_column import plain_dividends
from pricing_core.american.book.book import Rows
from pricing_core.american.book.column import MISSING, NO_DATE, Dates, PlainDividends
from pricing_core.american.contracts.dates import is_meant_as_date
from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import CASH_DIVIDENDS
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import read_number

BLANKS = " \t"
FEW_CELLS = 64  # of a dictionary, that are read whether or not a row holds them; chosen


@dataclass(frozen=True, slots=True, eq=False)
class ArrowColumn:
    """A `Column` of any type that its field allows, and of text as CSV files hold it.

    An empty cell, one that is null, NaN, blank or an empty list, takes the default.

    Parameters
    ----------
    field : Field
    array : pyarrow.Array, shape (n,)
    default : object
        None where nothing takes the place of an empty cell.
    optional : bool
        Whether a cell without default may be empty.
    """

    field: Field
    array: pa.Array
    default: Any = None
    optional: bool = True

    def __post_init__(self) -> None:
        found = self.array.type
        if pa.types.is_timestamp(found):  # Python's date-times know no nanoseconds
            unit = "us" if found.unit == "ns" else found.unit
            in_python = self.array.cast(pa.timestamp(unit, found.tz and "UTC"), safe=False)
            object.__setattr__(self, "array", in_python)

    def numbers(self) -> Vector:
        """Return a copy as floats, NaN for what is no number."""
        if is_text(self.array.type):
            numbers = self._numbers_of_text()
        elif is_number(self.array.type):
            floats = pc.cast(self.array, pa.float64(), safe=False)
            numbers = np.array(floats.to_numpy(zero_copy_only=False))
        else:
            numbers = np.full(len(self.array), np.nan)
        if isinstance(self.default, float | int):
            numbers[self.is_empty(None)] = self.default
        return numbers

    def words(self) -> NDArray[np.int8]:
        """Return the places of what the cells mean among the choices of the field; -1 for none of them."""
        codes, cells = self._distinct()
        known = {choice: place for place, choice in enumerate(self.field.choices)}
        places = [*(known.get(self._word(cell), -1) for cell in cells), known.get(self.default, -1)]
        return np.array(places, dtype=np.int8)[codes]

    def is_word(self, word: str) -> BoolVector:
        """Tell which cells mean the word."""
        return np.asarray(self.words() == self.field.choices.index(word))

    def is_empty(self, default: object) -> BoolVector:
        """Tell which cells hold nothing, or nothing else than the default."""
        if is_list(self.array.type):
            lengths = pc.fill_null(pc.list_value_length(self.array), 0)
            return np.asarray(lengths.to_numpy(zero_copy_only=False) == 0)
        if is_number(self.array.type):
            numbers = pc.cast(self.array, pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            return np.asarray(np.isnan(numbers) | (numbers == default))
        if is_text(self.array.type):
            text = pc.fill_null(self._text(), "")
            given = pc.not_equal(text, "")
            if isinstance(default, str):
                given = pc.and_(given, pc.not_equal(text, default))
            return ~np.asarray(given.to_numpy(zero_copy_only=False))
        codes, cells = self._distinct()
        return np.array([*(is_empty(cell) or cell == default for cell in cells), True])[codes]

    def dates(self) -> Dates:
        """Return the cells as dates."""
        if is_number(self.array.type):
            return Dates(np.where(self.is_empty(None), MISSING, NO_DATE), ())
        codes, cells = self._distinct()
        known = [
            MISSING if is_empty(cell) else NO_DATE if isinstance(cell, int) else k
            for k, cell in enumerate(cells)
        ]
        return Dates(np.array([*known, MISSING])[codes], cells)

    def plain_dividends(self, rows: Rows) -> PlainDividends:
        """Return the cash dividends of some rows."""
        chosen = self.array.take(pa.array(rows))
        return _dividends(chosen) if is_list(self.array.type) else plain_dividends(chosen.to_pylist())

    def cell(self, row: int) -> object:
        """Return one cell as `contract_from` takes it; None where it is empty, and may be.

        Raises
        ------
        InvalidInputError
            It is empty, or no number where it must be one.
        """
        cell = python_value(self.array[row])
        if is_empty(cell):
            if self.default is None and not self.optional:
                raise InvalidInputError(self.field.name, "", f"given ({self.field.in_brief})")
            return self.default
        text = _stripped(cell)
        if self.field.kind == "choice":
            return self._word(text)
        is_curve = self.field.kind == "curve" and (
            text.startswith("{") if isinstance(text, str) else isinstance(text, Mapping)
        )
        is_date = self.field.kind == "time" and is_meant_as_date(text)
        if self.field.kind in ("list", "date") or is_curve or is_date:
            return text
        return read_number(self.field.name, cell)

    def _numbers_of_text(self) -> Vector:
        """Return the numbers that cells are the text of, by Arrow's reading where it understands every cell."""
        text = self._text()
        text = pc.if_else(pc.or_(pc.equal(text, ""), pc.starts_with(text, "{")), None, text)
        try:
            numbers = np.array(pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False))
        except pa.ArrowInvalid:
            numbers = np.array([_number_or_nan(cell) for cell in text.to_pylist()])
        numbers[np.isinf(numbers)] = np.nan
        return numbers

    def _text(self) -> pa.Array:
        """Return texts without the blanks around them."""
        return pc.utf8_trim(pc.cast(self.array, pa.large_string()), BLANKS)

    def _distinct(self) -> tuple[NDArray[np.int64], list[Any]]:
        """Return the different cells, and which of them each row holds; -1, which is the last, where it is null."""
        if pa.types.is_null(self.array.type):
            return np.full(len(self.array), -1), []
        if is_nested(self.array.type):
            return np.arange(len(self.array)), [python_value(cell) for cell in self.array]
        encoded = self.array if pa.types.is_dictionary(self.array.type) else self.array.dictionary_encode()
        codes = pc.fill_null(encoded.indices.cast(pa.int64()), -1).to_numpy(zero_copy_only=False)
        cells = encoded.dictionary
        if len(cells) > FEW_CELLS:  # these rows may be few of those that share the dictionary
            used, codes = _used(codes, len(cells))
            absent = int(used.size > 0 and used[0] < 0)
            codes, cells = codes - absent, cells.take(pa.array(used[absent:]))
        return codes, [_stripped(python_value(cell)) for cell in cells]

    def _word(self, cell: Any) -> Any:
        """Return the choice that a cell means; the cell itself where it means none."""
        if is_empty(cell):
            return self.default
        text = str(_stripped(cell))
        return self.field.word(text) or text


def _used(codes: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return those of `count` codes, and of -1, that there are, in order, and the place of each code among them."""
    if count > codes.size:
        used, places = np.unique(codes, return_inverse=True)
        return used, places
    are_there = np.bincount(codes + 1, minlength=count + 1) > 0
    return np.flatnonzero(are_there) - 1, (np.cumsum(are_there) - 1)[codes + 1]


def is_number(found: pa.DataType) -> bool:
    """Return whether a type is that of integers, floats or decimals."""
    return bool(pa.types.is_integer(found) or pa.types.is_floating(found) or pa.types.is_decimal(found))


def is_text(found: pa.DataType) -> bool:
    """Return whether a type is that of texts, those of a dictionary included."""
    if pa.types.is_dictionary(found):
        found = found.value_type
    return bool(
        pa.types.is_string(found) or pa.types.is_large_string(found) or pa.types.is_string_view(found)
    )


def is_list(found: pa.DataType) -> bool:
    """Return whether a type is that of lists."""
    return bool(
        pa.types.is_list(found) or pa.types.is_large_list(found) or pa.types.is_fixed_size_list(found)
    )


def is_nested(found: pa.DataType) -> bool:
    """Return whether a type is a list or a structure, for which Arrow builds no dictionary."""
    return is_list(found) or pa.types.is_struct(found)


def _stripped(cell: Any) -> Any:
    return cell.strip(BLANKS) if isinstance(cell, str) else cell


def _number_or_nan(cell: str | None) -> float:
    try:
        return math.nan if cell is None else read_number("", cell)
    except InvalidInputError:
        return math.nan


def _dividends(lists: pa.Array) -> PlainDividends:
    """Return the cash dividends of lists of structures; none where a list holds anything else than two numbers."""
    counts = pc.fill_null(pc.list_value_length(lists), 0).to_numpy(zero_copy_only=False).astype(np.int64)
    entries = lists.flatten()
    owner = np.repeat(np.arange(counts.size), counts)
    kind = entries.type
    names = [field.name for field in kind] if pa.types.is_struct(kind) else []
    if not all(name in names and is_number(kind.field(name).type) for name in ("time", "amount")):
        return PlainDividends(np.zeros_like(counts), np.zeros(0), np.zeros(0))
    null = entries.is_null().to_numpy(zero_copy_only=False)
    columns = {name: pc.struct_field(entries, name) for name in names}
    for name, column in columns.items():  # a number that is missing, or anything besides the two
        absent = column.is_null().to_numpy(zero_copy_only=False)
        null = null | (absent if name in ("time", "amount") else ~absent)
    counts[owner[null]] = 0
    counts[counts > CASH_DIVIDENDS.most_entries] = 0
    kept = counts[owner] > 0
    numbers = (
        pc.cast(columns[name], pa.float64(), safe=False).to_numpy(zero_copy_only=False)[kept]
        for name in ("time", "amount")
    )
    return PlainDividends(counts, *numbers)
