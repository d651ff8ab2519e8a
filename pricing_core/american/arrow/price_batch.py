"""The rows of an Arrow table priced into columns of Arrow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pricing_core.american.arrow.arrow_column import ArrowColumn
from pricing_core.american.arrow.schema import result_schema
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.book.reading import ReadBook, read_columns
from pricing_core.american.book.table import Table
from pricing_core.american.book.unusual import EXAMINED, unusual_columns
from pricing_core.american.contracts.fields import COLUMN_FIELDS, EXPIRY
from pricing_core.american.contracts.vocabulary import DATES, DEFAULTS
from pricing_core.american.price_book import price_book
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError


def price_batch(
    batch: pa.RecordBatch,
    settings: PricingSettings,
    threads: int | None = None,
    refused: Mapping[int, InvalidInputError] | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[pa.RecordBatch, Mapping[int, InvalidInputError]]:
    """Return the results of every row with its message, and for each row without a price the reason.

    Parameters
    ----------
    batch : pyarrow.RecordBatch
        With columns that `check_names` accepts; of the types of `check_types`, or text.
    settings : PricingSettings
    threads : int, optional
        As in `price_many`.
    refused : mapping of int to InvalidInputError, optional
        Rows that are not to be read, and why.
    interrupt : callable, optional
        As in `price_book`.
    """
    read = read_columns(contract_columns(batch, settings), batch.num_rows, refused)
    return price_read(read, batch.schema.names, settings, threads, interrupt)


def price_read(
    read: ReadBook,
    names: Sequence[str],
    settings: PricingSettings,
    threads: int | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[pa.RecordBatch, Mapping[int, InvalidInputError]]:
    """Return the results of contracts that were read from columns with these names, as `price_batch` does."""
    table = price_book(read, names, settings, threads, interrupt)
    faults = {**read.faults, **_unpriced(table, read.faults)}
    schema = results_schema(names, settings)
    lists, arrays = table.lists(), []
    for field in schema:
        if field.name in lists:
            arrays.append(_list_array(lists[field.name]))
        else:
            arrays.append(_array(table.columns[field.name], field.type))
    if faults:
        unknown = np.zeros(read.count, dtype=bool)
        unknown[list(faults)] = True
        place = schema.get_field_index("exercise_now")
        arrays[place] = pc.if_else(pa.array(unknown), None, arrays[place])
    return pa.RecordBatch.from_arrays(arrays, schema=schema), faults


def results_schema(names: Sequence[str], settings: PricingSettings) -> pa.Schema:
    """Return the columns of the results for columns of these names, the message the last."""
    schema = result_schema(names, settings.greeks, greek_errors=settings.greek_errors, advice=settings.advice)
    return schema.append(pa.field("message", pa.string()))


def unfinished_rows(count: int, names: Sequence[str], settings: PricingSettings) -> pa.RecordBatch:
    """Return the results of `count` rows that were not priced in time: the status "deadline", and nothing else."""
    columns = {field.name: pa.nulls(count, field.type) for field in results_schema(names, settings)}
    columns["status"] = pa.array(["deadline"] * count, pa.string())
    return pa.RecordBatch.from_pydict(columns)


def contract_columns(batch: pa.RecordBatch, settings: PricingSettings) -> dict[str, ArrowColumn]:
    """Return the columns that describe contracts, those that a book must have with their defaults."""
    defaults: dict[str, Any] = {**DEFAULTS, "tolerance": settings.tolerance}
    names = batch.schema.names
    columns = {}
    for field in COLUMN_FIELDS:
        if field.name in names:
            dated = field is EXPIRY and all(date in names for date in DATES)
            array = batch.column(field.name)
            optional = dated or not field.required
            columns[field.name] = ArrowColumn(field, array, defaults.get(field.name), optional)
        elif field.name in defaults:
            nothing = pa.nulls(batch.num_rows)
            columns[field.name] = ArrowColumn(field, nothing, defaults[field.name])
    return columns


def unusual(batch: pa.RecordBatch, settings: PricingSettings) -> list[str]:
    """Return one sentence for each column of contracts that looks as if it were in another unit."""
    columns = contract_columns(batch, settings)
    return unusual_columns({name: column.numbers() for name, column in columns.items() if name in EXAMINED})


def _unpriced(table: Table, refused: Mapping[int, InvalidInputError]) -> dict[int, InvalidInputError]:
    """Return why contracts have no price."""
    faults = {}
    for row in np.flatnonzero(np.isnan(table.columns["price"])).tolist():
        if row not in refused:
            status, message = table.columns["status"][row], table.columns["message"][row]
            allowed = f"within reach of the method ({message or status})"
            faults[row] = InvalidInputError("", status, allowed)
    return faults


def _array(column: Any, kind: pa.DataType) -> pa.Array:
    """Return a column in which NaN and empty text are null."""
    array = pa.array(column, kind, from_pandas=True)
    return pc.if_else(pc.equal(array, ""), None, array) if pa.types.is_string(kind) else array


def _list_array(column: Ragged) -> pa.Array:
    """Return a column of lists, null where there is none."""
    empty = pa.array(column.counts() == 0)
    return pa.ListArray.from_arrays(pa.array(column.first, pa.int32()), pa.array(column.values), mask=empty)
