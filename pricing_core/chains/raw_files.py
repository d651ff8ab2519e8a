"""Files and frames of quotes as raw columns: CSV, JSON with nested objects, Parquet, Arrow."""

from __future__ import annotations

import csv
import gzip
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pricing_core.batch.locations import as_location, open_binary
from pricing_core.chains.canonical import RawTable
from pricing_core.errors import InvalidInputError, Told

FORMS = ".csv, .csv.gz, .csv.zst, .json or .parquet"
DELIMITERS = ",;\t|"
# Keys under which answers of vendors hold their list of quotes.
HOLDERS = ("quotes", "results", "data", "options", "option")


def raw_table(source: object) -> RawTable:
    """Return the columns of a file, a frame, a mapping of columns or a list of records.

    Raises
    ------
    InvalidInputError
        It is none of them, or cannot be read as a table.
    OSError
        The file cannot be read.
    """
    if isinstance(source, str | os.PathLike):
        return _of_file(as_location(source))
    if isinstance(source, pa.Table) or hasattr(source, "__arrow_c_stream__"):
        return of_arrow(pa.table(source))
    if isinstance(source, Mapping):
        return of_json({name: _as_list(column) for name, column in source.items()})
    if isinstance(source, list):
        return of_json(source)
    raise InvalidInputError("quotes", source, f"a {FORMS} file, or a table")


def of_arrow(table: pa.Table) -> RawTable:
    """Return the columns of an Arrow table, structures as columns of their own."""
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    names = table.schema.names
    _check_names(names)
    return RawTable({name: table[name].to_pylist() for name in names}, table.num_rows)


def of_json(content: object, check: Callable[[int, int], None] | None = None) -> RawTable:
    """Return the records of a JSON answer, or its columns; nested objects as columns with dots in their names.

    Parameters
    ----------
    content : object
        Whatever the JSON text stands for.
    check : callable, optional
        Is told the numbers of rows and columns before a table is made of them, and may raise: records that have no
        name in common have as many columns as values, and a table that grows with the square of their number.

    Raises
    ------
    InvalidInputError
        There are neither.
    """
    found = _records(content)
    if isinstance(found, Mapping):
        lengths = {len(column) for column in found.values()}
        if len(lengths) != 1:
            raise InvalidInputError(
                "quotes", Told(f"columns of lengths {sorted(lengths)}"), "columns of one length"
            )
        (count,) = lengths
        if check is not None:
            check(count, len(found))
        return RawTable({str(name): list(column) for name, column in found.items()}, count)
    rows = [dict(_flat("", record)) for record in found]
    names = dict.fromkeys(name for row in rows for name in row)
    if check is not None:
        check(len(rows), len(names))
    return RawTable({name: [row.get(name) for row in rows] for name in names}, len(rows))


def of_csv(text: str) -> RawTable:
    """Return the columns of a CSV text, whose delimiter is found in its header; rows of another width are faults.

    Raises
    ------
    InvalidInputError
        It has no header, names a column twice, or a quote in it is left open.
    """
    header = text.lstrip("\ufeff").partition("\n")[0]
    delimiter = max(DELIMITERS, key=header.count)
    reader = csv.reader(_lines(text.lstrip("\ufeff")), delimiter=delimiter, strict=True)
    try:
        rows = [row for row in reader if row]
    except csv.Error as error:
        raise InvalidInputError("quotes", Told(f"line {reader.line_num}: {error}"), "CSV") from None
    if not rows:
        raise InvalidInputError("quotes", Told("an empty file"), "a table that names its columns")
    names = [name.strip() for name in rows.pop(0)]
    _check_names(names)
    width = len(names)
    faults = {
        place: f"{len(row)} cells, where the header has {width}"
        for place, row in enumerate(rows)
        if len(row) != width
    }
    for place in faults:
        rows[place] = [""] * width
    columns: Iterable[Sequence[object]] = zip(*rows, strict=True) if rows else ([] for _ in names)
    return RawTable(
        {name: list(column) for name, column in zip(names, columns, strict=True)}, len(rows), faults
    )


def _lines(text: str) -> Iterator[str]:
    """Yield the lines of a text, which `io.StringIO` would hold once more, at four bytes a character."""
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def _as_list(column: object) -> object:
    """Return an array as a list; dates stay NumPy's, which would make numbers of those to the nanosecond."""
    if isinstance(column, np.ndarray):
        return list(column) if column.dtype.kind == "M" else column.tolist()
    return column


def _of_file(location: str) -> RawTable:
    lowered = location.lower()
    with open_binary(location) as file:
        if lowered.endswith(".parquet"):
            try:
                return of_arrow(pq.read_table(file))
            except pa.ArrowInvalid as error:
                raise InvalidInputError("quotes", location, f"a Parquet file: {error}") from None
        content = file.read()
    if lowered.endswith(".gz"):
        content, lowered = _gunzipped(location, content), lowered.removesuffix(".gz")
    elif lowered.endswith(".zst"):
        content, lowered = _unpacked(location, content), lowered.removesuffix(".zst")
    if lowered.endswith((".csv", ".txt", ".tsv")):
        return of_csv(_text(location, content))
    if lowered.endswith(".json"):
        return of_json(json_content(_text(location, content)))
    raise InvalidInputError("quotes", location, f"a {FORMS} file")


def json_content(text: str) -> object:
    """Return the value of a JSON text.

    Raises
    ------
    InvalidInputError
        It is no JSON.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise InvalidInputError("quotes", Told("a text"), "JSON") from None


def _records(content: object) -> Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]]:
    """Return the list of records in an answer, or columns of one length."""
    for _ in range(3):
        if isinstance(content, list) and all(isinstance(record, Mapping) for record in content):
            return content
        if not isinstance(content, Mapping) or not content:
            break
        if all(isinstance(column, list) for column in content.values()) and not _holds_records(content):
            return content
        holder = next((name for name in HOLDERS if name in content), None)
        if holder is None:
            break
        content = content[holder]
    raise InvalidInputError(
        "quotes", Told("other JSON"), "a list of records, or an object with a list for each column"
    )


def _holds_records(content: Mapping[str, Any]) -> bool:
    return any(
        name in HOLDERS and column and isinstance(column[0], Mapping) for name, column in content.items()
    )


def _flat(prefix: str, record: Mapping[str, Any]) -> Iterable[tuple[str, object]]:
    for name, value in record.items():
        if isinstance(value, Mapping) and not prefix.count("."):
            yield from _flat(f"{prefix}{name}.", value)
        else:
            yield f"{prefix}{name}", value


def _check_names(names: Sequence[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise InvalidInputError("column", name, "named once")


def _gunzipped(location: str, content: bytes) -> bytes:
    try:
        return gzip.decompress(content)
    except (OSError, EOFError):
        raise InvalidInputError("quotes", location, "a file compressed by gzip") from None


def _unpacked(location: str, content: bytes) -> bytes:
    try:
        with pa.CompressedInputStream(pa.BufferReader(content), "zstd") as stream:
            return bytes(stream.read())
    except OSError:
        raise InvalidInputError("quotes", location, "a file compressed by zstd") from None


def _text(location: str, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInputError("quotes", location, "UTF-8 text") from None
