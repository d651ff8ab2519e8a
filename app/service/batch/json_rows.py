"""Rows of a batch as JSON writes them, line by line or column by column."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, repeat
from typing import Any, TypeAlias

import pyarrow as pa

from app.service.batch.row_limits import FIELDS, MOST_JSON_ROWS, PIECE_WEIGHT, check_columns, most_entries
from app.service.contract_schema import LONGEST_DATE
from app.service.errors import BodyTooLargeError
from app.service.strict_json import InvalidJsonError, parse_object
from app.service.work.lanes import Interrupt
from pricing_core.american.arrow.price_batch import price_read
from pricing_core.american.book.columns import is_list_of_row
from pricing_core.american.book.reading import REQUIRED_COLUMNS, read_book
from pricing_core.american.contracts.vocabulary import DEFAULTS
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError, Told, UnknownNameError

# By the kind of a field: the types of the JSON values that it may have.
TYPES: Mapping[str, tuple[type, ...]] = {
    "number": (float, int),
    "curve": (float, int, dict),
    "choice": (str,),
    "time": (float, int, str),
    "date": (str,),
    "list": (list,),
}
# A row, or why it is none.
Row: TypeAlias = dict[str, Any] | InvalidInputError


@dataclass(frozen=True, slots=True)
class JsonColumns:
    """Consecutive rows of columns, to be priced together.

    Parameters
    ----------
    columns : mapping of str to object
        A list of cells for each name, or one cell that serves all rows.
    start, end : int
        Which of the rows they are.
    """

    columns: Mapping[str, Any]
    start: int
    end: int

    @property
    def count(self) -> int:
        """The number of rows."""
        return self.end - self.start

    def price(self, settings: PricingSettings, interrupt: Callable[[], bool]) -> pa.RecordBatch:
        """Return the results of every row."""
        rows = [_checked(row) for row in _rows(self.columns, self.start, self.end)]
        return price_rows(rows, [*self.columns], settings, interrupt)


@dataclass(frozen=True, slots=True)
class JsonLines:
    """Rows to be priced together, an object on each line that is not blank, read when they are priced."""

    lines: bytes

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self._written())

    def price(self, settings: PricingSettings, interrupt: Callable[[], bool]) -> pa.RecordBatch:
        """Return the results of every row."""
        return price_rows([*map(_row_of_line, self._written())], [*FIELDS], settings, interrupt)

    def _written(self) -> list[bytes]:
        return [line for line in self.lines.split(b"\n") if line.strip()]


@dataclass(frozen=True, slots=True)
class JsonPieces:
    """Rows of columns in pieces to be priced together.

    Parameters
    ----------
    columns : mapping of str to object
        As those of `JsonColumns`.
    cuts : sequence of int
        Where the pieces begin, and the last one ends.
    """

    columns: Mapping[str, Any]
    cuts: Sequence[int]

    @property
    def count(self) -> int:
        """The number of rows."""
        return self.cuts[-1]

    def __iter__(self) -> Iterator[JsonColumns]:
        for start, end in pairwise(self.cuts):
            yield JsonColumns(self.columns, start, end)


def columns_of(body: bytes | bytearray, _: Interrupt) -> tuple[list[str], JsonPieces]:
    """Return the names of the columns of one JSON object, and its rows in pieces to be priced together.

    The memory that the object takes, `bytes_of_json`, is for the caller to count.

    Raises
    ------
    InvalidJsonError
        The body is not one JSON object.
    InvalidInputError
        A column is missing or unknown, or lengths differ.
    BodyTooLargeError
        There are more rows than one JSON object may hold.
    """
    columns = parse_object(body, most_bytes=None)
    names = [*columns]
    check_columns(names)
    lengths = {len(cells) for name, cells in columns.items() if _is_column(name, cells)}
    if len(lengths) > 1:
        shown = ", ".join(map(str, sorted(lengths)[:4]))
        raise InvalidInputError("columns", Told(f"lengths {shown}"), "scalars and lists of one length")
    count = lengths.pop() if lengths else 1
    if count > MOST_JSON_ROWS:
        raise BodyTooLargeError(
            f"columns in JSON must not have more than {MOST_JSON_ROWS} rows: send JSON lines or an Arrow stream"
        )
    return names, JsonPieces(columns, [*_cuts(columns, count)])


def _rows(columns: Mapping[str, Any], start: int, end: int) -> Iterator[dict[str, Any]]:
    """Yield some rows of columns, one by one."""
    cells = [
        cells[start:end] if _is_column(name, cells) else repeat(cells, end - start)
        for name, cells in columns.items()
    ]
    return (dict(zip(columns, row, strict=True)) for row in zip(*cells, strict=False))


def _cuts(columns: Mapping[str, Any], count: int) -> Iterator[int]:
    """Yield where the parts begin, and the end: each has rows and entries of their lists of some number."""
    each = sum(_length(cell) for name, cell in columns.items() if not _is_column(name, cell))
    lists = [cells for name, cells in columns.items() if _is_column(name, cells)]
    yield 0
    weight = 0
    for row in range(count):
        weight += 1 + each + sum(_length(cells[row]) for cells in lists)
        if weight >= PIECE_WEIGHT and row + 1 < count:
            yield row + 1
            weight = 0
    if count:
        yield count


def price_rows(
    rows: Sequence[Row], names: Sequence[str], settings: PricingSettings, interrupt: Callable[[], bool]
) -> pa.RecordBatch:
    """Return the results of every row; `names` are the columns of the batch that they belong to."""
    refused = {place: row for place, row in enumerate(rows) if isinstance(row, InvalidInputError)}
    read: list[dict[str, Any]] = [{} if isinstance(row, InvalidInputError) else row for row in rows]
    defaults = {**DEFAULTS, "tolerance": settings.tolerance}
    given = {name for row in read for name in row}
    columns = {name: [_given(row, name, defaults) for row in read] for name in {*given, *REQUIRED_COLUMNS}}
    book = read_book(columns, settings.tolerance, refused)
    return price_read(book, names, settings, interrupt=interrupt)[0]


def _given(row: Mapping[str, Any], name: str, defaults: Mapping[str, Any]) -> Any:
    value = row.get(name)
    return defaults.get(name) if value is None else value


def _row_of_line(line: bytes) -> Row:
    try:
        return _checked(parse_object(line))
    except InvalidJsonError as fault:
        return InvalidInputError("line", Told("not read"), f"one JSON object: {fault}")


def _checked(row: dict[str, Any]) -> Row:
    """Return a row whose values are of the right types and not too long, or what is wrong with it."""
    for name, value in row.items():
        field = FIELDS.get(name)
        if field is None:
            return UnknownNameError("key", [name], FIELDS)
        if value is not None and type(value) not in TYPES[field.kind]:
            return InvalidInputError(name, value, field.allowed)
        length = _length(value)
        if length > (LONGEST_DATE if isinstance(value, str) else most_entries(name)):
            return InvalidInputError(name, Told("a longer one"), f"at most {most_entries(name)} entries long")
    return row


def _length(value: object) -> int:
    if isinstance(value, str | list):
        return len(value)
    if isinstance(value, dict):
        return max((len(part) for part in value.values() if isinstance(part, str | list)), default=0)
    return 0


def _is_column(name: str, cells: object) -> bool:
    """Tell a column from a cell that serves all rows; a list of entries is such a cell."""
    if not isinstance(cells, list):
        return False
    return FIELDS[name].kind != "list" or any(is_list_of_row(name, cell) for cell in cells)
