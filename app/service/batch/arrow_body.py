"""An Arrow stream from a client that is not trusted: all of it is checked before it is used."""

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from app.service.batch.row_limits import (
    FIELDS,
    LONGEST_TEXT,
    MOST_ROWS,
    PIECE_WEIGHT,
    check_columns,
    most_entries,
)
from app.service.errors import BodyTooLargeError, DeadlineError, InvalidArrowError
from app.service.work.lanes import Interrupt
from pricing_core.american.arrow.arrow_column import is_list, is_number, is_text
from pricing_core.american.arrow.price_batch import price_batch
from pricing_core.american.arrow.schema import check_types
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError, Told

Cuts: TypeAlias = np.ndarray[tuple[int], np.dtype[np.int64]]

# Kinds of fields of which a text of a dictionary is read once, however many rows of a piece hold it.
READ_ONCE = ("choice", "date")
ROWS_AT_A_TIME = 1 << 16  # that are cut into pieces together; chosen
LONGEST_SCHEMA = 1 << 18  # bytes of its message, which take many times as much once they are read; chosen
MOST_BATCHES = 4_096  # record batches in a stream: each costs some work, whatever it holds; chosen
# Where the tables of Arrow's messages have what is looked for (Message.fbs).
HEADER_TYPE, HEADER = 1, 2
DICTIONARY, RECORDS = 2, 3  # kinds of header
DATA = 1  # the record batch in a dictionary batch
COMPRESSION = 3  # in a record batch


def read_stream(body: bytes | bytearray, interrupt: Interrupt) -> tuple[list[str], list[pa.RecordBatch]]:
    """Return the names of the columns and the batches of a stream, checked in full; they share the body's memory.

    Raises
    ------
    InvalidArrowError
        It is no Arrow stream, or a compressed one.
    InvalidInputError
        A column is missing, unknown, named twice, or cannot hold its values.
    BodyTooLargeError
        It stands for more rows, or more text, than the service takes.
    DeadlineError
        The interrupt, which is asked before each batch, came.
    """
    try:
        _check_messages(body)
        with pa.ipc.open_stream(pa.BufferReader(pa.py_buffer(body))) as stream:
            check_columns(stream.schema.names)
            _check_schema(stream.schema)
            return stream.schema.names, [_checked(batch) for batch in _batches(stream, interrupt)]
    except (pa.ArrowException, OSError, struct.error, IndexError, UnicodeError):
        raise InvalidArrowError("the body is not one Arrow stream from its schema to its end") from None


def flat_table(body: bytes | bytearray, most_rows: int, interrupt: Interrupt) -> pa.Table:
    """Return a stream of plain columns of any names, checked in full.

    Raises
    ------
    InvalidArrowError
        It is no Arrow stream, or a compressed one.
    InvalidInputError
        A column is no plain column of numbers, text or dates, or holds too long a text.
    BodyTooLargeError
        It has more rows.
    DeadlineError
        As `read_stream`.
    """
    try:
        _check_messages(body)
        with pa.ipc.open_stream(pa.BufferReader(pa.py_buffer(body))) as stream:
            for place, field in enumerate(stream.schema, start=1):
                if not (
                    _is_flat(field.type) or pa.types.is_null(field.type) or pa.types.is_boolean(field.type)
                ):
                    allowed = "a column of numbers, text or dates"
                    raise InvalidInputError(f"column {place}", Told("its type"), allowed)
            batches = [_checked(batch) for batch in _batches(stream, interrupt, most_rows)]
            return pa.Table.from_batches(batches, stream.schema)
    except (pa.ArrowException, OSError, struct.error, IndexError, UnicodeError):
        raise InvalidArrowError("the body is not one Arrow stream from its schema to its end") from None


@dataclass(frozen=True, slots=True)
class ArrowRows:
    """Rows to be priced together, shape (n,)."""

    rows: pa.RecordBatch

    @property
    def count(self) -> int:
        """The number of rows."""
        return int(self.rows.num_rows)

    def price(self, settings: PricingSettings, interrupt: Callable[[], bool]) -> pa.RecordBatch:
        """Return the results of every row."""
        return price_batch(self.rows, settings, interrupt=interrupt)[0]


@dataclass(frozen=True, slots=True)
class ArrowPieces:
    """Rows in pieces to be priced together, which are made one by one: there may be half as many as rows.

    Parameters
    ----------
    parts : sequence of (pyarrow.RecordBatch, array)
        Consecutive rows, and where their pieces begin and the last one ends.
    """

    parts: Sequence[tuple[pa.RecordBatch, Cuts]]

    @property
    def count(self) -> int:
        """The number of rows."""
        return sum(rows.num_rows for rows, _ in self.parts)

    def __iter__(self) -> Iterator[ArrowRows]:
        for rows, cuts in self.parts:
            for start, end in pairwise(map(int, cuts)):
                yield ArrowRows(rows.slice(start, end - start))


def table_of(body: bytes | bytearray, interrupt: Interrupt) -> tuple[list[str], ArrowPieces]:
    """Return the names of the columns of a stream, and its rows in pieces to be priced together.

    Raises
    ------
    InvalidArrowError, InvalidInputError, BodyTooLargeError, DeadlineError
        As `read_stream`.
    """
    names, batches = read_stream(body, interrupt)
    return names, ArrowPieces([*_cut(_in_time(batches, interrupt))])


def _in_time(batches: Iterable[pa.RecordBatch], interrupt: Interrupt) -> Iterator[pa.RecordBatch]:
    """Yield batches until the interrupt comes: what is done to each may look at a whole dictionary again."""
    for batch in batches:
        if interrupt():
            raise DeadlineError("the deadline passed before the body was read; fewer batches are faster")
        yield batch


def _cut(batches: Iterable[pa.RecordBatch]) -> Iterator[tuple[pa.RecordBatch, Cuts]]:
    """Yield consecutive rows, and where to cut them so that each piece holds few numbers and texts."""
    for batch in batches:
        for begin in range(0, batch.num_rows, ROWS_AT_A_TIME):  # what is counted of each takes memory as well
            rows = batch.slice(begin, ROWS_AT_A_TIME)
            weight = np.ones(rows.num_rows, dtype=np.int64)
            for name, column in zip(rows.schema.names, rows.columns, strict=True):
                weight += _weight(name, column)
            place = np.cumsum(weight) // PIECE_WEIGHT
            cuts = np.flatnonzero(np.diff(place, prepend=place[0], append=place[-1] + 1))
            yield rows, np.concatenate(([0], cuts))


def _check_messages(body: bytes | bytearray) -> None:
    """Refuse compressed buffers, which take whatever memory they name, before Arrow looks at them, and what follows."""
    source = pa.BufferReader(pa.py_buffer(body))
    for count, message in enumerate(pa.ipc.MessageReader.open_stream(source)):
        if count == 0 and len(message.metadata) > LONGEST_SCHEMA:
            raise BodyTooLargeError(f"the schema of a stream must not be longer than {LONGEST_SCHEMA} bytes")
        if count > MOST_BATCHES:
            raise BodyTooLargeError(f"a stream must not hold more than {MOST_BATCHES} batches")
        if _is_compressed(memoryview(message.metadata)):
            raise InvalidArrowError("the buffers of the Arrow stream must not be compressed")
    if source.tell() < len(body):
        raise InvalidArrowError("the body must end with the Arrow stream: it goes on behind its end")


def _is_compressed(metadata: memoryview) -> bool:
    message = struct.unpack_from("<I", metadata)[0]
    kind, header = _field(metadata, message, HEADER_TYPE), _field(metadata, message, HEADER)
    if kind is None or header is None or metadata[kind] not in (DICTIONARY, RECORDS):
        return False
    table = _target(metadata, header)
    if metadata[kind] == DICTIONARY:
        data = _field(metadata, table, DATA)
        if data is None:
            return False
        table = _target(metadata, data)
    return _field(metadata, table, COMPRESSION) is not None


def _field(buffer: memoryview, table: int, number: int) -> int | None:
    """Return where a field of a flatbuffers table lies; None where it is absent."""
    virtual = table - struct.unpack_from("<i", buffer, table)[0]
    size = struct.unpack_from("<H", buffer, virtual)[0]
    place = 4 + 2 * number
    offset = struct.unpack_from("<H", buffer, virtual + place)[0] if place + 2 <= size else 0
    return table + offset if offset else None


def _target(buffer: memoryview, place: int) -> int:
    return int(place + struct.unpack_from("<I", buffer, place)[0])


def _check_schema(schema: pa.Schema) -> None:
    check_types(schema)
    for field in schema:
        if not (_is_flat(field.type) or pa.types.is_null(field.type) or _is_nested(field.type)):
            allowed = "a column of numbers, text, dates, or lists or structures of these"
            raise InvalidInputError(f"column {field.name}", Told("its type"), allowed)


def _is_flat(found: pa.DataType) -> bool:
    if pa.types.is_dictionary(found):
        return bool(pa.types.is_string(found.value_type) or pa.types.is_large_string(found.value_type))
    is_plain_text = pa.types.is_string(found) or pa.types.is_large_string(found)
    return bool(is_number(found) or is_plain_text or pa.types.is_date(found) or pa.types.is_timestamp(found))


def _is_nested(found: pa.DataType) -> bool:
    """Tell lists and structures of plain cells, each of which takes some bytes of the body."""
    if pa.types.is_struct(found):
        return _has_names(found) and all(
            _is_plain(field.type) or (_is_plain_list(field.type) and _is_plain(field.type.value_type))
            for field in found
        )
    if not _is_plain_list(found):
        return False
    entry = found.value_type
    return _is_plain(entry) or (
        pa.types.is_struct(entry) and _has_names(entry) and all(_is_plain(field.type) for field in entry)
    )


def _has_names(structure: pa.StructType) -> bool:
    """Tell whether a structure has fields; their names are text, or an error is raised."""
    return bool([field.name for field in structure])


def _is_plain(found: pa.DataType) -> bool:
    return _is_flat(found) and not pa.types.is_dictionary(found)


def _is_plain_list(found: pa.DataType) -> bool:
    return bool(pa.types.is_list(found) or pa.types.is_large_list(found))


def _batches(
    stream: pa.RecordBatchReader, interrupt: Interrupt, most_rows: int = MOST_ROWS
) -> Iterator[pa.RecordBatch]:
    rows = 0
    for batch in _in_time(stream, interrupt):
        rows += batch.num_rows
        if rows > most_rows:
            raise BodyTooLargeError(f"a batch must not have more than {most_rows} rows")
        if batch.num_rows:
            yield batch


def _checked(batch: pa.RecordBatch) -> pa.RecordBatch:
    """Return a batch none of whose buffers says what its others do not bear out, and whose cells are of some size."""
    batch.validate(full=True)
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        for array in _leaves(column):
            if pa.types.is_dictionary(array.type) and len(array.dictionary) > MOST_ROWS:
                allowed = f"a column whose dictionary has at most {MOST_ROWS} texts"
                raise InvalidInputError(f"column {name}", Told("a larger one"), allowed)
            if is_text(array.type) and (_largest(pc.binary_length(_texts(array)))) > LONGEST_TEXT:
                raise InvalidInputError(
                    f"column {name}", Told("a longer one"), f"of texts of at most {LONGEST_TEXT} bytes"
                )
        for entries in _lists(column):
            if _largest(pc.list_value_length(entries)) > most_entries(name):
                raise InvalidInputError(
                    f"column {name}",
                    Told("a longer one"),
                    f"of lists of at most {most_entries(name)} entries",
                )
    return batch


def _texts(column: pa.Array) -> pa.Array:
    return column.dictionary if pa.types.is_dictionary(column.type) else column


def _largest(numbers: pa.Array) -> int:
    return int(pc.max(numbers).as_py() or 0)


def _lists(column: pa.Array) -> Iterator[pa.Array]:
    """Yield a column that holds lists, or those in its structures."""
    if is_list(column.type):
        yield column
    elif pa.types.is_struct(column.type):
        for number in range(column.type.num_fields):
            yield from _lists(column.field(number))


def _leaves(column: pa.Array) -> Iterator[pa.Array]:
    """Yield the arrays in a column that hold no others."""
    if is_list(column.type):
        yield from _leaves(column.values)
    elif pa.types.is_struct(column.type):
        for number in range(column.type.num_fields):
            yield from _leaves(column.field(number))
    else:
        yield column


def _weight(name: str, column: pa.Array) -> Cuts:
    """Return how many numbers the cells of a column may hold beyond one."""
    weight = np.zeros(len(column), dtype=np.int64)
    for entries in _lists(column):
        lengths = pc.fill_null(pc.list_value_length(entries), 0)
        weight += lengths.to_numpy(zero_copy_only=False)
    if pa.types.is_dictionary(column.type):
        codes = pc.fill_null(column.indices.cast(pa.int64()), -1).to_numpy(zero_copy_only=False)
        given = np.flatnonzero(codes >= 0)
        if FIELDS[name].kind in READ_ONCE:
            given = given[np.unique(codes[given], return_index=True)[1]]
        lengths = pc.fill_null(pc.binary_length(column.dictionary), 0).to_numpy(zero_copy_only=False)
        weight[given] += lengths[codes[given]] // 8
    elif is_text(column.type):
        weight += pc.fill_null(pc.binary_length(column), 0).to_numpy(zero_copy_only=False) // 8
    return weight
