"""Tables read in blocks of rows, never as a whole, by the reader of CSV or of Parquet files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import Protocol

import pyarrow as pa

from pricing_core.american.arrow.price_batch import unusual
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contents import Contents, contents_of, input_changed
from pricing_core.batch.csv_check import CsvCheck, check_csv
from pricing_core.batch.csv_reader import CsvReader
from pricing_core.batch.parquet_reader import ParquetReader
from pricing_core.batch.tables import TableFile, tables_of


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


def check_table(table: TableFile) -> Contents:
    """Read a file once, before any work: what is priced is what it holds now.

    Raises
    ------
    InvalidInputError
        It is a CSV file that cannot be read as a whole.
    OSError
        It cannot be read.
    """
    return check_csv(table) if table.format.kind == "csv" else contents_of(table.location)


def open_table(table: TableFile, check: Contents) -> TableReader:
    """Open a table and check its columns.

    Parameters
    ----------
    check : Contents
        What `check_table` has found; the file gives these bytes, or raises an InvalidInputError.

    Raises
    ------
    InvalidInputError
        A file that is not of its kind, or columns that the schema refuses.
    OSError
        The file cannot be read.
    """
    return CsvReader(table, check) if isinstance(check, CsvCheck) else ParquetReader(table, check)


def check_unchanged(location: str, stated: str | None, checks: Mapping[TableFile, Contents]) -> None:
    """Accept an input that still has the same files, and in them what `check_table` has found.

    Parameters
    ----------
    location, stated
        As of `tables_of`.

    Raises
    ------
    InvalidInputError
        It has changed.
    OSError
        It cannot be read any more.
    """
    before = {table.location: table.name for table in checks}
    now = {table.location: table.name for table in tables_of(location, stated)}
    for place in sorted(before.keys() ^ now.keys()):
        raise input_changed((before | now)[place])
    for table, check in checks.items():
        check.check_still_at(table.location, table.name)
