"""Options and markets as the service is asked about them: JSON of one contract, an Arrow stream of many."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
import pyarrow as pa

from app.client.exchange import Question
from pricing_core.american import Market, Option
from pricing_core.american.book.columns import broadcast_columns
from pricing_core.american.contracts.json_text import cell_text, plain_json
from pricing_core.american.contracts.vocabulary import is_missing

JSON, ARROW = "application/json", "application/vnd.apache.arrow.stream"


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
    return Question(path, json.dumps(asked, default=plain_json).encode(), JSON, asked)


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
    return pa.table({name: _array(cells) for name, cells in broadcast_columns(columns).items()})


def _array(cells: np.ndarray[Any, Any]) -> pa.Array:
    """Return a column: numbers, or texts with lists and curves as JSON."""
    if cells.dtype.kind in "biufM":
        return pa.array(cells, from_pandas=True)
    values = [None if is_missing(cell) else cell for cell in cells.tolist()]
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return pa.nulls(len(values))
    if all(issubclass(kind, Real | Decimal) and not issubclass(kind, bool) for kind in kinds):
        return pa.array([None if value is None else float(value) for value in values], pa.float64())
    return pa.array([cell_text(value) for value in values], pa.string())
