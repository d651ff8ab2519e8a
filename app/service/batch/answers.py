"""The answer to a batch, in parts, in each of the forms that it can be asked for."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import pyarrow as pa
import pyarrow.compute as pc

from app.greeks_units import DEFAULT_UNITS, factor
from app.service.batch.row_limits import MOST_JSON_ROWS
from app.service.errors import BodyTooLargeError, NotAcceptableError
from pricing_core.american.contracts.fields import GreeksUnits

JSON, LINES, ARROW = "application/json", "application/x-ndjson", "application/vnd.apache.arrow.stream"
FORMS = (JSON, LINES, ARROW)
MOST_KINDS = 100  # that an Accept header may name: each is looked at before the request is admitted; chosen
END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"  # a message of no length


class BatchAnswer(Protocol):
    """Turns the results of consecutive rows into the bytes of an answer."""

    @property
    def rows_a_second(self) -> float:
        """How many rows that are late are sent in a second to a client that keeps up: measured for lines only."""
        ...

    def start(self, schema: pa.Schema) -> bytes:
        """Return the first bytes of the answer."""
        ...

    def encoded(self, results: pa.RecordBatch) -> Any:
        """Return rows in the form of the answer; any thread may ask, and repeatedly."""
        ...

    def repeated(self, row: pa.RecordBatch, count: int) -> Any:
        """Return a number of rows equal to this one in the form of the answer, in little more time than one."""
        ...

    def add(self, encoded: Any, count: int) -> bytes:
        """Take the next rows, and return the bytes that are to be sent now."""
        ...

    def end(self) -> Iterator[bytes]:
        """Yield the last bytes of the answer."""
        ...


@dataclass(frozen=True, slots=True)
class ArrowAnswer:
    """An Arrow stream; the units stand in the metadata of its schema."""

    units: GreeksUnits
    rows_a_second: ClassVar[float] = 2e6

    def start(self, schema: pa.Schema) -> bytes:
        """Return the message that holds the schema."""
        return bytes(schema.with_metadata({"greeks_units": self.units}).serialize())

    def encoded(self, results: pa.RecordBatch) -> bytes:
        """Return the message of these rows."""
        return bytes(batch_in_units(results, self.units).serialize())

    def repeated(self, row: pa.RecordBatch, count: int) -> bytes:
        """Return the message of a number of equal rows."""
        return self.encoded(row.take(pa.nulls(count, pa.int64()).fill_null(0)))

    def add(self, encoded: bytes, count: int) -> bytes:
        """Return the message unchanged: it is sent at once."""
        return encoded

    def end(self) -> Iterator[bytes]:
        """Yield the bytes that end a stream."""
        yield END_OF_STREAM


@dataclass(frozen=True, slots=True)
class LinesAnswer:
    """A JSON object for each row, on a line of its own."""

    units: GreeksUnits
    rows_a_second: ClassVar[float] = 2.5e5

    def start(self, schema: pa.Schema) -> bytes:
        """Return no bytes: every line is complete."""
        return b""

    def encoded(self, results: pa.RecordBatch) -> bytes:
        """Return the lines of these rows."""
        changed = batch_in_units(results, self.units)
        names = (*changed.schema.names, "greeks_units")
        rows = zip(*(column.to_pylist() for column in changed.columns), strict=True)
        lines = [ENCODER.encode(dict(zip(names, (*row, self.units), strict=True))) for row in rows]
        return "".join(f"{line}\n" for line in lines).encode()

    def repeated(self, row: pa.RecordBatch, count: int) -> bytes:
        """Return the line of one row a number of times."""
        return self.encoded(row) * count

    def add(self, encoded: bytes, count: int) -> bytes:
        """Return the lines unchanged: they are sent at once."""
        return encoded

    def end(self) -> Iterator[bytes]:
        """Yield nothing: every line is complete."""
        yield from ()


@dataclass(slots=True)
class ColumnsAnswer:
    """One JSON object with a list for each column, which is sent when all rows are there."""

    units: GreeksUnits
    rows_a_second: ClassVar[float] = 1e6
    _names: list[str] = field(default_factory=list)
    _parts: list[list[str]] = field(
        default_factory=list
    )  # the cells of each column, with commas between them
    _count: int = 0

    def start(self, schema: pa.Schema) -> bytes:
        """Return no bytes: the object is sent at the end."""
        self._names = schema.names
        return b""

    def encoded(self, results: pa.RecordBatch) -> list[str]:
        """Return the cells of each column."""
        columns = batch_in_units(results, self.units).columns
        return [ENCODER.encode(column.to_pylist())[1:-1] for column in columns]

    def repeated(self, row: pa.RecordBatch, count: int) -> list[str]:
        """Return the cell of each column a number of times."""
        return [", ".join([cell] * count) for cell in self.encoded(row)]

    def add(self, encoded: list[str], count: int) -> bytes:
        """Keep the cells, and return no bytes.

        Raises
        ------
        BodyTooLargeError
            There are more rows than one JSON object may hold.
        """
        self._parts.append(encoded)
        self._count += count
        if self._count > MOST_JSON_ROWS:
            raise BodyTooLargeError(
                f"more than {MOST_JSON_ROWS} rows are answered as {LINES} or {ARROW} alone: see Accept"
            )
        return b""

    def end(self) -> Iterator[bytes]:
        """Yield the whole object, column by column."""
        yield f'{{"greeks_units": "{self.units}"'.encode()
        for place, name in enumerate(self._names):
            yield f', "{name}": [{", ".join(part[place] for part in self._parts)}]'.encode()
        yield b"}"


ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)
ANSWERS: Mapping[str, Any] = {JSON: ColumnsAnswer, LINES: LinesAnswer, ARROW: ArrowAnswer}


def accepted_form(accept: Sequence[str], given: str) -> str:
    """Return the form of the answer that Accept headers ask for; that of the question where they leave it open.

    Raises
    ------
    NotAcceptableError
        They ask for none that there is.

    Examples
    --------
    >>> accepted_form(["application/x-ndjson;q=0.5, application/json"], ARROW)
    'application/json'
    """
    if sum(header.count(",") for header in accept) >= MOST_KINDS:
        raise NotAcceptableError(f"Accept must name fewer than {MOST_KINDS} kinds of media")
    wanted = [part for header in accept for part in header.split(",") if part.strip()]
    for kind in sorted(map(_kind_and_weight, wanted), key=lambda found: -found[1]):
        if kind[1] > 0.0 and kind[0] in FORMS:
            return kind[0]
        if kind[1] > 0.0 and kind[0] in ("*/*", "application/*"):
            return given
    if wanted:
        raise NotAcceptableError(f"Accept must name {', '.join(FORMS)} or */*")
    return given


def _kind_and_weight(part: str) -> tuple[str, float]:
    kind, *parameters = (word.strip().lower() for word in part.split(";"))
    weight = next((word[2:] for word in parameters if word.startswith("q=")), "1")
    try:
        return kind, float(weight)
    except ValueError:
        return kind, 0.0


def batch_in_units(batch: pa.RecordBatch, units: GreeksUnits) -> pa.RecordBatch:
    """Return columns of results in the units asked for."""
    if units == DEFAULT_UNITS:
        return batch
    columns = [
        _column_times(column, factor(name, units))
        for name, column in zip(batch.schema.names, batch.columns, strict=True)
    ]
    return pa.RecordBatch.from_arrays(columns, schema=batch.schema)


def _column_times(column: pa.Array, by: float) -> pa.Array:
    if by == 1.0:
        return column
    if pa.types.is_list(column.type):
        return pa.ListArray.from_arrays(column.offsets, pc.multiply(column.values, by), mask=column.is_null())
    return pc.multiply(column, by)
