"""Rows as lines of CSV, written by Arrow: quotes where needed, numbers as their shortest text, "" for none."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc

from pricing_core.errors import InvalidInputError

MARKS = (b'"', b",", b"\r", b"\n")
NEEDS_QUOTES = '[",\r\n]'


def check_text_form(schema: pa.Schema) -> None:
    """Accept columns that cells of CSV can hold: text, numbers, flags, times, lists of numbers; not bytes and others.

    Raises
    ------
    InvalidInputError
        A column is of another type.
    """
    for field in schema:
        if not _has_text_form(field.type):
            allowed = "left out, or written to a .parquet file: a CSV cell cannot hold it"
            raise InvalidInputError(f"column {field.name}", str(field.type), allowed)


def csv_lines(table: pa.RecordBatch) -> pa.Buffer:
    r"""Return the rows as UTF-8 lines, each with a line feed at its end.

    Examples
    --------
    >>> rows = pa.record_batch({"id": ["a", 'b, c'], "spot": [90.0, None], "price": [0.1, float("nan")]})
    >>> csv_lines(rows).to_pybytes()
    b'a,90,0.1\n"b, c",,\n'
    """
    if table.num_rows == 0:
        return pa.py_buffer(b"")
    columns = [_text(column) for column in table.columns]
    last = pc.binary_join_element_wise(columns.pop(), "\n", "", null_handling="replace")
    lines = pc.binary_join_element_wise(*columns, last, ",", null_handling="replace")
    return lines.buffers()[2]


def header_line(names: list[str]) -> bytes:
    """Return the line that names the columns."""
    cells = pa.RecordBatch.from_pydict({str(place): [name] for place, name in enumerate(names)})
    return bytes(csv_lines(cells))


def _text(column: pa.Array) -> pa.Array:
    if pa.types.is_floating(column.type):
        is_nan = pc.is_nan(column)
        if pc.any(is_nan).as_py():
            column = pc.if_else(is_nan, pa.scalar(None, column.type), column)
        return pc.cast(column, pa.string())
    text = _json(column) if _is_list_of_numbers(column.type) else pc.cast(column, pa.string())
    if pa.types.is_integer(column.type) or pa.types.is_boolean(column.type) or not _may_need_quotes(text):
        return text
    quoted = pc.binary_join_element_wise(
        '"', pc.replace_substring(text, '"', '""'), '"', "", null_handling="emit_null"
    )
    return pc.if_else(pc.match_substring_regex(text, NEEDS_QUOTES), quoted, text)


def _json(column: pa.Array) -> pa.Array:
    """Return lists of numbers as their JSON text, null where there is none."""
    numbers = pc.cast(column, pa.list_(pa.string()))
    return pc.binary_join_element_wise("[", pc.binary_join(numbers, ", "), "]", "", null_handling="emit_null")


def _is_list_of_numbers(found: pa.DataType) -> bool:
    return bool(pa.types.is_list(found) and pa.types.is_floating(found.value_type))


def _may_need_quotes(text: pa.StringArray) -> bool:
    letters = text.buffers()[2]
    if letters is None:
        return False
    # A slice shares the letters of the whole, which are more than its own.
    content = letters.to_pybytes()
    return any(mark in content for mark in MARKS)


def _has_text_form(found: pa.DataType) -> bool:
    values = found.value_type if pa.types.is_dictionary(found) else found
    if "binary" in str(values):  # binary of any width; only some cells are text by chance
        return False
    if _is_list_of_numbers(found):
        return True
    try:
        pc.cast(pa.nulls(0, found), pa.string())
    except pa.ArrowNotImplementedError:
        return False
    return True
