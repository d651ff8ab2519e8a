"""The rows of a chunk priced, and what those without a price lack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pyarrow as pa

from pricing_core.american.arrow.price_batch import contract_columns, price_batch
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.chunk import Chunk
from pricing_core.errors import InvalidInputError

Reasons = Mapping[int, InvalidInputError]


def price_chunk(
    chunk: Chunk, settings: PricingSettings, numbers: Sequence[str], threads: int | None = None
) -> tuple[pa.RecordBatch, Reasons]:
    """Return the rows with their results appended, and by index the reason why a row has no price.

    Parameters
    ----------
    numbers : sequence of str
        Columns of text that are to become numbers.
    threads : int, optional
        As in `price_many`.
    """
    results, reasons = price_batch(chunk.table, settings, threads, chunk.malformed)
    results = results.select(results.schema.names[:-1])  # the reasons say more than the messages
    table = typed_table(chunk.table, settings, numbers)
    schema = pa.schema([*table.schema, *results.schema])
    return pa.RecordBatch.from_arrays([*table.columns, *results.columns], schema=schema), reasons


def typed_table(table: pa.RecordBatch, settings: PricingSettings, numbers: Sequence[str]) -> pa.RecordBatch:
    """Return the table with some texts as the numbers that they are; null where there is none."""
    columns = dict(zip(table.schema.names, table.columns, strict=True))
    read = contract_columns(table, settings) if numbers else {}
    for name in numbers:
        columns[name] = pa.array(read[name].numbers(), from_pandas=True)
    return pa.RecordBatch.from_pydict(columns) if numbers else table
