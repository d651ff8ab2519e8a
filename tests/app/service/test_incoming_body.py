"""A long body as it arrives: what is read of it is bounded before it is whole."""

import asyncio
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.service.errors import BodyTimeoutError, BodyTooLargeError
from app.service.incoming_body import LINES_AT_A_TIME, MOST_LINES, IncomingBody, _end_of_lines
from app.service.memory_budget import MemoryBudget
from app.service.request_record import RequestRecord
from app.service.work.route_limits import RouteLimits
from tests.problems.eventually import PATIENCE

PART = b"x" * 99 + b"\n"


class Sender:
    """A request whose body comes in equal parts, without an end, or nothing of which comes."""

    def __init__(self, part: bytes, memory: int) -> None:
        self.part, self.sent = part, 0
        self.app = SimpleNamespace(state=SimpleNamespace(memory=MemoryBudget(memory)))
        self.state = SimpleNamespace(record=RequestRecord("a"), at_end=[])

    async def receive(self) -> dict[str, Any]:
        """Return the next part."""
        await asyncio.sleep(0 if self.part and self.sent < 1_000_000 else PATIENCE)
        self.sent += len(self.part)
        return {"type": "http.request", "body": self.part, "more_body": True}


async def whole(body: IncomingBody) -> None:
    await body.whole()


async def lines(body: IncomingBody) -> None:
    async for _ in body.lines():
        pass


def read(
    sender: Sender, limits: RouteLimits, how: Callable[[IncomingBody], Coroutine[Any, Any, None]]
) -> None:
    async def run() -> None:
        body = IncomingBody(sender, limits)  # type: ignore[arg-type]
        try:
            await asyncio.wait_for(how(body), PATIENCE / 2.0)
        finally:
            body.close()

    asyncio.run(run())


@pytest.mark.parametrize("how", [whole, lines])
def test_a_body_is_read_no_further_than_its_limit(
    how: Callable[[IncomingBody], Coroutine[Any, Any, None]],
) -> None:
    sender = Sender(PART, 1 << 30)
    with pytest.raises(BodyTooLargeError):
        read(sender, RouteLimits(1_000, 3_600.0, 3_600.0), how)
    assert sender.sent <= 2_000


def test_a_body_that_is_read_whole_is_counted_as_it_arrives() -> None:
    sender = Sender(PART, 1_000)
    with pytest.raises(BodyTooLargeError):
        read(sender, RouteLimits(1 << 30, 3_600.0, 3_600.0), whole)
    assert sender.sent <= 2_000


def test_lines_that_have_been_taken_are_counted_no_more() -> None:
    sender = Sender(PART, 10_000)
    with pytest.raises(BodyTooLargeError):
        read(sender, RouteLimits(500_000, 3_600.0, 3_600.0), lines)
    assert sender.sent > 500_000


def test_a_body_that_does_not_come_is_waited_for_no_longer_than_its_time() -> None:
    with pytest.raises(BodyTimeoutError):
        read(Sender(b"", 1_000), RouteLimits(1_000, 0.01, 3_600.0), whole)


def test_lines_are_cut_between_lines_and_few_at_a_time_however_short_they_are() -> None:
    rng = np.random.default_rng(61)
    for longest in (1, 3, 60, 3000):
        lengths = rng.integers(0, longest, 3 * MOST_LINES)
        left = bytearray(b"".join(b"x" * length + b"\n" for length in lengths.tolist()) + b"unfinished")
        while end := _end_of_lines(left):
            assert left[end - 1 : end] == b"\n"
            assert end <= LINES_AT_A_TIME
            assert left.count(b"\n", 0, end) <= MOST_LINES
            full = left.count(b"\n", 0, end) == MOST_LINES
            assert full or b"\n" not in left[end:LINES_AT_A_TIME]
            del left[:end]
        assert left == b"unfinished"


class Parts(Sender):
    """A request whose body comes in parts of these lengths."""

    def __init__(self, body: bytes, lengths: list[int]) -> None:
        super().__init__(b"", 1 << 30)
        self.parts = np.split(np.frombuffer(body, np.uint8), np.cumsum(lengths))

    async def receive(self) -> dict[str, Any]:
        """Return the next part, and then nothing any more."""
        if not self.parts:
            await asyncio.sleep(PATIENCE)
        part = self.parts.pop(0).tobytes()
        return {"type": "http.request", "body": part, "more_body": bool(self.parts)}


@pytest.mark.parametrize("largest", [7, 1_000, 3 * LINES_AT_A_TIME])
def test_a_body_is_the_same_whole_and_in_lines_however_it_arrives(largest: int) -> None:
    rng = np.random.default_rng(largest)
    longest = 5_000 if largest > 1_000 else 40
    lines = [b"x" * length for length in rng.integers(0, longest, 600).tolist()]
    body = b"\n".join(lines)
    lengths = rng.integers(0, largest, 2 * len(body) // largest).tolist()
    limits = RouteLimits(1 << 30, 3_600.0, 3_600.0)
    found: list[bytes] = []

    async def take_whole(incoming: IncomingBody) -> None:
        found.append(bytes(await incoming.whole()))

    async def take_lines(incoming: IncomingBody) -> None:
        taken = [part async for part in incoming.lines()]
        assert all(part.endswith(b"\n") for part in taken[:-1])
        assert not incoming.has_lines
        assert incoming._memory._budget.held == 0
        found.append(b"".join(taken))

    for how in (take_whole, take_lines):
        read(Parts(body, lengths), limits, how)
    assert found == [body, body]
