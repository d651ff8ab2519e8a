"""Frames of contracts in, frames of the same kind out: those of Arrow, pandas, polars or any with Arrow's streams."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import pyarrow as pa

from pricing_core.american.arrow.plain_types import plain_table
from pricing_core.american.arrow.price_batch import price_batch, unusual
from pricing_core.american.arrow.schema import check_names, check_results, check_types, result_schema
from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.fields import COLUMN_FIELDS
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError


class Frame(Protocol):
    """A table that passes its columns through Arrow's C stream interface."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return the stream's capsule."""
        ...


AnyFrame = TypeVar("AnyFrame", bound=Frame)


def price_frame(frame: AnyFrame, settings: PricingSettings, threads: int | None) -> AnyFrame:
    """Return the frame with the results of every row as further columns.

    A frame of pandas keeps its index, and of each kind of frame all other columns stay as they are. What has the
    interface and is of no kind known here comes back as a pyarrow.Table.

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt, named twice or as a result, or cannot hold its values.
    """
    kind = _kind(frame)
    table: Any = frame if kind in ("pandas", "polars") else pa.table(frame)
    names = [str(name) for name in (table.columns if kind != "arrow" else table.schema.names)]
    check_names(names)
    wanted = [field.name for field in COLUMN_FIELDS if field.name in names]
    contracts = _as_arrow(table, kind, wanted)
    check_types(contracts.schema)
    added = result_schema(names, settings.greeks, greek_errors=settings.greek_errors)
    check_results(names, [*added.names, "message"])
    if contracts.num_rows:
        warn_of(unusual(contracts.combine_chunks().to_batches()[0], settings), callers=3)
    results = _results(contracts, added, settings, threads)
    if kind == "pandas":
        return _with_columns_of_pandas(table, results)  # type: ignore[no-any-return]
    if kind == "polars":
        return table.hstack(type(table)(results))  # type: ignore[no-any-return]
    for name, column in zip(results.schema.names, results.columns, strict=True):
        table = table.append_column(name, column)
    return table  # type: ignore[no-any-return]


def _kind(frame: Any) -> str:
    package = type(frame).__module__.partition(".")[0]
    return package if package in ("pandas", "polars") and type(frame).__name__ == "DataFrame" else "arrow"


def _as_arrow(table: Any, kind: str, names: Sequence[str]) -> pa.Table:
    """Return some columns as Arrow holds them."""
    if kind == "arrow":
        return plain_table(table.select(names))
    columns = {}
    for name in names:
        try:
            part = table[[name]]
            columns[name] = (
                pa.Table.from_pandas(part, preserve_index=False) if kind == "pandas" else pa.table(part)
            )[name]
        except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError):
            raise InvalidInputError(
                f"column {name}", "values of several types", "values of one type"
            ) from None
    return plain_table(pa.table(columns))


def _results(
    contracts: pa.Table, schema: pa.Schema, settings: PricingSettings, threads: int | None
) -> pa.Table:
    """Return the results of all rows, and their messages."""
    parts = [price_batch(batch, settings, threads)[0] for batch in contracts.combine_chunks().to_batches()]
    return pa.Table.from_batches(parts, schema.append(pa.field("message", pa.string())))


def _with_columns_of_pandas(frame: Any, results: pa.Table) -> Any:
    found = results.to_pandas()
    return frame.assign(**{name: found[name].set_axis(frame.index) for name in found.columns})
