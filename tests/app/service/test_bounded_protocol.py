"""What a connection parses of any stream of bytes, counted; how long it takes is printed by `byte_streams`."""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.flow_control import HIGH_WATER_LIMIT

from app.service import bounded_protocol
from app.service.allowance import Allowance
from app.service.bounded_protocol import (
    BODY_BYTES,
    BODY_READ_BYTES,
    HEADER_PIECES,
    MOST_PIECES,
    PARSED_BYTES,
    PIECES_A_SECOND,
    READ_BYTES,
    READ_PIECES,
    REQUEST_PIECES,
)
from app.service.connections import BoundedConnection, reserve_descriptors
from app.service.envelope import Envelope
from app.service.errors import OverloadedError
from app.service.incoming_head import LONGEST_HEAD, LONGEST_PATH, MOST_LINES
from app.service.memory_budget import MemoryBudget
from app.service.reading import Hold
from app.service.request_body import memory_of
from app.settings import Settings
from pricing_core.errors import InvalidInputError
from tests.app.service.byte_streams import (
    CHUNKED,
    GET,
    HOST,
    POST,
    SHAPES,
    UPGRADE,
    FakeTransport,
    Reader,
    Shape,
    connections,
    fed,
    feed,
)
from tests.problems.eventually import PATIENCE

TINY = b"1\r\n \r\n"
TURN_PIECES = READ_PIECES + READ_BYTES // len(TINY) + READ_BYTES // PARSED_BYTES


class Refuser(Reader):
    """An application that answers 404 before it has read anything."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def refuse(scope: Scope, receive: Receive, send: Send) -> None:
            headers = [(b"content-length", b"0")]
            await send({"type": "http.response.start", "status": 404, "headers": headers})
            await send({"type": "http.response.body"})

        self.state.asked += 1
        await Envelope(refuse, 1, self.state.metrics, threading.Event())(scope, receive, send)


class Hasty(Reader):
    """An application that answers before it has read anything, and does not say that it ends the connection."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.state.asked += 1
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})


class Waiter(Reader):
    """An application that answers nothing before it is told to."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.told, self.headers = asyncio.Event(), []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.headers = scope["headers"]
        await self.told.wait()
        await super().__call__(scope, receive, send)


def in_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run a test in an event loop of its own; pytest gives it no fixtures."""

    def run() -> None:
        asyncio.run(test())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run


def opened(application: Any = None) -> tuple[BoundedConnection, FakeTransport, Any]:
    application = application or Reader(Settings())
    return *next(connections(application)), application


async def fed_with(data: bytes, application: Any = None) -> tuple[BoundedConnection, FakeTransport, Any]:
    """Return a connection that was fed with all of some bytes, and has answered what it could."""
    connection, transport, application = opened(application)
    while data and transport.is_read and not transport.is_closed:
        data = data[feed(connection, data) :]
        await turns()
        while Hold.ALLOWANCE in connection.flow._holds:
            await asyncio.sleep(1e-3)
    await turns()
    return connection, transport, application


async def turns() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


def statuses(transport: FakeTransport) -> list[bytes]:
    return [line[9:12] for line in bytes(transport.written).split(b"\r\n") if line.startswith(b"HTTP/1.1 ")]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_one_turn_parses_a_bounded_number_of_bytes_and_pieces_of_any_stream(
    shape: Shape, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.app.service.byte_streams.MOST_FEEDS", 300)
    charged: list[int] = []
    sizes: list[int] = []
    take = BoundedConnection.buffer_updated

    def counted(connection: BoundedConnection, nbytes: int) -> None:
        known = connection._body_left or 0
        take(connection, nbytes)
        charged.append(connection.pieces)
        sizes.append(nbytes if nbytes > known else 0)

    monkeypatch.setattr(BoundedConnection, "buffer_updated", counted)
    asyncio.run(fed(shape, 200_000))
    assert max(charged) <= TURN_PIECES + HEADER_PIECES * (MOST_LINES + 2)
    assert max(sizes) <= READ_BYTES


@in_loop
@patch("app.service.connections.MOST_AT_ONCE", 1 << 60)
async def test_a_connection_is_not_read_once_its_allowance_is_used_up_and_is_read_again_later() -> None:
    connection, _, application = opened()
    application.state.ledger.charge = lambda connection, pieces: None
    now = 0.0
    connection._allowance = Allowance(PIECES_A_SECOND, MOST_PIECES, lambda: now)
    waits: list[float] = []
    connection.hold = waits.append  # type: ignore[method-assign]
    feed(connection, CHUNKED)
    pieces, data = 0, TINY * READ_BYTES
    for _ in range(5_000):
        feed(connection, data[: READ_BYTES // len(TINY) * len(TINY)])
        pieces += connection.pieces
        now += waits[-1]
        if now >= 10.0:
            break
    assert pieces <= 10.0 * PIECES_A_SECOND + MOST_PIECES + TURN_PIECES
    assert pieces > 8.0 * PIECES_A_SECOND


@in_loop
async def test_a_held_connection_is_not_read_even_where_the_application_wants_more() -> None:
    connection, transport, _ = opened()
    connection.hold(0.0)
    assert transport.is_read
    connection.hold(3_600.0)
    connection.hold(0.0)
    connection.hold(1e-3)  # the longer one counts
    connection.flow.pause_reading()
    connection.flow.resume_reading()
    await asyncio.sleep(0.01)
    assert not transport.is_read
    connection.flow.free(Hold.ALLOWANCE)
    assert transport.is_read


@in_loop
async def test_a_held_connection_is_read_again_in_time() -> None:
    connection, transport, _ = opened()
    connection.hold(1e-3)
    assert not transport.is_read
    async with asyncio.timeout(PATIENCE):
        while not transport.is_read:
            await asyncio.sleep(0.01)


@in_loop
async def test_a_read_is_charged_for_headers_head_body_framing_and_what_is_thrown_away() -> None:
    connection, _, _ = opened()
    head = b"GET / HTTP/1.1\r\n" + HOST + b"a: b\r\n" * 50 + b"\r\n"
    feed(connection, head)
    assert connection.pieces == READ_PIECES + 51 * HEADER_PIECES + len(head) // PARSED_BYTES + REQUEST_PIECES
    await turns()
    feed(connection, POST + b"Content-Length: 50000\r\n\r\n")
    feed(connection, b" " * 10_240)
    assert connection.pieces == READ_PIECES + 1 + 10_240 // BODY_BYTES
    connection, _, _ = opened()
    feed(connection, CHUNKED)
    feed(connection, b"1;" + b"a" * 3_998)
    assert connection.pieces == READ_PIECES + 4_000 // PARSED_BYTES
    connection, _, _ = await fed_with(CHUNKED, Refuser(Settings()))
    feed(connection, b" " * 10_240)
    assert connection.pieces == READ_PIECES + 10_240 // BODY_BYTES


@in_loop
async def test_tiny_chunks_and_reads_of_one_byte_hold_the_connection() -> None:
    for data, least in ((TINY * (READ_BYTES // len(TINY)), TURN_PIECES // 2), (b" ", READ_PIECES)):
        connection, transport, _ = opened()
        connection._allowance = Allowance(PIECES_A_SECOND, MOST_PIECES, lambda: 0.0)
        feed(connection, CHUNKED + b"1000000\r\n" if data == b" " else CHUNKED)
        reads = 0
        while transport.is_read and reads < MOST_PIECES:
            feed(connection, data)
            connection.cycle.body.clear()  # it would hold the connection as well
            reads += 1
        assert reads * least <= 2 * MOST_PIECES


@in_loop
@patch("app.service.connections.MOST_AT_ONCE", 1 << 60)
@patch("app.service.connection_ledger.time", SimpleNamespace(monotonic=lambda: 0.0))
async def test_what_one_connection_has_parsed_holds_all_of_its_address_and_new_ones() -> None:
    pairs = connections(Reader(Settings()))
    _, others_transport = next(pairs)
    connection, transport = next(pairs)
    connection._allowance = Allowance(1e9, 1e9)  # what holds it is the address's
    feed(connection, CHUNKED)
    for _ in range(200):
        feed(connection, TINY * (READ_BYTES // len(TINY)))
        connection.cycle.body.clear()
        connection.flow.resume_reading()
        if not transport.is_read:
            break
    assert not transport.is_read
    assert not others_transport.is_read
    assert not next(pairs)[1].is_read


@in_loop
async def test_requests_wait_unparsed_for_the_answer_to_the_one_before() -> None:
    waiter = Waiter(Settings())
    connection, transport, application = await fed_with(GET * 2_000, waiter)
    assert len(connection._unparsed) <= READ_BYTES
    assert not transport.is_read
    await turns()
    assert application.state.asked == 0
    waiter.told.set()
    async with asyncio.timeout(PATIENCE):
        while not transport.is_read or connection._unparsed:
            await turns()
    assert application.state.asked == len(statuses(transport)) == READ_BYTES // len(GET)


@in_loop
async def test_requests_that_come_in_one_read_are_charged_when_they_are_parsed() -> None:
    connection, transport, _ = opened()
    charged: list[int] = []
    connection.charge = charged.append  # type: ignore[method-assign]
    feed(connection, GET * 50)
    async with asyncio.timeout(PATIENCE):
        while len(statuses(transport)) < 50 and not transport.has_ended:
            await turns()
    assert sum(charged) >= READ_PIECES + 50 * (HEADER_PIECES + REQUEST_PIECES)


@in_loop
async def test_requests_with_bodies_that_come_in_one_read_are_each_answered() -> None:
    _, transport, application = await fed_with((POST + b"Content-Length: 3\r\n\r\nGET") * 5)
    async with asyncio.timeout(PATIENCE):
        while len(statuses(transport)) < 5 and not transport.has_ended:
            await turns()
    assert statuses(transport) == [b"204"] * 5
    assert application.state.asked == 5


@pytest.mark.parametrize("framing", [b"Transfer-Encoding: chunked", b"Content-Length: 60000000"])
def test_a_body_that_the_application_does_not_take_is_read_no_further(framing: bytes) -> None:
    async def run() -> None:
        connection, transport, _ = opened(Waiter(Settings()))
        connection.charge = lambda pieces: None  # type: ignore[method-assign]
        feed(connection, POST + framing + b"\r\n\r\n")
        sent = 0
        while transport.is_read and sent < 60_000_000:
            sent += feed(connection, b"10000\r\n" + b" " * 65_536 + b"\r\n")
            await turns()
        assert len(connection.cycle.body) <= HIGH_WATER_LIMIT + BODY_READ_BYTES

    asyncio.run(run())


@in_loop
async def test_a_body_of_known_length_is_read_in_large_parts_and_none_of_what_follows() -> None:
    connection, _, _ = opened()
    feed(connection, POST + b"Content-Length: 300000\r\n\r\n")
    assert len(connection.get_buffer(-1)) == BODY_READ_BYTES
    feed(connection, b" " * BODY_READ_BYTES)
    assert len(connection.get_buffer(-1)) == 300_000 - BODY_READ_BYTES
    assert Hold.ALLOWANCE in connection.flow._holds  # so much is read of one connection in a turn


@in_loop
async def test_what_an_answer_takes_is_counted_until_the_client_has_taken_it() -> None:
    connection, _, _ = opened()
    budget = MemoryBudget(1_000)

    def answered() -> None:
        state = SimpleNamespace(at_end=[], when_sent=connection.when_sent, peer=("1.2.3.4", 1))
        request: Any = SimpleNamespace(state=state, app=SimpleNamespace(state=SimpleNamespace(memory=budget)))
        with patch("app.service.request_body.client_of", lambda _: "client"):
            memory_of(request).take(400)
        for do in state.at_end:
            do()

    answered()
    assert budget.held == 0  # there was nothing to be sent
    for ends in (connection.resume_writing, lambda: connection.connection_lost(None)):
        connection.pause_writing()
        answered()
        assert budget.held == 400
        ends()
        assert budget.held == 0


def head_of(length: int, lines: int = 1) -> bytes:
    """Return a head with so many bytes and lines of headers."""
    begin = b"GET / HTTP/1.1\r\n" + HOST + b"a:\r\n" * (lines - 2) + b"b: "
    return begin + b"c" * (length - len(begin) - 4) + b"\r\n\r\n"


@pytest.mark.parametrize("packet", [1 << 16, 1_000, 1])
@pytest.mark.parametrize(
    ("head", "status"),
    [
        (head_of(LONGEST_HEAD), b"204"),
        (head_of(LONGEST_HEAD + 1), b"400"),
        (head_of(2_000, MOST_LINES), b"204"),
        (head_of(2_000, MOST_LINES + 1), b"400"),
        (GET.replace(b"\r\nHost", b"\nHost"), b"400"),
        (GET.replace(b"\r\n", b"\n"), b"400"),
        (b"GET /" + b"a" * (LONGEST_PATH - 1) + GET[5:], b"204"),
        (b"GET /" + b"a" * LONGEST_PATH + GET[5:], b"400"),
        (b"GET /?" + b"a" * LONGEST_PATH + b" HTTP/1.1\r\n" + HOST + b"\r\n", b"204"),
        (b"\r\n\r\n" + GET, b"400"),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"400"),
    ],
    ids=[
        "16 KiB",
        "a byte more",
        "100 lines",
        "a line more",
        "a bare LF",
        "bare LFs",
        "a path of 2 KiB",
        "a byte more of it",
        "a long query",
        "two empty lines",
        "TLS",
    ],
)
def test_a_head_is_held_to_its_limits_however_it_arrives(packet: int, head: bytes, status: bytes) -> None:
    async def run() -> None:
        connection, transport, application = opened()
        connection.charge = lambda pieces: None  # type: ignore[method-assign]
        left = head
        while left and not transport.has_ended:
            left = left[feed(connection, left[:packet]) :]
        await turns()
        assert statuses(transport) == [status]
        assert application.state.asked == (status == b"204")
        assert transport.has_ended == (status == b"400")

    asyncio.run(run())


@pytest.mark.parametrize(
    "raw",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + HOST + b"\r\n",
        b"GET / HTTP/2.0\r\n" + HOST + b"\r\n",
        b"GET / HTTP/0.9\r\n\r\n",
        b"GET / RTSP/1.1\r\n" + HOST + b"\r\n",
        b"SOURCE / ICE/1.1\r\n" + HOST + b"\r\n",
        b"GET /\r\n\r\n",
        b"GET  / HTTP/1.1\r\n" + HOST + b"\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + b"a: b\r\n c\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + b"a : b\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + b"a: \x00\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + b"a: b\rc\r\n\r\n",
        b"GET /\xe9 HTTP/1.1\r\n" + HOST + b"\r\n",
        b"CONNECT x:443 HTTP/1.1\r\n" + HOST + b"\r\n",
        POST + b"Content-Length: 1\r\nContent-Length: 1\r\n\r\n ",
        POST + b"Content-Length: +1\r\n\r\n ",
        POST + b"Content-Length: 1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        POST + b"Transfer-Encoding: chunked\r\nContent-Length: 1\r\n\r\n0\r\n\r\n",
        POST + b"Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n",
        POST + b"Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        CHUNKED + b"1\n \r\n0\r\n\r\n",
        CHUNKED + b"0x1\r\n \r\n0\r\n\r\n",
        CHUNKED + b"fffffffffffffffff\r\n \r\n0\r\n\r\n",
        CHUNKED + b"0\r\n" + b"a:\r\n" * (MOST_LINES + 1) + b"\r\n",
        CHUNKED + b"0\r\na: " + b"b" * (LONGEST_HEAD + READ_BYTES),
        CHUNKED + b"1;" + b"b" * (LONGEST_HEAD + READ_BYTES),
    ],
    ids=lambda raw: repr(raw[-60:]),
)
def test_what_is_not_plain_http_is_refused_once_and_nothing_more_is_parsed(raw: bytes) -> None:
    async def run() -> None:
        connection, transport, _ = await fed_with(raw)
        assert statuses(transport) == [b"400"]
        assert b"connection: close" in transport.written
        assert transport.has_ended
        feed(connection, GET)
        await turns()
        assert connection.pieces == READ_PIECES
        assert statuses(transport) == [b"400"]

    asyncio.run(run())


@in_loop
async def test_lines_after_a_body_are_no_headers() -> None:
    waiter = Waiter(Settings())
    connection, transport, _ = opened(waiter)
    feed(connection, CHUNKED)
    feed(connection, b"0\r\nContent-Type: a\r\n\r\n")
    waiter.told.set()
    await turns()
    assert statuses(transport) == [b"204"]
    assert [name for name, _ in waiter.headers] == [b"host", b"transfer-encoding"]


@pytest.mark.parametrize("framing", [b"Transfer-Encoding: chunked", b"Content-Length: 60000000"])
def test_a_refusal_ends_the_parsing_and_says_so(framing: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    async def run() -> None:
        connection, transport, _ = await fed_with(POST + framing + b"\r\n\r\n", Refuser(Settings()))
        assert statuses(transport) == [b"404"]
        assert b"connection: close" in transport.written
        assert transport.has_ended  # the client sees the end of the answer
        assert not transport.is_closed  # and can read it, as its bytes are taken
        monkeypatch.setattr(connection, "charge", lambda pieces: None)
        sent = 0
        while not transport.is_closed and sent <= 2 * connection.longest_body:
            sent += feed(connection, TINY * 50_000)
            assert connection.pieces <= READ_PIECES + BODY_READ_BYTES // BODY_BYTES
        assert sent <= connection.longest_body + BODY_READ_BYTES
        assert statuses(transport) == [b"404"]

    asyncio.run(run())


def test_a_refused_connection_is_closed_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_protocol, "LINGER_SECONDS", 0.01)

    async def run() -> None:
        _, transport, _ = await fed_with(CHUNKED, Refuser(Settings(head_seconds=3600.0)))
        async with asyncio.timeout(PATIENCE):
            while not transport.is_closed:
                await asyncio.sleep(0.01)

    asyncio.run(run())


@in_loop
async def test_an_answer_before_the_end_of_the_body_ends_the_parsing_even_where_it_does_not_say_so() -> None:
    connection, transport, _ = await fed_with(CHUNKED, Hasty(Settings()))
    assert transport.has_ended
    feed(connection, TINY * 100)
    assert connection.pieces <= READ_PIECES + 100 * len(TINY) // BODY_BYTES


@in_loop
async def test_a_refusal_of_what_has_come_to_its_end_keeps_the_connection() -> None:
    connection, transport, _ = await fed_with(POST + b"Content-Length: 1\r\n\r\n ", Refuser(Settings()))
    assert not transport.has_ended
    feed(connection, GET)
    await turns()
    assert statuses(transport) == [b"404", b"404"]
    assert b"connection: close" not in transport.written


@pytest.mark.parametrize("after", [b"\x81\x01a", GET])
def test_an_upgrade_is_ignored_and_the_connection_closed(
    after: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        _, transport, application = await fed_with(UPGRADE + after * 100)
        assert statuses(transport) == [b"204"]
        assert b"connection: close" in transport.written
        assert transport.has_ended
        assert application.state.asked == 1

    asyncio.run(run())
    assert not caplog.records


@in_loop
async def test_what_follows_connect_is_not_taken() -> None:
    _, transport, application = await fed_with(b"CONNECT / HTTP/1.1\r\n" + HOST + b"\r\n" + GET * 100)
    assert statuses(transport) == [b"204"]
    assert b"connection: close" in transport.written
    assert transport.has_ended
    assert application.state.asked == 1


@in_loop
async def test_the_body_of_an_upgrade_is_taken() -> None:
    waiter = Waiter(Settings())
    waiter.told.set()
    head = POST + b"Connection: upgrade\r\nUpgrade: h2c\r\nContent-Length: 4\r\n\r\n"
    connection, transport, _ = await fed_with(head, waiter)
    assert statuses(transport) == []
    feed(connection, b"body")
    await turns()
    assert statuses(transport) == [b"204"]
    assert transport.is_closed


@in_loop
async def test_a_request_in_the_read_of_the_last_chunk_is_not_taken_and_the_client_is_told() -> None:
    _, transport, application = await fed_with(CHUNKED + TINY + b"0\r\n\r\n" + GET)
    assert statuses(transport) == [b"204"]
    assert b"connection: close" in transport.written
    assert transport.has_ended
    assert application.state.asked == 1


@in_loop
async def test_a_request_after_the_read_of_the_last_chunk_is_answered() -> None:
    connection, transport, _ = await fed_with(CHUNKED + TINY + b"0\r\n\r\n")
    feed(connection, GET)
    await turns()
    assert statuses(transport) == [b"204", b"204"]


@in_loop
async def test_one_empty_line_may_come_before_a_request_and_http_1_0_needs_no_host() -> None:
    _, transport, _ = await fed_with(b"\r\nGET / HTTP/1.0\r\n\r\n")
    assert statuses(transport) == [b"204"]
    assert transport.is_closed


class Asked(Reader):
    """An application that answers nothing, and notes how its request ends."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.told: list[str] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        while (message := await receive())["type"] != "http.disconnect":
            pass
        self.told.append(message["type"])


@in_loop
async def test_who_is_closed_for_another_is_told_so_and_its_work_ends() -> None:
    connection, transport, application = await fed_with(GET, Asked(Settings()))
    connection.make_room(OverloadedError("too many"))
    await turns()
    assert statuses(transport) == [b"503"]
    assert b"connection: close" in transport.written
    assert transport.is_closed
    assert application.told == ["http.disconnect"]


@in_loop
async def test_a_client_that_reads_nothing_for_a_while_is_dropped() -> None:
    connection, transport, _ = opened(Reader(Settings(stall_seconds=0.01, head_seconds=3_600.0)))
    connection.pause_writing()
    connection.resume_writing()
    connection.pause_writing()
    async with asyncio.timeout(PATIENCE):
        while not transport.is_closed:
            await asyncio.sleep(0.01)


@in_loop
async def test_a_connection_without_a_whole_head_is_dropped_in_time_and_each_answer_gives_it_as_much() -> (
    None
):
    connection, transport, _ = opened(Reader(Settings(head_seconds=3_600.0)))
    begun = connection._head_timer.when()  # type: ignore[union-attr]
    await asyncio.sleep(0.01)
    feed(connection, GET)
    await turns()
    assert connection._head_timer.when() > begun  # type: ignore[union-attr]
    connection, transport, _ = opened(Reader(Settings(head_seconds=0.01)))
    feed(connection, GET[:-3])
    async with asyncio.timeout(PATIENCE):
        while not transport.is_closed:
            await asyncio.sleep(0.01)


@pytest.mark.parametrize(("soft", "hard", "told"), [(256, 100_000, [(1_012, 100_000)]), (2_000, 2_000, [])])
def test_as_many_files_may_be_open_as_there_may_be_connections(
    monkeypatch: pytest.MonkeyPatch, soft: int, hard: int, told: list[tuple[int, int]]
) -> None:
    found: list[tuple[int, int]] = []
    monkeypatch.setattr("app.service.connections.resource.getrlimit", lambda _: (soft, hard))
    monkeypatch.setattr("app.service.connections.resource.setrlimit", lambda _, limits: found.append(limits))
    reserve_descriptors(500)
    assert found == told
    with pytest.raises(InvalidInputError, match="PRICING_MAX_CONNECTIONS"):
        reserve_descriptors(hard)
