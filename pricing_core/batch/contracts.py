"""From the cells of a chunk to the columns that `price_many` takes, with one fault at most per row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from pricing_core.american.book.reading import checked_contract
from pricing_core.american.contracts.dates import is_meant_as_date
from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import COLUMN_FIELDS, EXPIRY, TOLERANCE
from pricing_core.american.contracts.vocabulary import DATES, DEFAULTS
from pricing_core.batch.chunk import Chunk, is_empty, python_value
from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import read_number


@dataclass(frozen=True, slots=True)
class Contracts:
    """The contracts of one chunk, row by row.

    Parameters
    ----------
    columns : Mapping[str, Sequence[Any]]
        One entry per input column, and tolerance, each of the chunk's length: texts, numbers, dates, lists and
        curves, the last two parsed or not; None in a cell that is missing or at fault.
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
    columns: dict[str, Sequence[Any]] = {"tolerance": [tolerance] * chunk.table.num_rows}
    for column in COLUMN_FIELDS:
        if column.name in names:
            dated = column is EXPIRY and all(date in names for date in DATES)
            optional = not column.required or dated
            columns[column.name] = _read_column(column, chunk, defaults.get(column.name), optional, faults)
    return Contracts(columns, faults)


def explain(row: Mapping[str, Any]) -> InvalidInputError | None:
    """Return what the contract or the market refuses in a row; None if nothing."""
    try:
        checked_contract({name: value for name, value in row.items() if value is not None})
    except InvalidInputError as fault:
        return fault
    return None


def _read_column(
    column: Field, chunk: Chunk, default: Any, optional: bool, faults: dict[int, InvalidInputError]
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


def _read_cell(column: Field, cell: Any, default: Any, optional: bool) -> Any:
    if cell is None or is_empty(cell):
        if default is None and not optional:
            raise InvalidInputError(column.name, "", f"given ({column.in_brief})")
        return default
    if column.kind == "choice":
        return str(cell).strip(" \t")
    if column.kind in ("list", "date") or (column.kind == "curve" and _is_curve(cell)):
        return cell.strip(" \t") if isinstance(cell, str) else cell
    if column.kind == "time" and is_meant_as_date(cell):
        return cell.strip(" \t") if isinstance(cell, str) else cell
    number = read_number(column.name, cell)
    # The tolerance is the one number whose range is not checked by Option or Market.
    return column.check(number) if column is TOLERANCE else number


def _is_curve(cell: Any) -> bool:
    return cell.lstrip(" \t").startswith("{") if isinstance(cell, str) else isinstance(cell, Mapping)
