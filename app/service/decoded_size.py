"""Bounds of the memory that the values of a body take, from counts of its signs: known before any of it is read."""

import pyarrow as pa
import pyarrow.compute as pc

# Bytes that Python takes for what JSON writes with each of these signs, with all that it needs on the way, and for the
# text itself, whose characters take four bytes where one of them needs as many; a test measures that they suffice.
BYTES_OF_SIGNS = {b",": 48, b'"': 40, b":": 160, b"[": 96, b"{": 96}
# A number or a text in a column, its characters apart, and its part of the row that it comes from.
BYTES_OF_CELL = 120
SEPARATORS = (b",", b";", b"\t", b"|", b"\n")  # between the cells of a CSV text, whichever it uses


def bytes_of_json(text: bytes | bytearray) -> int:
    """Return a bound of the memory that the values of a JSON text take.

    Examples
    --------
    >>> bytes_of_json(b"[0.25, 0.5]") - 2 * len("[0.25, 0.5]")
    144
    """
    return 2 * _bytes_of_text(text) + sum(text.count(sign) * size for sign, size in BYTES_OF_SIGNS.items())


def bytes_of_csv(text: bytes | bytearray) -> int:
    """Return a bound of the memory that the cells of a CSV text take."""
    cells = 1 + sum(text.count(separator) for separator in SEPARATORS)
    return 2 * _bytes_of_text(text) + BYTES_OF_CELL * cells


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
