"""Bounds of the memory that the values of a body take, from counts of its signs: known before any of it is read."""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

# Bytes that Python takes for what JSON writes with each of these signs, with all that it needs on the way, and for the
# text itself, whose characters take four bytes where one of them needs as many; a test measures that they suffice.
BYTES_OF_SIGNS = {",": 48, '"': 40, ":": 160, "[": 96, "{": 96}
# A number or a text in a column, its characters apart, and its part of the row that it comes from.
BYTES_OF_CELL = 120
SEPARATORS = ",;\t|\n"  # between the cells of a CSV text, whichever it uses
# Characters that are looked at in one go, some tens of microseconds: other threads wait for no longer.
PIECE = 1 << 16
BYTES_BY_SIGN = bytes(BYTES_OF_SIGNS.get(chr(sign), 0) for sign in range(256))
IS_SEPARATOR = bytes(chr(sign) in SEPARATORS for sign in range(256))


def bytes_of_json(text: bytes | bytearray) -> int:
    """Return a bound of the memory that the values of a JSON text take.

    Examples
    --------
    >>> bytes_of_json(b"[0.25, 0.5]") - 2 * len("[0.25, 0.5]")
    144
    """
    return 2 * _bytes_of_text(text) + _sum(text, BYTES_BY_SIGN)


def bytes_of_csv(text: bytes | bytearray) -> int:
    """Return a bound of the memory that a CSV text takes: once more as cells, a header that may be all of it apart."""
    return 4 * _bytes_of_text(text) + BYTES_OF_CELL * (1 + _sum(text, IS_SEPARATOR))


def _sum(text: bytes | bytearray, numbers: bytes) -> int:
    """Return the sum of a number for each byte of a text, of the 256 that `numbers` holds."""
    pieces = (text[start : start + PIECE].translate(numbers) for start in range(0, len(text), PIECE))
    return sum(int(np.frombuffer(piece, np.uint8).sum(dtype=np.int64)) for piece in pieces)


def _bytes_of_text(text: bytes | bytearray) -> int:
    return len(text) * (1 if text.isascii() else 4)


def bytes_of_table(table: pa.Table) -> int:
    """Return a bound of the memory that the cells of a table take as objects of Python."""
    return sum(BYTES_OF_CELL * len(column) + 4 * _characters(column) for column in table.columns)


def _characters(column: pa.ChunkedArray) -> int:
    """Return the bytes of a column's texts, those of a dictionary as often as they are cells."""
    count = 0
    for array in column.chunks:
        if pa.types.is_dictionary(array.type):
            lengths = pc.binary_length(array.dictionary).cast(pa.int64()).take(array.indices)
        elif pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
            lengths = pc.binary_length(array).cast(pa.int64())
        else:
            continue
        count += pc.sum(lengths).as_py() or 0
    return count
