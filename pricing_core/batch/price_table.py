"""An Arrow table of contracts in, the same rows with their values out; no file is touched."""

import pyarrow as pa

from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.results import price_chunk
from pricing_core.batch.schema import check_names, check_results, check_types, result_schema
from pricing_core.batch.settings import PricingSettings


def price_table(
    table: pa.Table,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    share_solves: bool = False,
    threads: int | None = None,
) -> pa.Table:
    """Price every row of a table, in order; a bad row gets a status, never an exception.

    Parameters
    ----------
    table : pyarrow.Table
        Columns as in `price_many`; others pass through unchanged.
    tolerance, greeks, greek_errors, share_solves, threads
        As in `price_many`.

    Returns
    -------
    pyarrow.Table
        The columns of `table` and then those of the results; missing numbers are null.

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt or of a type that cannot hold its values.
    """
    settings = PricingSettings(tolerance, greeks, greek_errors, share_solves)
    check_names(table.schema.names)
    check_types(table.schema)
    added = result_schema(table.schema.names, greeks, greek_errors=greek_errors)
    check_results(table.schema.names, added.names)
    (batch,) = table.combine_chunks().to_batches() or [pa.RecordBatch.from_pylist([], table.schema)]
    priced, _ = price_chunk(Chunk(range(1, batch.num_rows + 1), batch), settings, (), threads)
    return pa.Table.from_batches([priced])
