"""One pass through a CSV file before any work, which finds in a second what would end an hour of pricing."""

from __future__ import annotations

import codecs
import hashlib
import io
from dataclasses import dataclass
from typing import Any, BinaryIO, cast

import pyarrow as pa

from pricing_core.batch.locations import open_binary
from pricing_core.batch.tables import TableFile
from pricing_core.errors import InvalidInputError

BYTES_PER_READ = 1 << 20
LONGEST_LINE = 1 << 26  # bytes; a bound, because a file without line endings is one line
# Key that every curve has, its quotes doubled inside a quoted cell or not.
CURVE_KEY = b'"times"'


@dataclass(frozen=True, slots=True)
class CsvCheck:
    """What the pass found out of the file.

    Parameters
    ----------
    digest : str
        SHA-256 of the file as it lies there.
    size : int
        Bytes of text.
    lines : int
        At most.
    mentions_curves : bool
    """

    digest: str
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
    text = TextCheck(table.name)
    with open_binary(table.location) as raw:
        hashed = _Hashed(raw)
        with _decompressed(hashed, table) as plain:
            while block := _read(plain, table):
                text.feed(block)
            text.end()
        while hashed.read(BYTES_PER_READ):  # what may lie behind the compressed text
            pass
        return CsvCheck(hashed.digest(), text.size, text.lines, text.mentions_curves)


def plain_bytes(table: TableFile) -> BinaryIO:
    """Open a CSV file for reading, decompressed."""
    return io.BufferedReader(_decompressed(open_binary(table.location), table), BYTES_PER_READ)


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


class _Hashed:
    """Passes on what is read, and remembers its hash."""

    closed = False

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._hash = file, hashlib.sha256()

    def __enter__(self) -> _Hashed:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the file to the one who opened it."""

    def read(self, size: int = -1) -> bytes:
        block = self._file.read(size)
        self._hash.update(block)
        return block

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        """Leave the file to the one who opened it."""

    def digest(self) -> str:
        return self._hash.hexdigest()


def digest_of(location: str) -> str:
    """Return the SHA-256 of a file."""
    with open_binary(location) as file:
        hashed = _Hashed(file)
        while hashed.read(BYTES_PER_READ):
            pass
        return hashed.digest()
