"""CSV tables, cut into blocks of whole records; each cell is checked by itself, as text.

A block is parsed by Arrow where each of its quotes is one of two around a whole cell, within a line. Where there is any
other quote, or a line that does not fit the header, the standard library's reader takes over for that block: it knows
on which physical line every record starts, blank lines and quoted newlines included, and it goes on behind a malformed
line.
"""

from __future__ import annotations

import csv
import io
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from pricing_core.american.arrow.schema import check_names
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_check import LONGEST_LINE, CsvCheck, no_line, plain_bytes
from pricing_core.batch.tables import TableFile, check_width
from pricing_core.errors import InvalidInputError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# Characters; a bound, because a quote left open makes one cell of the rest of the file.
LONGEST_CELL = 1 << 24
BEFORE_CELL, BEHIND_CELL = np.frombuffer(b",\n", np.uint8), np.frombuffer(b",\r\n", np.uint8)
# Bytes of a block, about: at most, and at least where the input has so many.
LARGEST_BLOCK, SMALLEST_BLOCK = 1 << 22, 1 << 16
BLOCKS = 16  # in a small input, so that its blocks keep some threads busy


@dataclass(frozen=True, slots=True)
class CsvBlock:
    """Whole lines without a quote but those around whole cells, not parsed yet; picklable."""

    first_line: int
    content: bytes
    names: tuple[str, ...]

    def read(self) -> Chunk:
        """Return the rows."""
        lines = self.content.count(b"\n") + (not self.content.endswith(b"\n"))
        keys = [str(place) for place in range(len(self.names))]
        try:
            table = pa_csv.read_csv(
                pa.py_buffer(self.content),
                pa_csv.ReadOptions(use_threads=False, block_size=len(self.content) + 1, column_names=keys),
                pa_csv.ParseOptions(quote_char='"' if b'"' in self.content else False, double_quote=False),
                pa_csv.ConvertOptions(
                    column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False, check_utf8=False
                ),
            )
        except pa.ArrowInvalid:  # a line of more or fewer cells
            return self._checked_line_by_line()
        if table.num_rows != lines:  # blank ones
            return self._checked_line_by_line()
        columns = [column.combine_chunks() for column in table.columns]
        batch = pa.RecordBatch.from_arrays(columns, schema=text_schema(self.names))
        return Chunk(range(self.first_line, self.first_line + lines), batch)

    def _checked_line_by_line(self) -> Chunk:
        return Records(Lines(self.content), self.first_line, "input").chunk(self.names)


def _needs_records(content: bytes) -> bool:
    """Tell whether a quote is anything else than one of two around a whole cell, or such a cell may be too long."""
    if b'"' not in content:
        return False
    return len(content) > LONGEST_CELL or not _quotes_whole_cells(content)


def _quotes_whole_cells(content: bytes) -> bool:
    """Tell whether the quotes come in pairs, each around all that a line has between two commas."""
    letters = np.frombuffer(b"\n" + content + b"\n", np.uint8)
    quotes = np.flatnonzero(letters == ord('"'))
    if quotes.size % 2:
        return False
    opening, closing = quotes[::2], quotes[1::2]
    before, behind = letters[opening - 1], letters[closing + 1]
    if not np.isin(before, BEFORE_CELL).all() or not np.isin(behind, BEHIND_CELL).all():
        return False
    ends = np.flatnonzero((letters == ord("\r")) | (letters == ord("\n")))
    return np.array_equal(np.searchsorted(ends, opening), np.searchsorted(ends, closing))


class Lines:
    """The lines of a block of text, and those after it that are asked for.

    Parameters
    ----------
    block : bytes
        Whole lines.
    more : callable
        Returns the line behind them, b"" at the end of the file.
    """

    def __init__(self, block: bytes, more: Callable[[], bytes] = bytes) -> None:
        self._left = deque(_lines(block))
        self._more = more
        self.last = ""

    @property
    def left(self) -> str:
        """What has been read from the file and not been asked for."""
        return "".join(self._left)

    def __bool__(self) -> bool:
        """Tell whether there is more of what has been read."""
        return bool(self._left)

    def __iter__(self) -> Iterator[str]:
        while self._left or self._extended():
            self.last = self._left.popleft()
            yield self.last

    def _extended(self) -> bool:
        self._left.extend(_lines(self._more()))
        return bool(self._left)


def _lines(block: bytes) -> Iterator[str]:
    """Return the lines of a text with their endings, which may be carriage returns alone."""
    return iter(io.StringIO(block.decode(), newline=""))


class Records:
    """The records of some lines, by the standard library's reader.

    Parameters
    ----------
    lines : Lines
    first_line : int
        The number of the first of them.
    name : str
        What messages call the file.
    """

    def __init__(self, lines: Lines, first_line: int, name: str) -> None:
        self._lines, self._first_line, self._name = lines, first_line, name
        # The limit is that of the whole process: there is no other.
        csv.field_size_limit(max(LONGEST_CELL, csv.field_size_limit()))
        # Strict: text after a closing quote is an error of its line rather than a silent guess.
        self._rows = csv.reader(lines, strict=True)

    @property
    def line(self) -> int:
        """The number of the line behind the records read so far."""
        return self._first_line + self._rows.line_num

    def header(self) -> list[str] | None:
        """Return the first record with a cell, None if there is none.

        Raises
        ------
        InvalidInputError
            It is not CSV.
        """
        try:
            return next((row for row in self._rows if row), None)
        except csv.Error as error:
            raise InvalidInputError("input", self._name, f"a CSV file; in its header: {error}") from None

    def chunk(self, names: tuple[str, ...]) -> Chunk:
        """Return the records of the block; the last one may end behind it.

        Raises
        ------
        InvalidInputError
            A quote is left open: the lines behind it cannot be told apart.
        """
        lines: list[int] = []
        cells: list[list[str]] = []
        malformed: dict[int, InvalidInputError] = {}
        while self._lines:
            line = self.line
            try:
                row = next(self._rows)
            except csv.Error as error:
                malformed[len(lines)] = self._fault(line, error)
                row = self._lines.last.strip().split(",")
            else:
                if not row:  # a blank line
                    continue
                if len(row) != len(names):
                    allowed = f"a line of {len(names)} cells, as the header; it has {len(row)}"
                    malformed[len(lines)] = InvalidInputError("", ",".join(row), allowed)
            lines.append(line)
            # Cut or filled up, so that the record keeps its place in the output.
            cells.append((row + [""] * (len(names) - len(row)))[: len(names)])
        columns = [[row[place] for row in cells] for place in range(len(names))]
        arrays = [pa.array(column, pa.string()) for column in columns]
        return Chunk(lines, pa.RecordBatch.from_arrays(arrays, schema=text_schema(names)), malformed)

    def _fault(self, line: int, error: csv.Error) -> InvalidInputError:
        """Return the fault of a line, or raise where the record has run over its end."""
        if self.line > line + 1:
            allowed = f"a CSV file; a quoted cell that starts in line {line} is not closed properly"
            raise InvalidInputError("input", self._name, allowed)
        return InvalidInputError("", self._lines.last.strip(), f"a line of CSV: {error}")


def text_schema(names: tuple[str, ...]) -> pa.Schema:
    """Return a schema in which every column is text."""
    return pa.schema([(name, pa.string()) for name in names])


class CsvReader:
    """A CSV file: UTF-8 with or without a byte order mark, any line ending, quoted cells as in RFC 4180.

    Raises
    ------
    InvalidInputError
        The file has no header, or its columns are refused by name.
    """

    def __init__(self, table: TableFile, check: CsvCheck) -> None:
        self.may_hold_curves = check.mentions_curves
        self.rows = max(check.lines - 1, 0)
        size = max(SMALLEST_BLOCK, min(LARGEST_BLOCK, check.size // BLOCKS))
        self._name, self._block_size = table.name, size
        self._file = plain_bytes(table, check)
        self._begun = b""  # read, but not used yet
        self._line = 1
        try:
            self._names = self._read_header()
        except InvalidInputError:
            self._file.close()
            raise
        self.schema = text_schema(self._names)

    def __enter__(self) -> CsvReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def blocks(self, size: int | None = None) -> Iterator[CsvBlock | Chunk]:
        """Yield the rows in order, in blocks of about `size` bytes.

        Raises
        ------
        InvalidInputError
            A quote is left open: the lines behind it cannot be told apart.
        """
        size = size or self._block_size
        while content := self._next_lines(size):
            if _needs_records(content) or content.count(b"\r") != content.count(b"\r\n"):
                records = Records(Lines(content, self._next_line), self._line, self._name)
                yield records.chunk(self._names)
                self._line = records.line
            else:
                yield CsvBlock(self._line, content, self._names)
                self._line += content.count(b"\n")

    def _next_lines(self, size: int) -> bytes:
        begun, self._begun = self._begun, b""
        content = begun + self._file.read(size)
        return content if content.endswith(b"\n") or not content else content + self._next_line()

    def _next_line(self) -> bytes:
        line = self._file.readline(LONGEST_LINE)
        if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
            raise no_line(self._name, self._line)
        return line

    def _read_header(self) -> tuple[str, ...]:
        first = self._next_line().removeprefix(BYTE_ORDER_MARK)
        lines = Lines(first, self._next_line)
        records = Records(lines, self._line, self._name)
        header = records.header()
        if header is None:
            raise InvalidInputError("input", self._name, "a CSV file that names its columns; it is empty")
        self._line, self._begun = records.line, lines.left.encode()
        names = tuple(name.strip() for name in header)
        if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
            raise InvalidInputError("input", self._name, "separated by commas")
        check_width(len(names))
        check_names(names)
        return names
