"""Tables without the types that Arrow's functions cannot take rows of: views of text, as polars gives them."""

from __future__ import annotations

import pyarrow as pa


def plain_table(frame: object) -> pa.Table:
    """Return what has Arrow's C stream interface as a table of plain types.

    Examples
    --------
    >>> plain_table(pa.table({"id": pa.array(["a"], pa.string_view())})).schema.field("id").type
    DataType(string)
    """
    table = pa.table(frame)
    schema = plain_schema(table.schema)
    return table if schema.equals(table.schema) else table.cast(schema)


def plain_schema(schema: pa.Schema) -> pa.Schema:
    """Return the same columns in plain types."""
    return pa.schema([field.with_type(_plain(field.type)) for field in schema], schema.metadata)


def _plain(found: pa.DataType) -> pa.DataType:
    if pa.types.is_string_view(found):
        return pa.string()
    if pa.types.is_binary_view(found):
        return pa.binary()
    if pa.types.is_dictionary(found):
        return pa.dictionary(found.index_type, _plain(found.value_type), found.ordered)
    if pa.types.is_list(found) or pa.types.is_large_list(found):
        entry = found.value_field.with_type(_plain(found.value_type))
        return pa.list_(entry) if pa.types.is_list(found) else pa.large_list(entry)
    if pa.types.is_struct(found):
        return pa.struct([field.with_type(_plain(field.type)) for field in found])
    return found
