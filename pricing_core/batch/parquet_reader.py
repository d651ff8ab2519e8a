"""Parquet tables, read block by block."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pricing_core.american.arrow.plain_types import plain_schema
from pricing_core.american.arrow.schema import check_names, check_types
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contents import Contents, open_unchanged
from pricing_core.batch.tables import TableFile, check_width
from pricing_core.errors import InvalidInputError

# Rows of a block, at most, and at least where the input has so many.
LARGEST_BLOCK, SMALLEST_BLOCK = 65_536, 1_024
BLOCKS = 16  # in a small input, so that its blocks keep some threads busy
ROWS_PER_READ = 4_096
MOST_BYTES = 1 << 28  # of a block in memory
# A column of a row group that grows so much, to so many bytes, is no table of contracts.
LARGEST_COLUMN, LARGEST_GROWTH = 1 << 28, 1_000
LISTS = (pa.ListArray, pa.LargeListArray, pa.FixedSizeListArray)
MOST_VALUES = 1 << 26  # in a column of a row group, those in lists counted one by one


class ParquetReader:
    """A Parquet file; a row's place is its number, the first is 1.

    Raises
    ------
    InvalidInputError
        The file is not Parquet, or its columns are refused by name or type.
    """

    may_hold_curves = True

    def __init__(self, table: TableFile, contents: Contents) -> None:
        self._table = table
        self._bytes = open_unchanged(table.location, contents, table.name)
        try:
            self._file, self.schema = _opened(table, self._bytes)
            names: list[str] = self.schema.names
            self.rows: int = self._file.metadata.num_rows
            check_width(len(names))
            check_names([*names, *(name for name, _ in table.partition)])
            check_types(self.schema)
            _check_growth(table, self._file.metadata)
        except (InvalidInputError, OSError):
            self._bytes.close()
            raise

    def __enter__(self) -> ParquetReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._bytes.close()

    def blocks(self, size: int | None = None) -> Iterator[Chunk]:
        """Yield the rows in order, in blocks of `size` rows.

        Raises
        ------
        InvalidInputError
            A row group is damaged, or its rows need more memory than rows of contracts do.
        """
        size = size or self.block_rows
        held: list[pa.RecordBatch] = []
        held_rows = held_bytes = 0
        first = 0
        for batch in self._batches():
            start = 0
            while start < batch.num_rows:
                taken = batch.slice(start, size - held_rows)
                start += taken.num_rows
                held.append(taken)
                held_rows += taken.num_rows
                held_bytes += taken.nbytes + _text_bytes(taken)
                if held_rows == size:
                    yield self._chunk(held, first)
                    first += held_rows
                    held, held_rows, held_bytes = [], 0, 0
                elif held_bytes > MOST_BYTES:
                    raise self._too_large(size, first)
        if held:
            yield self._chunk(held, first)

    def _batches(self) -> Iterator[pa.RecordBatch]:
        """Yield all rows, few at a time, text as the file has it."""
        left = self.rows
        batches = self._file.iter_batches(batch_size=ROWS_PER_READ, use_threads=False)
        while left:
            try:
                batch = next(batches)
                batch.validate(full=True)  # text that is not UTF-8 would fail only when it is looked at
            except (pa.ArrowException, OSError, StopIteration) as error:
                if isinstance(error, OSError) and error.errno is not None:
                    raise
                allowed = f"an undamaged Parquet file; it cannot be read after row {self.rows - left}"
                raise InvalidInputError("input", self._table.name, allowed) from None
            if _text_bytes(batch) > MOST_BYTES:
                raise self._too_large(batch.num_rows, self.rows - left)
            left -= batch.num_rows
            yield batch.cast(self.schema)

    def _chunk(self, held: list[pa.RecordBatch], first: int) -> Chunk:
        batch = pa.concat_batches(held)
        for name, value in self._table.partition:
            kind = pa.float64() if isinstance(value, float) else pa.string()
            batch = batch.append_column(name, pa.repeat(pa.scalar(value, kind), batch.num_rows))
        return Chunk(range(first + 1, first + 1 + batch.num_rows), batch)

    def _too_large(self, size: int, first: int) -> InvalidInputError:
        allowed = (
            f"a table of which {size} rows fit in {MOST_BYTES >> 20} MiB; from row {first + 1} on they do not"
        )
        return InvalidInputError("input", self._table.name, allowed)

    @property
    def block_rows(self) -> int:
        """How many rows a block has."""
        return max(SMALLEST_BLOCK, min(LARGEST_BLOCK, -(-self.rows // BLOCKS)))


def _opened(table: TableFile, place: BinaryIO) -> tuple[Any, pa.Schema]:
    """Open a Parquet file so that a row group is never held as a whole, and return it with its columns.

    Text is read as numbers of the values in a dictionary, and no longer than the file has it: a long value that stands
    in many rows is there once until its size is known.

    Raises
    ------
    InvalidInputError
        The file is not Parquet.
    """
    try:
        with pq.ParquetFile(place, pre_buffer=False) as plain:
            metadata, schema = plain.metadata, plain.schema_arrow
            leaves = [plain.schema.column(k) for k in range(len(plain.schema))]
        texts = [leaf.path for leaf in leaves if _is_text(leaf)]
        file = pq.ParquetFile(
            place, metadata=metadata, read_dictionary=texts, pre_buffer=False, buffer_size=1 << 20
        )
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # the system's, which names the file
            raise
        raise InvalidInputError("input", table.name, "an undamaged Parquet file") from None
    return file, plain_schema(schema)


def _is_text(leaf: Any) -> bool:
    return bool(leaf.physical_type == "BYTE_ARRAY" and leaf.logical_type.type != "DECIMAL")


def _text_bytes(found: pa.RecordBatch | pa.Array) -> int:
    """Return how many bytes the values of dictionaries take when each row has its own."""
    if isinstance(found, pa.RecordBatch):
        return sum(_text_bytes(column) for column in found.columns)
    if isinstance(found, pa.DictionaryArray):
        lengths = pc.binary_length(found.dictionary)
        return pc.sum(pc.cast(lengths, pa.int64()).take(found.indices)).as_py() or 0
    if isinstance(found, pa.MapArray):
        return _text_bytes(found.keys) + _text_bytes(found.items)
    if isinstance(found, pa.StructArray):
        return sum(_text_bytes(column) for column in found.flatten())
    return _text_bytes(found.flatten()) if isinstance(found, LISTS) else 0


def _check_growth(table: TableFile, metadata: Any) -> None:
    """Refuse what its sizes tell to be no table of contracts.

    Raises
    ------
    InvalidInputError
        A column of a row group grows to too many bytes, or has too many values in its lists.
    """
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for column in range(metadata.num_columns):
            found = group.column(column)
            size = found.total_uncompressed_size
            grows = size > LARGEST_COLUMN and size > LARGEST_GROWTH * found.total_compressed_size
            if grows or found.num_values > MOST_VALUES:
                amount = f"{size >> 20} MiB" if grows else f"{found.num_values} values"
                allowed = f"a table of contracts; {found.path_in_schema} grows to {amount} in one row group"
                raise InvalidInputError("input", table.name, allowed)
