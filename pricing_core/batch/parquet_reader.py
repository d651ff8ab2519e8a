"""Parquet tables, read block by block."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pricing_core.american.arrow.schema import check_names, check_types
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_check import digest_of
from pricing_core.batch.locations import is_remote, open_binary
from pricing_core.batch.tables import TableFile, check_width
from pricing_core.errors import InvalidInputError

# Rows of a block, at most, and at least where the input has so many.
LARGEST_BLOCK, SMALLEST_BLOCK = 65_536, 1_024
BLOCKS = 16  # in a small input, so that its blocks keep some threads busy
ROWS_PER_READ = 4_096
MOST_BYTES = 1 << 28  # of a block in memory
# A column of a row group that grows so much, to so many bytes, is no table of contracts.
LARGEST_COLUMN, LARGEST_GROWTH = 1 << 28, 1_000


@dataclass(frozen=True, slots=True)
class ParquetBlock:
    """Consecutive rows of a Parquet file, not read yet; picklable.

    Parameters
    ----------
    first : int
        Number of the first row, from 0.
    """

    table: TableFile
    first: int
    rows: int

    def read(self) -> Chunk:
        """Return the rows, whichever row groups they lie in."""
        with opened(self.table) as file:
            (chunk,) = _blocks(self.table, file, self.rows, self.first, self.first + self.rows)
        return chunk


class ParquetReader:
    """A Parquet file; a row's place is its number, the first is 1.

    Raises
    ------
    InvalidInputError
        The file is not Parquet, or its columns are refused by name or type.
    """

    may_hold_curves = True

    def __init__(self, table: TableFile) -> None:
        self._table = table
        self._file = opened(table)
        try:
            self.schema: pa.Schema = self._file.schema_arrow
            names: list[str] = self.schema.names
            self.rows: int = self._file.metadata.num_rows
            check_width(len(names))
            check_names([*names, *(name for name, _ in table.partition)])
            check_types(self.schema)
            _check_growth(table, self._file.metadata)
        except (pa.ArrowException, UnicodeDecodeError):
            self._file.close()
            raise _damaged(table) from None
        except InvalidInputError:
            self._file.close()
            raise

    def __enter__(self) -> "ParquetReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def blocks(self, size: int | None = None) -> Iterator[Chunk]:
        """Yield the rows in order, in blocks of `size` rows.

        Raises
        ------
        InvalidInputError
            A row group is damaged, or its rows need more memory than rows of contracts do.
        """
        return _blocks(self._table, self._file, size or self.block_rows, 0, self.rows)

    @property
    def digest(self) -> str:
        """SHA-256 of the file, which is read for it."""
        return digest_of(self._table.location)

    @property
    def block_rows(self) -> int:
        """How many rows a block has."""
        return max(SMALLEST_BLOCK, min(LARGEST_BLOCK, -(-self.rows // BLOCKS)))


def opened(table: TableFile) -> Any:
    """Open a Parquet file so that a row group is never held as a whole.

    Raises
    ------
    InvalidInputError
        The file is not Parquet.
    """
    place = open_binary(table.location) if is_remote(table.location) else table.location
    try:
        return pq.ParquetFile(place, pre_buffer=False, buffer_size=1 << 20)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # the system's, which names the file
            raise
        raise _damaged(table) from None


def _blocks(table: TableFile, file: Any, size: int, start: int, end: int) -> Iterator[Chunk]:
    held: list[pa.RecordBatch] = []
    held_rows = held_bytes = 0
    first = start
    for batch in _batches(table, file, start, end):
        rest = batch
        while rest.num_rows:
            taken = rest.slice(0, size - held_rows)
            rest = rest.slice(taken.num_rows)
            held.append(taken)
            held_rows += taken.num_rows
            held_bytes += taken.nbytes
            if held_rows == size:
                yield _chunk(table, held, first)
                first += held_rows
                held, held_rows, held_bytes = [], 0, 0
            elif held_bytes > MOST_BYTES:
                least = f"of which {size} rows fit in {MOST_BYTES >> 20} MiB"
                allowed = f"a table {least}; from row {first + 1} on they do not"
                raise InvalidInputError("input", table.name, allowed)
    if held:
        yield _chunk(table, held, first)


def _chunk(table: TableFile, held: list[pa.RecordBatch], first: int) -> Chunk:
    batch = pa.concat_batches(held)
    for name, value in table.partition:
        kind = pa.float64() if isinstance(value, float) else pa.string()
        batch = batch.append_column(name, pa.repeat(pa.scalar(value, kind), batch.num_rows))
    return Chunk(range(first + 1, first + 1 + batch.num_rows), batch)


def _batches(table: TableFile, file: Any, start: int, end: int) -> Iterator[pa.RecordBatch]:
    """Yield the rows from `start` to `end` in batches; row groups before and behind them are not touched."""
    groups: list[int] = []
    row = skipped = 0
    for group in range(file.metadata.num_row_groups):
        rows = file.metadata.row_group(group).num_rows
        if row < end and row + rows > start:
            skipped = skipped if groups else start - row
            groups.append(group)
        row += rows
    left = end - start
    batches = file.iter_batches(batch_size=ROWS_PER_READ, row_groups=groups, use_threads=False)
    while left:
        try:
            batch = next(batches)
            batch.validate(full=True)  # text that is not UTF-8 would fail only when it is looked at
        except (pa.ArrowException, OSError, StopIteration) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            allowed = f"an undamaged Parquet file; it cannot be read after row {end - left}"
            raise InvalidInputError("input", table.name, allowed) from None
        passed = min(skipped, batch.num_rows)
        skipped -= passed
        wanted = batch.slice(passed, left)
        left -= wanted.num_rows
        yield wanted


def _check_growth(table: TableFile, metadata: Any) -> None:
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        if group.total_byte_size <= LARGEST_COLUMN:
            continue
        for column in range(metadata.num_columns):
            found = group.column(column)
            size = found.total_uncompressed_size
            if size > LARGEST_COLUMN and size > LARGEST_GROWTH * found.total_compressed_size:
                allowed = (
                    f"a table of contracts; {found.path_in_schema} grows to {size >> 20} MiB in one row group"
                )
                raise InvalidInputError("input", table.name, allowed)


def _damaged(table: TableFile) -> InvalidInputError:
    return InvalidInputError("input", table.name, "an undamaged Parquet file")
