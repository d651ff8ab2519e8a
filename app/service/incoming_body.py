"""A long body as it arrives: counted, held in memory that all such bodies share, read whole or line by line."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator

from fastapi import Request
from starlette.requests import ClientDisconnect

from app.service.clients import client_of
from app.service.errors import BodyTooLargeError, ClientLimitError, OverloadedError, ServiceError
from app.service.request_body import too_large, too_late
from app.service.work.route_limits import RouteLimits

LONGEST_LINE = 1 << 20  # bytes; chosen: those of the body of a single contract by default
LINES_AT_A_TIME, MOST_LINES = 1 << 20, 4096  # bytes and number of lines that are read together; chosen


class BodyMemory:
    """The bytes that long bodies hold, all together and by client: two of the largest, one for each client."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._held: Counter[str] = Counter()

    def take(self, client: str, count: int) -> None:
        """Count bytes as held.

        Raises
        ------
        ClientLimitError, OverloadedError
            The client, or all together, hold as much as they may.
        """
        if self._held[client] + count > self._most:
            raise ClientLimitError("the long bodies of this client are larger together than one may be")
        if self._held.total() + count > 2 * self._most:
            raise OverloadedError("the long bodies in work are as large together as they may be")
        self._held[client] += count

    def give_back(self, client: str, count: int) -> None:
        """Count bytes as free again."""
        self._held[client] -= count
        if not self._held[client]:
            del self._held[client]


class IncomingBody:
    """The body of one request, taken in by a task of its own until `close`.

    Parameters
    ----------
    request : Request
        Nobody else may receive its messages.
    limits : RouteLimits
    """

    def __init__(self, request: Request, limits: RouteLimits) -> None:
        self._request, self._limits = request, limits
        self._client = client_of(request)
        self._memory: BodyMemory = request.app.state.body_memory
        self._pending = bytearray()
        self._received = 0
        self._fault: Exception | None = None
        self._ended = False
        self._changed = asyncio.Event()
        self._left = asyncio.Event()
        self._task = asyncio.ensure_future(self._receive())

    def close(self) -> None:
        """Stop reading, and free the memory that is held."""
        self._task.cancel()
        count, self._pending = len(self._pending), bytearray()  # others may still look at its memory
        self._memory.give_back(self._client, count)

    async def gone(self) -> None:
        """Wait until the client has closed the connection."""
        await self._left.wait()

    async def whole(self) -> bytearray:
        """Return the body once all of it is here; it stays counted until `close`.

        Raises
        ------
        BodyTooLargeError, BodyTimeoutError, ClientLimitError, OverloadedError, ClientDisconnect
            It never will be.
        """
        while not self._ended:
            await self._news()
        self._check()
        return self._pending

    async def lines(self) -> AsyncIterator[bytes]:
        """Yield the whole lines that are here, many at a time, as soon as there are any.

        Raises
        ------
        BodyTooLargeError, BodyTimeoutError, ClientLimitError, OverloadedError, ClientDisconnect
            No more will come, or a line is too long.
        """
        while True:
            end = _end_of_lines(self._pending)
            if not end and self._ended:
                self._check()
                end = len(self._pending)
                if not end:
                    return
            if (end or len(self._pending)) > LONGEST_LINE and b"\n" not in self._pending[:LONGEST_LINE]:
                raise BodyTooLargeError(f"a line must not be longer than {LONGEST_LINE} bytes")
            if end:
                lines = bytes(self._pending[:end])
                self._cut(end)
                yield lines
            else:
                await self._news()

    async def _news(self) -> None:
        self._changed.clear()
        await self._changed.wait()

    def _check(self) -> None:
        if self._fault is not None:
            raise self._fault

    def _cut(self, count: int) -> None:
        del self._pending[:count]
        self._memory.give_back(self._client, count)

    async def _receive(self) -> None:
        try:
            async with asyncio.timeout(self._limits.body_seconds):
                while await self._receive_part():
                    self._changed.set()
        except TimeoutError:
            self._fault = too_late(self._limits)
        except (ServiceError, ClientDisconnect) as fault:
            self._fault = fault
        self._ended = True
        self._changed.set()
        while (await self._request.receive())["type"] != "http.disconnect":
            pass
        self._left.set()

    async def _receive_part(self) -> bool:
        """Take one part in, and return whether there are more."""
        message = await self._request.receive()
        if message["type"] == "http.disconnect":
            self._left.set()
            raise ClientDisconnect
        part: bytes = message.get("body", b"")
        self._received += len(part)
        if self._received > self._limits.body_bytes:
            raise too_large(self._limits)
        self._memory.take(self._client, len(part))
        self._pending += part
        return bool(message.get("more_body", False))


def _end_of_lines(text: bytearray) -> int:
    """Return where the whole lines end that are read together, 0 where there is none."""
    end = text.rfind(b"\n", 0, LINES_AT_A_TIME) + 1
    if text.count(b"\n", 0, end) > MOST_LINES:
        end -= len(text[:end].split(b"\n", MOST_LINES)[-1])
    return end
