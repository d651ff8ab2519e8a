"""A long body as it arrives: counted, held in memory that all such bodies share, read whole or line by line."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator

from fastapi import Request
from starlette.requests import ClientDisconnect

from app.service.errors import BodyTooLargeError, ServiceError
from app.service.request_body import memory_of, too_large, too_late
from app.service.work.route_limits import RouteLimits

LONGEST_LINE = 1 << 20  # bytes; chosen: those of the body of a single contract by default
LINES_AT_A_TIME, MOST_LINES = 1 << 18, 4096  # bytes and number of lines that are read together; chosen
PART_BYTES = 1 << 16  # a shorter part is joined with the next one: each takes some memory of its own; chosen


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
        self._memory = memory_of(request)
        # Parts, for what is taken from the front of one long piece would have all of it copied now and then.
        self._parts: deque[bytearray] = deque()
        self._whole = bytearray()
        self._received = 0
        self.lines_received = self._lines_taken = 0  # their ends
        self._fault: Exception | None = None
        self._ended = False
        self._changed = asyncio.Event()
        self._left = asyncio.Event()
        self._task = asyncio.ensure_future(self._receive())

    def close(self) -> None:
        """Stop reading."""
        self._task.cancel()
        self._parts.clear()
        self._whole = bytearray()  # others may still look at its memory

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
        while True:
            while self._parts:
                self._whole += self._parts.popleft()
            if self._ended:
                self._check()
                return self._whole
            await self._news()

    @property
    def has_lines(self) -> bool:
        """Whether there are whole lines that have not been taken."""
        return self.lines_received > self._lines_taken

    async def lines(self) -> AsyncIterator[bytes]:
        """Yield the whole lines that are here, many at a time, as soon as there are any.

        Raises
        ------
        BodyTooLargeError, BodyTimeoutError, ClientLimitError, OverloadedError, ClientDisconnect
            No more will come, or a line is too long.
        """
        pending = bytearray()
        while True:
            while self._parts and (len(pending) < LINES_AT_A_TIME or _is_open(pending)):
                pending += self._parts.popleft()
            end = _end_of_lines(pending)
            if not end and self._ended:
                self._check()
                end = len(pending)
                if not end:
                    return
            if (end or len(pending)) > LONGEST_LINE and b"\n" not in pending[:LONGEST_LINE]:
                raise BodyTooLargeError(f"a line must not be longer than {LONGEST_LINE} bytes")
            if end:
                lines = bytes(pending[:end])
                del pending[:end]
                self._memory.give_back(end)
                self._lines_taken += lines.count(b"\n")
                yield lines
            else:
                await self._news()

    async def _news(self) -> None:
        self._changed.clear()
        await self._changed.wait()

    def _check(self) -> None:
        if self._fault is not None:
            raise self._fault

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
        self._memory.take(len(part))
        if self._parts and len(self._parts[-1]) < PART_BYTES:
            self._parts[-1] += part
        else:
            self._parts.append(bytearray(part))
        self.lines_received += part.count(b"\n")
        return bool(message.get("more_body", False))


def _is_open(text: bytearray) -> bool:
    """Tell whether a text has no end of a line, and may have one."""
    return len(text) <= LONGEST_LINE and b"\n" not in text


def _end_of_lines(text: bytearray) -> int:
    """Return where the whole lines end that are read together, 0 where there is none."""
    end = (text.rfind(b"\n", 0, LINES_AT_A_TIME) + 1) or (text.find(b"\n", LINES_AT_A_TIME) + 1)
    if text.count(b"\n", 0, end) > MOST_LINES:
        end -= len(text[:end].split(b"\n", MOST_LINES)[-1])
    return end
