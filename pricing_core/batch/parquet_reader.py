"""Parquet tables, read row group by row group."""

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import pyarrow as pa
import pyarrow.parquet as pq

from pricing_core.american.arrow.schema import check_names, check_types
from pricing_core.batch.chunk import Chunk
from pricing_core.errors import InvalidInputError


class ParquetReader:
    """A Parquet file; a row's place is its number, the first is 1.

    Raises
    ------
    InvalidInputError
        The file is not Parquet, or its columns are refused by name or type.
    """

    may_hold_curves = True

    def __init__(self, path: Path) -> None:
        self._name = path.name
        self._rows_read = 0
        try:
            self._file = pq.ParquetFile(path)
            self.schema: pa.Schema = self._file.schema_arrow
            names: list[str] = self.schema.names
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # the system's, which names the file
                raise
            raise InvalidInputError("input", path.name, "an undamaged Parquet file") from None
        try:
            check_names(names)
            check_types(self.schema)
        except InvalidInputError:
            self._file.close()
            raise

    def __enter__(self) -> "ParquetReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    @property
    def fraction_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        total: int = self._file.metadata.num_rows
        return self._rows_read / total if total else 1.0

    def chunks(self, rows: int) -> Iterator[Chunk]:
        """Yield chunks of at most `rows` rows, in order.

        Raises
        ------
        InvalidInputError
            A row group is damaged.
        """
        batches = self._file.iter_batches(batch_size=rows)
        while True:
            first = self._rows_read + 1
            try:
                table = next(batches, None)
                if table is not None:
                    table.validate(full=True)  # text that is not UTF-8 would fail only when it is looked at
            except (pa.ArrowException, OSError):
                allowed = f"an undamaged Parquet file; it cannot be read after row {self._rows_read}"
                raise InvalidInputError("input", self._name, allowed) from None
            if table is None:
                return
            self._rows_read += table.num_rows
            yield Chunk(range(first, first + table.num_rows), table)
