"""The sound rows of a chunk priced, and what the others lack."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pricing_core.american import price_many
from pricing_core.american.book.columns import as_objects
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contracts import Contracts, explain, read_contracts
from pricing_core.batch.schema import result_schema
from pricing_core.batch.settings import PricingSettings
from pricing_core.errors import InvalidInputError

INVALID = "invalid_input"
Reasons = Mapping[int, InvalidInputError]


def price_chunk(
    chunk: Chunk, settings: PricingSettings, numbers: Sequence[str], threads: int | None = None
) -> tuple[pa.RecordBatch, Reasons]:
    """Return the rows with their results appended and, by index, why a row has no price.

    Parameters
    ----------
    numbers : sequence of str
        Columns of text that are to become numbers.
    threads : int, optional
        As in `price_many`.
    """
    contracts = read_contracts(chunk, settings.tolerance)
    results, reasons = _price_contracts(contracts, settings, threads)
    table = _typed_table(chunk.table, contracts, numbers)
    schema = pa.schema([*table.schema, *results.schema])
    return pa.RecordBatch.from_arrays([*table.columns, *results.columns], schema=schema), reasons


def _price_contracts(
    contracts: Contracts, settings: PricingSettings, threads: int | None
) -> tuple[pa.RecordBatch, Reasons]:
    rows = len(contracts.columns["tolerance"])
    fields = price_fields(settings.greeks, contracts.columns, greek_errors=settings.greek_errors)
    columns = {field.name: np.full(rows, None, dtype=object) for field in fields}
    columns["status"][list(contracts.faults)] = INVALID
    reasons = dict(contracts.faults)
    sound = [index for index in range(rows) if index not in contracts.faults]
    if sound:
        table = price_many(
            _columns(contracts, sound),
            greeks=settings.greeks,
            greek_errors=settings.greek_errors,
            share_solves=settings.share_solves,
            threads=threads,
        )
        for field in fields:
            found = table[field.name]
            columns[field.name][sound] = _as_json(found) if field.kind == "list" else found
        reasons.update(_unpriced(contracts, sound, table))
    columns["exercise_now"][list(reasons)] = None
    schema = result_schema(list(contracts.columns), settings.greeks, greek_errors=settings.greek_errors)
    arrays = [_as_arrow(column, kind) for column, kind in zip(columns.values(), schema.types, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=schema), reasons


def _typed_table(table: pa.RecordBatch, contracts: Contracts, numbers: Sequence[str]) -> pa.RecordBatch:
    """Return the table with some texts as the numbers that they are; null where there is none."""
    columns = dict(zip(table.schema.names, table.columns, strict=True))
    for name in numbers:
        cells = contracts.columns[name]
        columns[name] = pa.array([c if isinstance(c, float) else None for c in cells], pa.float64())
    return pa.RecordBatch.from_pydict(columns) if numbers else table


def _columns(contracts: Contracts, sound: Sequence[int]) -> dict[str, NDArray[Any]]:
    # As objects: an array of text gives every cell the width of the longest and drops trailing NULs.
    return {name: as_objects([values[i] for i in sound]) for name, values in contracts.columns.items()}


def _as_json(lists: NDArray[np.object_]) -> list[str]:
    """Return a list of numbers per row as text, "" for none, null for NaN."""
    finite = ([None if math.isnan(number) else number for number in row or ()] for row in lists)
    return [json.dumps(numbers) if numbers else "" for numbers in finite]


def _unpriced(contracts: Contracts, sound: Sequence[int], table: Mapping[str, NDArray[Any]]) -> Reasons:
    reasons: dict[int, InvalidInputError] = {}
    for position in np.flatnonzero(np.isnan(table["price"])).tolist():
        index = sound[position]
        status, message = str(table["status"][position]), str(table["message"][position])
        fault = InvalidInputError("", status, f"within reach of the method ({message or status})")
        reasons[index] = explain(contracts.row(index)) or fault
    return reasons


def _as_arrow(column: NDArray[np.object_], kind: pa.DataType) -> pa.Array:
    """Return a column in which None, NaN and empty text are null."""
    return pa.array([None if cell == "" else cell for cell in column], kind, from_pandas=True)
