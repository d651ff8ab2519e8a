"""CSV tables, read as text: each cell is checked by itself, so a bad one rejects its own row and no other.

The standard library's reader rather than a columnar one: it knows on which physical line every record starts,
blank lines and quoted newlines included, and it goes on behind a malformed line.
"""

import codecs
import csv
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import pyarrow as pa

from pricing_core.american.arrow.schema import check_names
from pricing_core.batch.chunk import Chunk
from pricing_core.errors import InvalidInputError

BYTES_PER_READ = 1 << 20
# Key that every curve has, its quotes doubled inside a quoted cell or not.
CURVE_KEY = b'"times"'
LONGEST_CELL = (
    1 << 24
)  # characters; a bound, because a quote left open makes one cell of the rest of the file


class CsvReader:
    """A CSV file: UTF-8 with or without a byte order mark, any line ending, quoted cells as in RFC 4180.

    Raises
    ------
    InvalidInputError
        The file is not UTF-8, has no header, or its columns are refused by name.
    """

    def __init__(self, path: Path) -> None:
        check_text(path)
        self.may_hold_curves = mentions(path, CURVE_KEY)
        self._name = path.name
        self._size = path.stat().st_size
        self._bytes_read = 0
        self._last_line = ""
        self._file = path.open(encoding="utf-8-sig", newline="")
        # The limit is that of the whole process: there is no other.
        csv.field_size_limit(max(LONGEST_CELL, csv.field_size_limit()))
        # Strict: text after a closing quote is an error of its line rather than a silent guess.
        self._rows = csv.reader(self._remembered_lines(), strict=True)
        try:
            self.schema = self._read_header()
        except InvalidInputError:
            self._file.close()
            raise

    def __enter__(self) -> "CsvReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    @property
    def fraction_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        return min(self._bytes_read / self._size, 1.0) if self._size else 1.0

    def chunks(self, rows: int) -> Iterator[Chunk]:
        """Yield chunks of at most `rows` rows, in order.

        Raises
        ------
        InvalidInputError
            A quote is left open: the lines behind it cannot be told apart.
        """
        lines: list[int] = []
        cells: list[list[str]] = []
        malformed: dict[int, InvalidInputError] = {}
        for line, row, fault in self._records():
            if fault is not None:
                malformed[len(lines)] = fault
            lines.append(line)
            cells.append(row)
            if len(lines) == rows:
                yield Chunk(lines, self._table(cells), malformed)
                lines, cells, malformed = [], [], {}
        if lines:
            yield Chunk(lines, self._table(cells), malformed)

    def _read_header(self) -> pa.Schema:
        try:
            header = next((row for row in self._rows if row), None)
        except csv.Error as error:
            raise InvalidInputError("input", self._name, f"a CSV file; in its header: {error}") from None
        if header is None:
            raise InvalidInputError("input", self._name, "a CSV file that names its columns; it is empty")
        names = [name.strip() for name in header]
        if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
            raise InvalidInputError("input", self._name, "separated by commas")
        check_names(names)
        return pa.schema([(name, pa.string()) for name in names])

    def _records(self) -> Iterator[tuple[int, list[str], InvalidInputError | None]]:
        """Yield (line, cells, fault), blank lines left out, every row with as many cells as the header."""
        width = len(self.schema)
        while True:
            line = self._rows.line_num + 1
            try:
                row = next(self._rows)
            except StopIteration:
                return
            except csv.Error as error:
                yield line, _fitted(self._last_line.strip().split(","), width), self._malformed(line, error)
                continue
            if len(row) == width:
                yield line, row, None
            elif row:
                allowed = f"a line of {width} cells, as the header; it has {len(row)}"
                yield line, _fitted(row, width), InvalidInputError("", ",".join(row), allowed)

    def _malformed(self, line: int, error: csv.Error) -> InvalidInputError:
        """Return the fault of a line, or raise where the record has run over its end."""
        if self._rows.line_num > line:
            allowed = f"a CSV file; a quoted cell that starts in line {line} is not closed properly"
            raise InvalidInputError("input", self._name, allowed)
        return InvalidInputError("", self._last_line.strip(), f"a line of CSV: {error}")

    def _remembered_lines(self) -> Iterator[str]:
        for line in self._file:
            self._last_line = line
            self._bytes_read += len(line)  # exact for ASCII, and only a progress bar depends on it
            yield line

    def _table(self, cells: list[list[str]]) -> pa.RecordBatch:
        columns = [pa.array(column, pa.string()) for column in zip(*cells, strict=True)]
        return pa.RecordBatch.from_arrays(columns, schema=self.schema)


def _fitted(row: list[str], width: int) -> list[str]:
    """Return the row cut or filled up to `width` cells, so that it keeps its place in the output."""
    return (row + [""] * width)[:width]


def check_text(path: Path) -> None:
    """Read the file once as UTF-8, so that a bad byte at its end is found before an hour of pricing.

    Raises
    ------
    InvalidInputError
        It is not UTF-8.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    line = 1
    with path.open("rb") as file:
        try:
            while block := file.read(BYTES_PER_READ):
                decoder.decode(block)
                line += block.count(b"\n")
            decoder.decode(b"", final=True)
        except UnicodeDecodeError as error:
            line += bytes(error.object[: error.start]).count(b"\n")
            raise InvalidInputError("input", path.name, f"UTF-8 text; line {line} is not") from None


def mentions(path: Path, word: bytes) -> bool:
    """Tell whether a file holds a word."""
    before = b""
    with path.open("rb") as file:
        while block := file.read(BYTES_PER_READ):
            if word in before + block:
                return True
            before = block[1 - len(word) :]
    return False
