"""Options and markets as the service is asked about them: JSON of one contract, an Arrow stream of many."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from app.client.exchange import Question
from pricing_core.american import Market, Option
from pricing_core.american.contracts.fields import CONTRACT_FIELDS, EXERCISE_TIMES
from pricing_core.errors import InvalidInputError

JSON, ARROW = "application/json", "application/vnd.apache.arrow.stream"
LISTS = tuple(field.name for field in CONTRACT_FIELDS if field.kind == "list")


def contract_question(path: str, option: Option, market: Market, *without: str, **others: Any) -> Question:
    """Return the question about one contract.

    Parameters
    ----------
    without : str
        Fields of the contract that are not sent.
    others : object
        Further fields; those that are None are not sent.
    """
    asked = {name: value for name, value in (asdict(option) | asdict(market)).items() if name not in without}
    if option.exercise != "bermudan":
        del asked["exercise_times"]
    asked |= {name: value for name, value in others.items() if value is not None}
    return Question(path, json.dumps(asked, default=plain).encode(), JSON, asked)


def table_question(path: str, table: pa.Table) -> Question:
    """Return the question about the contracts of a table."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return Question(path, sink.getvalue().to_pybytes(), ARROW, {})


def contracts_table(columns: Mapping[str, Any]) -> pa.Table:
    """Return columns as `price_many` takes them as a table: scalars in every row, lists and curves as JSON text.

    Raises
    ------
    InvalidInputError
        Columns have different lengths.
    """
    cells = {name: _cells(name, column) for name, column in columns.items()}
    lengths = {name: len(column) for name, column in cells.items() if column is not None}
    count = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != count:
            raise InvalidInputError(name, f"{length} rows", f"{count} rows long, as another column is")
    arrays = {}
    for name, column in cells.items():
        values = [columns[name]] * count if column is None else column
        arrays[name] = _array(values)
    return pa.table(arrays)


def _cells(name: str, column: Any) -> Sequence[Any] | None:
    """Return the cells of a column, or None where one value serves all rows."""
    if _is_single(column):
        return None
    values: Sequence[Any] = column.tolist() if isinstance(column, np.ndarray) else list(column)
    if name not in LISTS:
        return values
    is_one_list = all(isinstance(one, Mapping) or is_dataclass(one) for one in values)
    if name == EXERCISE_TIMES.name:
        is_one_list = all(np.isscalar(one) and not _is_json(one) for one in values)
    return None if is_one_list else values


def _is_single(column: Any) -> bool:
    if isinstance(column, np.ndarray):
        return column.ndim == 0
    return isinstance(column, (str, Mapping)) or is_dataclass(column) or not hasattr(column, "__len__")


def _is_json(cell: Any) -> bool:
    return isinstance(cell, str) and cell.lstrip().startswith("[")


def _array(values: Sequence[Any]) -> pa.Array:
    """Return a column: numbers, or texts with lists and curves as JSON."""
    if not any(isinstance(one, (str, Mapping, Sequence)) or is_dataclass(one) for one in values):
        return pa.array(values, from_pandas=True)
    return pa.array([_text(one) for one in values])


def _text(cell: Any) -> str | None:
    return cell if cell is None or isinstance(cell, str) else json.dumps(cell, default=plain)


def plain(value: Any) -> Any:
    """Return a value in a form that JSON can hold."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)
