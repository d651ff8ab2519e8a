"""Tables written chunk by chunk: missing cells are empty in CSV and null in Parquet."""

import json
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Protocol

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pricing_core.csv_text import CsvText, number_text
from pricing_core.errors import SHOWN_CHARACTERS, InvalidInputError

# Rows in a row group of a Parquet file; smaller groups cost space and reading time.
ROWS_PER_GROUP = 65_536


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
    """Return the writer for the ending of `path`, writing rows of `schema` to `file`.

    Raises
    ------
    InvalidInputError
        A CSV file cannot hold a column.
    """
    if path.suffix.lower() != ".csv":
        return ParquetWriter(file, schema)
    for field in schema:
        if not _has_text_form(field.type):
            allowed = "left out, or written to a .parquet file: a CSV cell cannot hold it"
            raise InvalidInputError(f"column {field.name}", str(field.type), allowed)
    return CsvWriter(file, schema.names)


class CsvWriter:
    """Writes chunks as CSV."""

    def __init__(self, file: BinaryIO, names: list[str]) -> None:
        self._text = CsvText(file, names)

    def __enter__(self) -> "CsvWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._text.__exit__(kind, error, trace)

    def write(self, table: pa.RecordBatch) -> None:
        """Append the rows of `table`."""
        self._text.write(zip(*map(_column_text, table.columns), strict=True))


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


class RejectsWriter(CsvText):
    """Writes one line per rejected row: line, field, value (cut at 40 characters), reason."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__(file, ["line", "field", "value", "reason"])

    def reject(self, line: int, field: str, value: str, reason: str) -> None:
        """Append one rejected row."""
        shown = value if len(value) <= SHOWN_CHARACTERS else value[: SHOWN_CHARACTERS - 3] + "..."
        self.write([[str(line), field, shown, reason]])


def _column_text(column: pa.Array) -> list[str]:
    """Return the cells as CSV text; a missing value or a NaN is empty."""
    if pa.types.is_floating(column.type):
        return [number_text(x) for x in column.to_pylist()]
    if pa.types.is_list(column.type) and pa.types.is_floating(column.type.value_type):
        return ["" if numbers is None else json.dumps(numbers) for numbers in column.to_pylist()]
    return [text or "" for text in pc.cast(column, pa.string()).to_pylist()]


def _has_text_form(found: pa.DataType) -> bool:
    """Tell text, numbers, flags and times from lists, structures and bytes."""
    if pa.types.is_list(found) and pa.types.is_floating(found.value_type):  # as JSON
        return True
    values = found.value_type if pa.types.is_dictionary(found) else found
    if "binary" in str(values):  # binary of any width; only some cells are text by chance
        return False
    try:
        pc.cast(pa.nulls(0, found), pa.string())
    except pa.ArrowNotImplementedError:
        return False
    return True
