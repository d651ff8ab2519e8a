"""Tables read in blocks of rows, never as a whole, by the reader of CSV or of Parquet files."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Protocol

import pyarrow as pa

from pricing_core.american.arrow.price_batch import unusual
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_check import CsvCheck, check_csv
from pricing_core.batch.csv_reader import CsvReader
from pricing_core.batch.parquet_reader import ParquetReader
from pricing_core.batch.tables import TableFile


class Block(Protocol):
    """Consecutive rows, read already or not; picklable, so that another process may read them."""

    def read(self) -> Chunk:
        """Return the rows."""
        ...


class TableReader(Protocol):
    """A table open for reading, to be used as a context manager."""

    schema: pa.Schema  # without the columns of its partition
    may_hold_curves: bool  # whether a rate, a yield or a volatility may be something else than a number
    rows: int  # in a CSV file at most

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        ...

    def __enter__(self) -> TableReader: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def blocks(self, size: int | None = None) -> Iterator[Block]:
        """Yield all rows in order; the size of a block, in bytes of CSV and rows of Parquet, is chosen unless stated.

        The blocks depend on the file and the size alone.
        """
        ...


def unusual_columns_of(reader: TableReader, settings: PricingSettings) -> list[str]:
    """Return one sentence for each column whose first rows look as if they were in another unit; it reads a block."""
    for block in reader.blocks():
        return unusual(block.read().table, settings)
    return []


def open_table(table: TableFile, check: CsvCheck | None = None) -> TableReader:
    """Open a table and check its columns.

    Parameters
    ----------
    check : CsvCheck, optional
        What an earlier pass through the CSV file has found.

    Raises
    ------
    InvalidInputError
        A file that is not of its kind, or columns that the schema refuses.
    OSError
        The file cannot be read.
    """
    if table.format.kind == "parquet":
        return ParquetReader(table)
    return CsvReader(table, check or check_csv(table))
