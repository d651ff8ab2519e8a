"""One pass through a CSV file before any work, which finds in a second what would end an hour of pricing."""

from __future__ import annotations

import codecs
import io
from dataclasses import dataclass
from typing import Any, BinaryIO, cast

import pyarrow as pa

from pricing_core.batch.contents import BYTES_PER_READ, Contents, Recorder, open_unchanged, stamp_of
from pricing_core.batch.locations import open_binary
from pricing_core.batch.tables import TableFile
from pricing_core.errors import InvalidInputError

LONGEST_LINE = 1 << 26  # bytes; a bound, because a file without line endings is one line
# Key that every curve has, its quotes doubled inside a quoted cell or not.
CURVE_KEY = b'"times"'


@dataclass(frozen=True, slots=True)
class CsvCheck(Contents):
    """What the pass found out of the file, and of the text in it.

    Parameters
    ----------
    size : int
        Bytes of text.
    lines : int
        At most.
    mentions_curves : bool
    """

    size: int
    lines: int
    mentions_curves: bool


class TextCheck:
    """Takes text block by block, and refuses what is not UTF-8 or has a line that does not end.

    Parameters
    ----------
    name : str
        What messages call the file.
    """

    def __init__(self, name: str) -> None:
        self._name, self._decoder = name, codecs.getincrementaldecoder("utf-8")()
        self._newlines = self._returns = self._since_newline = 0
        self._tail = b""
        self.size, self.mentions_curves = 0, False

    @property
    def lines(self) -> int:
        """How many lines have begun, at most, whatever ends them."""
        return max(self._newlines, self._returns) + bool(self._since_newline)

    def feed(self, block: bytes) -> None:
        """Take the next block.

        Raises
        ------
        InvalidInputError
            It is not UTF-8, or a line is longer than 64 MiB.
        """
        self._decode(block, final=False)
        last = block.rfind(b"\n")
        self._since_newline = self._since_newline + len(block) if last < 0 else len(block) - last - 1
        self._newlines += block.count(b"\n")
        self._returns += block.count(b"\r")
        self.size += len(block)
        if self._since_newline > LONGEST_LINE:
            raise no_line(self._name, self._newlines + 1)
        seam = self._tail + block[: len(CURVE_KEY)]
        self.mentions_curves = self.mentions_curves or CURVE_KEY in seam or CURVE_KEY in block
        self._tail = (self._tail + block[1 - len(CURVE_KEY) :])[1 - len(CURVE_KEY) :]

    def end(self) -> None:
        """Accept the end of the text where it is.

        Raises
        ------
        InvalidInputError
            It ends within a character.
        """
        self._decode(b"", final=True)

    def _decode(self, block: bytes, *, final: bool) -> None:
        try:
            self._decoder.decode(block, final)
        except UnicodeDecodeError as error:
            line = self._newlines + bytes(error.object[: error.start]).count(b"\n") + 1
            raise InvalidInputError("input", self._name, f"UTF-8 text; line {line} is not") from None


def no_line(name: str, line: int) -> InvalidInputError:
    """Return the fault of a line that does not end."""
    return InvalidInputError(
        "input", name, f"a CSV file; line {line} has more than {LONGEST_LINE >> 20} MiB without an end"
    )


def check_csv(table: TableFile) -> CsvCheck:
    """Read the file once.

    Raises
    ------
    InvalidInputError
        It is not UTF-8, has a line that does not end, or is damaged where it is compressed.
    """
    text, stamp = TextCheck(table.name), stamp_of(table.location)
    with open_binary(table.location) as raw:
        recorder = Recorder(raw, stamp)
        with _decompressed(recorder, table) as plain:
            while block := _read(plain, table):
                text.feed(block)
            text.end()
        found = recorder.contents()  # with what may lie behind the compressed text
    return CsvCheck(
        found.digest,
        found.blocks,
        found.file_size,
        found.stamp,
        text.size,
        text.lines,
        text.mentions_curves,
    )


def plain_bytes(table: TableFile, check: CsvCheck) -> BinaryIO:
    """Open a CSV file for reading, decompressed; it gives what the check has found, or raises."""
    raw = open_unchanged(table.location, check, table.name)
    return io.BufferedReader(_decompressed(raw, table), BYTES_PER_READ)


def _decompressed(raw: Any, table: TableFile) -> Any:
    if table.format.compression is None:
        return raw
    return pa.CompressedInputStream(pa.PythonFile(raw, mode="r"), table.format.compression)


def _read(plain: Any, table: TableFile) -> bytes:
    try:
        return cast("bytes", plain.read(BYTES_PER_READ))
    except OSError as error:
        if error.errno is not None:
            raise
        allowed = f"an undamaged {table.format.compression} file ({error})"
        raise InvalidInputError("input", table.name, allowed) from None
