"""The rows of a batch priced part by part, by the threads for expensive questions, while others are sent."""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Protocol, TypeVar

import pyarrow as pa
from fastapi import Request

from app.service.batch.answers import ARROW, JSON, LINES, BatchAnswer
from app.service.batch.arrow_body import table_of
from app.service.batch.json_rows import JsonLines, columns_of
from app.service.batch.row_limits import FIELDS, LONGEST_COLUMNS, MOST_ROWS
from app.service.errors import BodyTooLargeError, DeadlineError
from app.service.incoming_body import IncomingBody
from app.service.request_record import record_of
from app.service.work.admission import expensive_lane, expensive_place
from app.service.work.lanes import Interrupt
from pricing_core.american.arrow.price_batch import results_schema, unfinished_rows
from pricing_core.american.pricing_settings import PricingSettings

Found = TypeVar("Found")


class Rows(Protocol):
    """Rows to be priced together."""

    @property
    def count(self) -> int:
        """The number of rows."""
        ...

    def price(self, settings: PricingSettings, interrupt: Interrupt) -> pa.RecordBatch:
        """Return the results of every row; those that are not ready when the work ends have the status deadline."""
        ...


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
        self._record = record_of(request)
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
            count += part.count
            if count > MOST_ROWS:
                raise BodyTooLargeError(f"a batch must not have more than {MOST_ROWS} rows")
            statuses, encoded = await self._priced(part, names)
            self._record.contracts.update(statuses)
            yield self._answer.add(encoded, part.count)
        yield await asyncio.to_thread(self._answer.end)

    async def _read(self) -> tuple[Sequence[str], AsyncIterator[Rows]]:
        """Return the names of the columns, and the rows."""
        if self._form == LINES:
            return [*FIELDS], self._lines()
        body = await self._body.whole()
        if self._form == JSON and len(body) > LONGEST_COLUMNS:
            raise BodyTooLargeError(
                f"one JSON object must not be longer than {LONGEST_COLUMNS} bytes: send {LINES} or {ARROW}"
            )
        read: Callable[[bytearray], tuple[list[str], Sequence[Rows]]]
        read = columns_of if self._form == JSON else table_of
        names, rows = await self._done(lambda _: read(body))
        return names, _one_by_one(rows)

    async def _lines(self) -> AsyncIterator[Rows]:
        async for lines in self._body.lines():
            yield JsonLines(lines)

    async def _priced(self, rows: Rows, names: Sequence[str]) -> tuple[Counter[str], object]:
        """Return how many rows have which status, and their results in the form of the answer."""

        def work(interrupt: Interrupt) -> tuple[Counter[str], object]:
            results = rows.price(self._settings, interrupt)
            return Counter(results["status"].to_pylist()), self._answer.encoded(results)

        def unfinished() -> tuple[Counter[str], object]:
            row, count = unfinished_rows(1, names, self._settings), rows.count
            return Counter({row["status"][0].as_py(): count}), self._answer.repeated(row, count)

        if self._place.has_time():
            with contextlib.suppress(DeadlineError):
                return await self._done(work)
        return await asyncio.to_thread(unfinished)  # what is left is not even read

    async def _done(self, work: Callable[[Interrupt], Found]) -> Found:
        return await self._lane.run(work, self._place, self._body.gone())


async def _one_by_one(rows: Sequence[Rows]) -> AsyncIterator[Rows]:
    for part in rows:
        yield part
