"""From the cells of a chunk to the columns that `price_many` takes, with one fault at most per row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from pricing_core.american.contracts.contract import real_number
from pricing_core.american.contracts.dates import is_meant_as_date
from pricing_core.american.contracts.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from pricing_core.american.contracts.vocabulary import DATES
from pricing_core.american.tables.book_rows import checked_contract
from pricing_core.batch.chunk import Chunk, is_empty, python_value
from pricing_core.batch.schema import COLUMNS, Column
from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import read_number

DEFAULTS: Mapping[str, Any] = {"exercise": "american", "dividend_yield": 0.0}


@dataclass(frozen=True, slots=True)
class Contracts:
    """The contracts of one chunk, row by row.

    Parameters
    ----------
    columns : Mapping[str, Sequence[Any]]
        One entry per input column, each of the chunk's length: texts, numbers, dates, lists and curves, the last
        two parsed or not; None in a cell that is missing or at fault.
    faults : Mapping[int, InvalidInputError]
        Why a row cannot be priced, by its index in the chunk.
    """

    columns: Mapping[str, Sequence[Any]]
    faults: Mapping[int, InvalidInputError]

    def row(self, index: int) -> dict[str, Any]:
        """Return one contract by the names of its columns."""
        return {name: values[index] for name, values in self.columns.items()}


def read_contracts(chunk: Chunk, tolerance: float) -> Contracts:
    """Read every row of `chunk`; an empty optional cell takes its default, a bad cell faults its row alone.

    Parameters
    ----------
    tolerance : float
        For the rows that state none; fraction of the strike.
    """
    faults = dict(chunk.malformed)
    names = chunk.table.schema.names
    defaults = {**DEFAULTS, "tolerance": tolerance}
    columns: dict[str, Sequence[Any]] = {}
    for column in COLUMNS:
        default = defaults.get(column.name)
        if column.name in names:
            optional = not column.required or (
                column.name == "expiry" and all(date in names for date in DATES)
            )
            columns[column.name] = _read_column(column, chunk, default, optional, faults)
        elif default is not None:
            columns[column.name] = [default] * chunk.table.num_rows
    return Contracts(columns, faults)


def explain(row: Mapping[str, Any]) -> InvalidInputError | None:
    """Return what the contract or the market refuses in a row; None if nothing."""
    try:
        checked_contract({name: value for name, value in row.items() if value is not None})
    except InvalidInputError as fault:
        return fault
    return None


def _read_column(
    column: Column, chunk: Chunk, default: Any, optional: bool, faults: dict[int, InvalidInputError]
) -> Sequence[Any]:
    values: list[Any] = []
    for index, cell in enumerate(_cells(chunk.table.column(column.name))):
        try:
            values.append(_read_cell(column, cell, default, optional))
        except InvalidInputError as fault:
            values.append(None)
            faults.setdefault(index, fault)
    return values


def _cells(column: pa.Array) -> list[Any]:
    if pa.types.is_timestamp(column.type):  # Python's date-times know no nanoseconds
        unit = "us" if column.type.unit == "ns" else column.type.unit
        column = column.cast(pa.timestamp(unit, column.type.tz and "UTC"), safe=False)
    try:
        cells: list[Any] = column.to_pylist()
    except (OverflowError, ValueError):  # a date before the year 1, or after 9999
        cells = [python_value(cell) for cell in column]
    return cells


def _read_cell(column: Column, cell: Any, default: Any, optional: bool) -> Any:
    if cell is None or is_empty(cell):
        if default is None and not optional:
            raise InvalidInputError(column.name, "", f"given ({column.meaning})")
        return default
    if column.kind == "text":
        return str(cell).strip(" \t")
    if column.kind in ("list", "date") or (column.kind == "curve" and _is_curve(cell)):
        return cell.strip(" \t") if isinstance(cell, str) else cell
    if column.kind == "time" and is_meant_as_date(cell):
        return cell.strip(" \t") if isinstance(cell, str) else cell
    number = read_number(column.name, cell)
    if column.name != "tolerance":
        return number
    # The one number whose range is not checked by Option or Market.
    return real_number("tolerance", number, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)


def _is_curve(cell: Any) -> bool:
    return cell.lstrip(" \t").startswith("{") if isinstance(cell, str) else isinstance(cell, Mapping)
