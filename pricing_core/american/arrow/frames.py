"""Frames of contracts in, frames of the same kind out: those of Arrow, pandas, polars or any with Arrow's streams."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import pyarrow as pa

from pricing_core.american.arrow.plain_types import plain_table
from pricing_core.american.arrow.price_batch import price_batch, unusual
from pricing_core.american.arrow.schema import check_names, check_results, check_types, result_schema
from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.checks import real_number
from pricing_core.american.contracts.dividends import is_pair
from pricing_core.american.contracts.fields import COLUMN_FIELDS, Greeks
from pricing_core.american.contracts.json_text import cell_text
from pricing_core.american.contracts.vocabulary import LISTS, is_missing
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError, Told


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
    table = known_frame(frame)
    contracts = contracts_of(table)
    added = schema_of_results(
        table, settings.greeks, greek_errors=settings.greek_errors, advice=settings.advice
    )
    if contracts.num_rows:
        warn_of(unusual(contracts.combine_chunks().to_batches()[0], settings), callers=3)
    return with_results(table, _results(contracts, added, settings, threads))  # type: ignore[no-any-return]


def known_frame(frame: Any) -> Any:
    """Return a frame of pandas or polars as it is, and any other as a pyarrow.Table."""
    return frame if _kind(frame) != "arrow" else pa.table(frame)


def contracts_of(table: Any, unneeded: Sequence[str] = ()) -> pa.Table:
    """Return the columns of a `known_frame` that state the contracts.

    Parameters
    ----------
    unneeded : sequence of str
        Columns that are not read, and may be missing.

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt, named twice, or cannot hold its values.
    """
    names = names_of(table)
    check_names(names, unneeded)
    wanted = [field.name for field in COLUMN_FIELDS if field.name in names and field.name not in unneeded]
    contracts = plain_table(pa.table({name: _as_arrow(table, name) for name in wanted}))
    check_types(contracts.schema)
    return contracts


def cells_of(table: Any, name: str) -> list[Any]:
    """Return the cells of a column of a `known_frame`, None where there is nothing."""
    cells: list[Any] = _as_arrow(table, name).to_pylist()
    return cells


def names_of(table: Any) -> list[str]:
    """Return the names of the columns of a `known_frame`."""
    return [str(name) for name in (table.schema.names if _kind(table) == "arrow" else table.columns)]


def schema_of_results(table: Any, greeks: Greeks, *, greek_errors: bool, advice: bool = False) -> pa.Schema:
    """Return the columns that the results of a `known_frame` have, without their messages.

    Raises
    ------
    InvalidInputError
        A column of the frame has the name of a result.
    """
    names = names_of(table)
    added = result_schema(names, greeks, greek_errors=greek_errors, advice=advice)
    check_results(names, [*added.names, "message"])
    return added


def with_results(table: Any, results: pa.Table) -> Any:
    """Return a `known_frame` with the columns of a table of results behind its own; one of pandas keeps its index."""
    kind = _kind(table)
    if kind == "pandas":
        found = results.to_pandas()
        return table.assign(**{name: found[name].set_axis(table.index) for name in found.columns})
    if kind == "polars":
        return table.hstack(type(table)(results))
    for name, column in zip(results.schema.names, results.columns, strict=True):
        table = table.append_column(name, column)
    return table


def _as_arrow(table: Any, name: str) -> pa.ChunkedArray:
    """Return a column as Arrow holds it, with numbers or text for objects that it has no type for."""
    kind = _kind(table)
    if kind == "arrow":
        return table[name]
    # Arrow would make two dates of a date and a number, and takes the address for an object of polars.
    if (name in LISTS and any(map(_has_pairs, table[name]))) or str(table[name].dtype) == "Object":
        return pa.chunked_array([_as_numbers(name, [*table[name]])])
    try:
        part = table[[name]]
        return (pa.Table.from_pandas(part, preserve_index=False) if kind == "pandas" else pa.table(part))[
            name
        ]
    except Exception:  # Arrow, pandas and polars each have errors of their own for this
        return pa.chunked_array([_as_numbers(name, [*table[name]])])


def _has_pairs(cell: Any) -> bool:
    """Tell a list of pairs from other cells."""
    return isinstance(cell, list | tuple) and any(map(is_pair, cell))


def _as_numbers(name: str, cells: list[Any]) -> pa.Array:
    """Return objects as numbers; where the column may hold text, as the text that stands for them."""
    field = next((field for field in COLUMN_FIELDS if field.name == name), None)
    if field is not None and field.kind != "number":
        return pa.array([cell_text(cell) for cell in cells], pa.string())
    try:
        return pa.array(
            [None if is_missing(cell) else real_number(name, cell) for cell in cells], pa.float64()
        )
    except InvalidInputError:
        raise InvalidInputError(
            f"column {name}", Told("values of several types"), "values of one type"
        ) from None


def _kind(frame: Any) -> str:
    package = type(frame).__module__.partition(".")[0]
    return package if package in ("pandas", "polars") and type(frame).__name__ == "DataFrame" else "arrow"


def _results(
    contracts: pa.Table, schema: pa.Schema, settings: PricingSettings, threads: int | None
) -> pa.Table:
    """Return the results of all rows, and their messages."""
    parts = [price_batch(batch, settings, threads)[0] for batch in contracts.combine_chunks().to_batches()]
    return pa.Table.from_batches(parts, schema.append(pa.field("message", pa.string())))
