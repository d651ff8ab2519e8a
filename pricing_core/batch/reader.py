"""Tables read in chunks of rows, never as a whole, by the reader of CSV or of Parquet files."""

import stat
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Protocol

import pyarrow as pa

from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_reader import CsvReader
from pricing_core.batch.parquet_reader import ParquetReader
from pricing_core.errors import InvalidInputError


class TableReader(Protocol):
    """A table open for reading, to be used as a context manager."""

    schema: pa.Schema
    may_hold_curves: bool  # whether a rate, a yield or a volatility may be something else than a number

    def __enter__(self) -> "TableReader": ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def chunks(self, rows: int) -> Iterator[Chunk]:
        """Yield chunks of at most `rows` rows, in order."""
        ...

    @property
    def fraction_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        ...


def open_table(path: Path) -> TableReader:
    """Open a table by the ending of its name and check its columns.

    Raises
    ------
    InvalidInputError
        Another ending, not a regular file, a file that is not of its kind, or columns that the schema refuses.
    OSError
        The file cannot be read.
    """
    if not stat.S_ISREG(path.stat().st_mode):  # a pipe cannot be read twice, nor a Parquet file backwards
        raise InvalidInputError("input", path.name, "a regular file")
    kind = path.suffix.lower()
    if kind == ".csv":
        return CsvReader(path)
    if kind == ".parquet":
        return ParquetReader(path)
    raise InvalidInputError("input", path.name, "a .csv or .parquet file")
