"""From the cells of a chunk to the columns that `price_many` takes, with one fault at most per row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pricing_core.american import Market, Option
from pricing_core.american.contract import real_number
from pricing_core.american.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from pricing_core.batch.chunk import Chunk, is_empty
from pricing_core.batch.schema import COLUMNS, UNSUPPORTED_COLUMNS, Column
from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import Cell, read_number

Value = str | float


@dataclass(frozen=True, slots=True)
class Contracts:
    """The contracts of one chunk, row by row.

    Parameters
    ----------
    columns : Mapping[str, Sequence[Value | None]]
        One entry per input column, each of the chunk's length; None in a cell that is missing or at fault.
    faults : Mapping[int, InvalidInputError]
        Why a row cannot be priced, by its index in the chunk.
    """

    columns: Mapping[str, Sequence[Value | None]]
    faults: Mapping[int, InvalidInputError]

    def row(self, index: int) -> dict[str, Value | None]:
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
    defaults: dict[str, Value] = {"exercise": "american", "dividend_yield": 0.0, "tolerance": tolerance}
    columns: dict[str, Sequence[Value | None]] = {}
    for column in COLUMNS:
        default = defaults.get(column.name)
        if column.name in chunk.table.schema.names:
            columns[column.name] = _read_column(column, chunk, default, faults)
        else:
            columns[column.name] = [default] * chunk.table.num_rows
    for name in UNSUPPORTED_COLUMNS:
        if name in chunk.table.schema.names:
            _refuse_column(name, chunk, faults)
    return Contracts(columns, faults)


def explain(row: Mapping[str, Any]) -> InvalidInputError | None:
    """Return what the contract or the market refuses in a row; None if nothing."""
    try:
        Option(row["option_type"], row["strike"], row["expiry"], row["exercise"])
        Market(row["spot"], row["rate"], row["volatility"], row["dividend_yield"])
    except InvalidInputError as fault:
        return fault
    return None


def _read_column(
    column: Column, chunk: Chunk, default: Value | None, faults: dict[int, InvalidInputError]
) -> Sequence[Value | None]:
    values: list[Value | None] = []
    for index, cell in enumerate(chunk.table.column(column.name).to_pylist()):
        try:
            values.append(_read_cell(column, cell, default))
        except InvalidInputError as fault:
            values.append(None)
            faults.setdefault(index, fault)
    return values


def _read_cell(column: Column, cell: Cell | None, default: Value | None) -> Value:
    if cell is None or is_empty(cell):
        if default is None:
            raise InvalidInputError(column.name, "", f"given ({column.meaning})")
        return default
    if column.kind == "text":
        return str(cell).strip(" \t")
    number = read_number(column.name, cell)
    if column.name != "tolerance":
        return number
    # The one number whose range is not checked by Option or Market.
    return real_number("tolerance", number, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)


def _refuse_column(name: str, chunk: Chunk, faults: dict[int, InvalidInputError]) -> None:
    for index, cell in enumerate(chunk.table.column(name).to_pylist()):
        if not is_empty(cell):
            faults.setdefault(index, InvalidInputError(name, cell, "empty: this version does not support it"))
