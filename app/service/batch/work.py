"""The rows of a batch priced part by part, by the threads for expensive questions, while others are sent."""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import pyarrow as pa
from fastapi import Request

from app.service.batch.answers import ARROW, JSON, LINES, BatchAnswer
from app.service.batch.arrow_body import table_of
from app.service.batch.json_rows import JsonLines, columns_of
from app.service.batch.row_limits import FIELDS, LONGEST_COLUMNS, MOST_ROWS
from app.service.decoded_size import bytes_of_json
from app.service.errors import BodyTooLargeError, DeadlineError
from app.service.incoming_body import IncomingBody
from app.service.request_body import memory_of
from app.service.request_record import record_of
from app.service.work.admission import expensive_lane, expensive_place
from app.service.work.lanes import Interrupt
from pricing_core.american.arrow.price_batch import results_schema, unfinished_rows
from pricing_core.american.pricing_settings import PricingSettings

Found = TypeVar("Found")
ROWS_AT_A_TIME = 16_384  # that are answered without being read; chosen


class Rows(Protocol):
    """Rows to be priced together."""

    @property
    def count(self) -> int:
        """The number of rows."""
        ...

    def price(self, settings: PricingSettings, interrupt: Interrupt) -> pa.RecordBatch:
        """Return the results of every row; those that are not ready when the work ends have the status deadline."""
        ...


class Pieces(Protocol):
    """All rows of a body, in pieces to be priced together."""

    @property
    def count(self) -> int:
        """The number of rows."""
        ...

    def __iter__(self) -> Iterator[Rows]: ...


@dataclass(frozen=True, slots=True)
class LateRows:
    """Rows for which the deadline left no time."""

    count: int


class BatchWork:
    """The work of one batch, from its rows to its answer.

    Parameters
    ----------
    request : Request
    body : IncomingBody
    form : str
        Form of the body.
    settings : PricingSettings
    answer : BatchAnswer
    """

    def __init__(
        self,
        request: Request,
        body: IncomingBody,
        form: str,
        settings: PricingSettings,
        answer: BatchAnswer,
    ) -> None:
        self._lane, self._place = expensive_lane(request), expensive_place(request)
        self._promised, self._rows = self._place.expires, 0
        self._on_its_way = 0  # bytes of the answer
        self._record, self._memory = record_of(request), memory_of(request)
        self._body, self._form, self._settings, self._answer = body, form, settings, answer

    async def answered(self) -> AsyncIterator[bytes]:
        """Yield the answer as it becomes ready.

        Raises
        ------
        ServiceError, InvalidInputError, InvalidJsonError, ClientDisconnect
            The body is not what it must be, or nobody waits for the answer.
        """
        names, parts = await self._read()
        yield self._answer.start(results_schema(names, self._settings))
        count = 0
        async for part in parts:
            size = part.count  # which is found by reading, where it is lines
            count += size
            if count > MOST_ROWS:
                raise BodyTooLargeError(f"a batch must not have more than {MOST_ROWS} rows")
            priced = None if isinstance(part, LateRows) else await self._priced(part)
            if priced is None:
                async for answer in self._unfinished(size, names):
                    yield answer
                continue
            statuses, encoded = priced
            self._record.contracts.update(statuses)
            async for answer in self._added(encoded, size):
                yield answer
        end = self._answer.end()
        while last := await asyncio.to_thread(next, end, b""):
            yield last

    async def _read(self) -> tuple[Sequence[str], AsyncIterator[Rows | LateRows]]:
        """Return the names of the columns, and the rows."""
        if self._form == LINES:
            return [*FIELDS], self._lines()
        body = await self._body.whole()
        read: Callable[[bytearray, Interrupt], tuple[list[str], Pieces]] = table_of
        if self._form == JSON:
            if len(body) > LONGEST_COLUMNS:
                raise BodyTooLargeError(
                    f"one JSON object must not be longer than {LONGEST_COLUMNS} bytes: send {LINES} or {ARROW}"
                )
            self._memory.take(bytes_of_json(body))
            read = columns_of
        names, rows = await self._done(lambda interrupt: read(body, interrupt))
        self._rows = rows.count
        return names, self._in_time(rows)

    def _has_time(self) -> bool:
        """Tell whether the work goes on: until there is only time left to answer what is known of the rows as late."""
        rows = min(self._rows or self._body.lines_received, MOST_ROWS)
        self._place.expires = self._promised - rows / self._answer.rows_a_second
        return self._place.has_time()

    async def _in_time(self, pieces: Pieces) -> AsyncIterator[Rows | LateRows]:
        """Yield the pieces one by one, and once the deadline has passed all that is left as one."""
        left = pieces.count
        for rows in pieces:
            if not self._has_time():
                yield LateRows(left)
                return
            left -= rows.count
            yield rows

    async def _lines(self) -> AsyncIterator[Rows | LateRows]:
        """Yield the rows as they come; once the deadline has passed all that are here already as one."""
        late, is_late = 0, False
        async for lines in self._body.lines():
            rows = JsonLines(lines)
            is_late = is_late or not self._has_time()
            if not is_late:
                yield rows
                continue
            late += rows.count
            await asyncio.sleep(0)  # for others: blank lines come to nothing that is waited for
            if late >= ROWS_AT_A_TIME or not self._body.has_lines:
                yield LateRows(late)
                late = 0
        if late:
            yield LateRows(late)

    async def _priced(self, rows: Rows) -> tuple[Counter[str], object] | None:
        """Return how many rows have which status, and their results in the form of the answer; None if it is late."""

        def work(interrupt: Interrupt) -> tuple[Counter[str], object]:
            # More lines may have come since the work began.
            results = rows.price(self._settings, lambda: interrupt() or not self._has_time())
            return Counter(results["status"].to_pylist()), self._answer.encoded(results)

        if self._has_time():
            with contextlib.suppress(DeadlineError):
                return await self._done(work)
        return None

    async def _unfinished(self, count: int, names: Sequence[str]) -> AsyncIterator[bytes]:
        """Yield what is said of rows that are not even read."""
        row = unfinished_rows(1, names, self._settings)
        self._record.contracts[row["status"][0].as_py()] += count
        many = None
        for start in range(0, count, ROWS_AT_A_TIME):
            size = min(ROWS_AT_A_TIME, count - start)
            if many is None or size < ROWS_AT_A_TIME:
                many = await asyncio.to_thread(self._answer.repeated, row, size)
            async for answer in self._added(many, size):
                yield answer

    async def _added(self, encoded: Any, count: int) -> AsyncIterator[bytes]:
        """Yield the answer of some rows, and count what it takes of the memory until the client has taken it.

        One that is on its way is gone when the next one is: until then it stays counted.
        """
        size = len(encoded) if isinstance(encoded, bytes) else sum(map(len, encoded))
        self._memory.take(size)
        answer = self._answer.add(encoded, count)
        if answer:
            yield answer
            self._memory.give_back(self._on_its_way)
            self._on_its_way = size

    async def _done(self, work: Callable[[Interrupt], Found]) -> Found:
        return await self._lane.run(work, self._place, self._body.gone())
