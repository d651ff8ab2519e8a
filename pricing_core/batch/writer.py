"""Tables written chunk by chunk: CSV with missing numbers as empty cells, Parquet with them as NaN."""

import csv
import io
import math
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Protocol

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pricing_core.errors import SHOWN_CHARACTERS, InvalidInputError

ROWS_PER_GROUP = 65_536  # of a Parquet file; smaller groups cost space and reading time


class TableWriter(Protocol):
    """Appends chunks to a table; leaving the `with` block completes it, the file itself stays open."""

    def __enter__(self) -> "TableWriter": ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def write(self, table: pa.RecordBatch) -> None:
        """Append the rows of `table`."""
        ...


def check_ending(path: Path) -> None:
    """Accept a name that ends in .csv or .parquet.

    Raises
    ------
    InvalidInputError
        Any other ending.
    """
    if path.suffix.lower() not in (".csv", ".parquet"):
        raise InvalidInputError("output", path.name, "a .csv or .parquet file")


def table_writer(path: Path, file: BinaryIO, schema: pa.Schema) -> TableWriter:
    """Return the writer for the ending of `path`, writing rows of `schema` to `file`."""
    return CsvWriter(file, schema.names) if path.suffix.lower() == ".csv" else ParquetWriter(file, schema)


class CsvWriter:
    """Writes UTF-8 CSV with a header and shortest round-trip numbers."""

    def __init__(self, file: BinaryIO, names: list[str]) -> None:
        self._text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        self._rows = csv.writer(self._text, lineterminator="\n")
        self._rows.writerow(names)

    def __enter__(self) -> "CsvWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._text.detach()

    def write(self, table: pa.RecordBatch) -> None:
        """Append the rows of `table`."""
        columns = [_column_text(column) for column in table.columns]
        self._rows.writerows(zip(*columns, strict=True))


class ParquetWriter:
    """Writes Parquet in row groups of 65,536 rows."""

    def __init__(self, file: BinaryIO, schema: pa.Schema) -> None:
        self._schema = schema
        self._writer = pq.ParquetWriter(file, schema)
        self._held: list[pa.RecordBatch] = []
        self._held_rows = 0

    def __enter__(self) -> "ParquetWriter":
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

    def write(self, table: pa.RecordBatch) -> None:
        """Append the rows of `table`."""
        self._held.append(table)
        self._held_rows += table.num_rows
        if self._held_rows >= ROWS_PER_GROUP:
            self._flush()

    def _flush(self) -> None:
        if self._held_rows:
            self._writer.write_table(
                pa.Table.from_batches(self._held, self._schema), row_group_size=ROWS_PER_GROUP
            )
        self._held, self._held_rows = [], 0


class RejectsWriter:
    """Writes one line per rejected row: line, field, value (cut at 40 characters), reason."""

    def __init__(self, file: BinaryIO) -> None:
        self._csv = CsvWriter(file, ["line", "field", "value", "reason"])

    def __enter__(self) -> "RejectsWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._csv.__exit__(kind, error, trace)

    def write(self, line: int, field: str, value: str, reason: str) -> None:
        """Append one rejected row."""
        shown = value if len(value) <= SHOWN_CHARACTERS else value[: SHOWN_CHARACTERS - 3] + "..."
        cells = ([str(line)], [field], [shown], [reason])
        self._csv.write(pa.RecordBatch.from_arrays([pa.array(cell) for cell in cells], ["", "", "", ""]))


def _column_text(column: pa.Array) -> list[str]:
    """Return the cells as CSV text; a missing value or a NaN is empty."""
    if pa.types.is_floating(column.type):
        return ["" if x is None or math.isnan(x) else repr(x) for x in column.to_pylist()]
    try:
        texts = pc.cast(column, pa.string()).to_pylist()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):  # lists, structures, bytes
        texts = [None if x is None else str(x) for x in column.to_pylist()]
    return [text or "" for text in texts]
