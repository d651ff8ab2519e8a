"""Tables written part by part: lines of CSV as they are, rows in row groups of Parquet."""

from __future__ import annotations

import gzip
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, BinaryIO, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from pricing_core.batch.csv_lines import header_line
from pricing_core.batch.formats import FileFormat

# Rows in a row group of a Parquet file; smaller groups cost space and reading time.
ROWS_PER_GROUP = 65_536
GZIP_LEVEL = 1  # Numbers of sixteen digits gain little from more.


class TableWriter(Protocol):
    """Appends parts to a table; leaving the `with` block completes it, the file itself stays open."""

    def __enter__(self) -> TableWriter: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def write(self, content: Any) -> None:
        """Append the content of a part."""
        ...


def table_writer(file: BinaryIO, format_: FileFormat, schema: pa.Schema) -> TableWriter:
    """Return the writer of a table of these columns."""
    return (
        ParquetWriter(file, schema) if format_.kind == "parquet" else CsvWriter(file, format_, schema.names)
    )


class CsvWriter:
    """Writes a header and lines of CSV, compressed or not."""

    def __init__(self, file: BinaryIO, format_: FileFormat, names: list[str]) -> None:
        self._stack = ExitStack()
        self._file: Any = file
        if format_.compression == "gzip":  # Arrow's is at the slowest level
            stream = gzip.GzipFile(filename="", mode="wb", compresslevel=GZIP_LEVEL, fileobj=file, mtime=0)
            self._file = self._stack.enter_context(stream)
        elif format_.compression == "zstd":
            stream = pa.CompressedOutputStream(pa.PythonFile(file, mode="w"), "zstd")
            self._file = self._stack.enter_context(stream)
        self._file.write(header_line(names))

    def __enter__(self) -> CsvWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def write(self, content: pa.Buffer) -> None:
        """Append lines."""
        self._file.write(content)


class ParquetWriter:
    """Writes Parquet in row groups of 65,536 rows, columns of text by dictionary."""

    def __init__(self, file: BinaryIO, schema: pa.Schema) -> None:
        self._schema = schema
        texts = [field.name for field in schema if _is_text(field.type)]
        self._writer = pq.ParquetWriter(file, schema, use_dictionary=texts, compression="snappy")
        self._held: list[pa.RecordBatch] = []
        self._held_rows = 0

    def __enter__(self) -> ParquetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._flush()
            self._writer.close()
            return
        with suppress(Exception):  # the first error is the one to report
            self._writer.close()

    def write(self, content: pa.RecordBatch) -> None:
        """Append rows."""
        self._held.append(content)
        self._held_rows += content.num_rows
        if self._held_rows >= ROWS_PER_GROUP:
            self._flush()

    def _flush(self) -> None:
        if self._held_rows:
            table = pa.Table.from_batches(self._held, self._schema)
            self._writer.write_table(table, row_group_size=ROWS_PER_GROUP)
        self._held, self._held_rows = [], 0


def _is_text(found: pa.DataType) -> bool:
    values = found.value_type if pa.types.is_dictionary(found) else found
    return bool(pa.types.is_string(values) or pa.types.is_large_string(values))
