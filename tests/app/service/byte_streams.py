"""Streams of bytes that clients may send, and a connection that is fed with them without a network.

What does it cost the service to parse each kind, and how long does one turn of the event loop take? Pieces are what is
charged to the client, and the longest turn is what others may have to wait for one connection. Times are the thread's
own. Run from the root of the project, with --full for ten times as many bytes:
.venv/bin/python -m tests.app.service.byte_streams
"""

import asyncio
import gc
import logging
import sys
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import patch

from starlette.types import Receive, Scope, Send
from uvicorn import Config
from uvicorn.server import ServerState

from app.service.bounded_protocol import READ_PIECES
from app.service.connection_ledger import ConnectionLedger
from app.service.connections import BoundedConnection
from app.service.metrics import Metrics
from app.settings import Settings
from benchmarks.measuring.machine import cpu_model

HOST = b"Host: x\r\n"
GET = b"GET / HTTP/1.1\r\n" + HOST + b"\r\n"
POST = b"POST / HTTP/1.1\r\n" + HOST
CHUNKED = POST + b"Transfer-Encoding: chunked\r\n\r\n"
UPGRADE = b"GET / HTTP/1.1\r\n" + HOST + b"Connection: upgrade\r\nUpgrade: websocket\r\n\r\n"
PACKET = 1 << 16  # bytes that arrive together, where a shape does not say otherwise
PATIENCE = 1_000  # turns of the loop in which a connection that is not read must come on
MOST_FEEDS = 5_000
QUICK, FULL = 400_000, 4_000_000  # bytes of each shape


class Shape(NamedTuple):
    """What is sent: a beginning, then one part again and again, so many bytes in a packet."""

    name: str
    beginning: bytes
    part: bytes
    packet: int = PACKET


def _headers(line: bytes) -> bytes:
    return b"GET / HTTP/1.1\r\n" + HOST + line * 90 + b"\r\n"


SHAPES = (
    Shape("chunks of one byte", CHUNKED, b"1\r\n \r\n"),
    Shape("chunks of two bytes", CHUNKED, b"2\r\n  \r\n"),
    Shape("chunks of 100 bytes", CHUNKED, b"64\r\n" + b" " * 100 + b"\r\n"),
    Shape("chunks of 64 KB", CHUNKED, b"10000\r\n" + b" " * 65_536 + b"\r\n"),
    Shape("chunks with zeros before their size", CHUNKED, b"0000000001\r\n \r\n"),
    Shape("chunks with an extension", CHUNKED, b"1;a\r\n \r\n"),
    Shape("chunks with many extensions", CHUNKED, b"1" + b";a=b" * 1_000 + b"\r\n \r\n"),
    Shape("an extension without an end", CHUNKED + b"1;", b"a"),
    Shape("lines after a body", CHUNKED + b"0\r\n", b"a:\r\n"),
    Shape("one long line after a body", CHUNKED + b"0\r\na: ", b"b"),
    Shape("a head byte by byte", b"GET /", b"a", 1),
    Shape("a body byte by byte", POST + b"Content-Length: 60000000\r\n\r\n", b" ", 1),
    Shape("chunks byte by byte", CHUNKED, b"1\r\n \r\n", 1),
    Shape("empty lines", b"", b"\r\n"),
    Shape("empty lines, one a packet", b"", b"\r\n", 2),
    Shape("short header lines", b"GET / HTTP/1.1\r\n" + HOST, b"a:\r\n"),
    Shape("requests with 90 header lines", b"", _headers(b"a:\r\n")),
    Shape("requests with a long line", b"", GET[:-2] + b"a: " + b"b" * 16_000 + b"\r\n\r\n"),
    Shape("requests with a long path", b"", b"GET /" + b"%61" * 5_000 + b" HTTP/1.1\r\n" + HOST + b"\r\n"),
    Shape("requests one after the other", b"", GET),
    Shape("requests with one chunk each", b"", CHUNKED + b"1\r\n \r\n0\r\n\r\n"),
    Shape("requests with a body each", b"", POST + b"Content-Length: 1\r\n\r\n "),
    Shape("frames after an upgrade", UPGRADE, b"\x81\x01a"),
    Shape("requests after an upgrade", UPGRADE, GET),
    Shape("no HTTP", b"\x16\x03\x01", b"\x00"),
    Shape("a body of known length", POST + b"Content-Length: 60000000\r\n\r\n", b" " * 4_096),
)


class FakeTransport(asyncio.Transport):
    """What a connection does with its transport, noted."""

    def __init__(self, address: str = "192.0.2.1") -> None:
        super().__init__({"peername": (address, 1), "sockname": ("192.0.2.9", 80)})
        self.written = bytearray()
        self.is_read, self.has_ended, self.is_closed = True, False, False
        self.is_shut = False

    def pause_reading(self) -> None:
        """Read nothing."""
        self.is_read = False

    def resume_reading(self) -> None:
        """Read again."""
        self.is_read = True

    def write(self, data: Any) -> None:
        """Keep what is sent."""
        self.written += data

    def write_eof(self) -> None:
        """Send nothing more."""
        self.has_ended = True

    def is_closing(self) -> bool:
        """Tell whether it was closed."""
        return self.is_closed

    def close(self) -> None:
        """Close."""
        self.is_closed = True

    def abort(self) -> None:
        """Close."""
        self.is_closed = True


class Reader:
    """An application that reads a body to its end and answers 204, as the service would without pricing."""

    def __init__(self, settings: Settings) -> None:
        self.state = SimpleNamespace(
            settings=settings, ledger=ConnectionLedger(settings), metrics=Metrics(), asked=0
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        self.state.asked += 1
        while (await receive()).get("more_body"):
            pass
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})


def connections(application: Any) -> Iterator[tuple[BoundedConnection, FakeTransport]]:
    """Yield new connections of an application; an event loop must be running."""
    config = Config(application, ws="none", log_config=None, access_log=False, proxy_headers=False)
    config.load()
    while True:
        connection = BoundedConnection(config, ServerState(), {})
        transport = FakeTransport()
        connection.connection_made(transport)
        yield connection, transport


def feed(connection: BoundedConnection, data: bytes) -> int:
    """Let one read bring as much of some bytes as the connection takes, and return how many those were."""
    count = min(len(data), len(block := connection.get_buffer(-1)))
    block[:count] = data[:count]
    connection.buffer_updated(count)
    return count


class Fed(NamedTuple):
    """What a stream took: processor time for a KB that was read and for a piece, and that of the longest turn."""

    shape: str
    kilobytes: float
    turns: int
    pieces: int
    us_a_kilobyte: float
    ns_a_piece: float
    longest_turn_ms: float
    ended: str


async def fed(shape: Shape, count: int) -> Fed:
    """Feed so many bytes of a shape to a new connection, or until that takes no more, and measure each turn."""
    stream = shape.beginning + shape.part * ((count - len(shape.beginning)) // len(shape.part) + 1)
    connection, transport = next(connections(Reader(Settings())))
    charged: list[int] = []
    turns: list[float] = []
    sent = reads = 0
    with patch.object(connection, "charge", charged.append):
        while sent < count and reads < MOST_FEEDS and not (transport.is_closed or transport.has_ended):
            begun = time.thread_time()
            sent += feed(connection, stream[sent : sent + shape.packet])
            reads += 1
            for _ in range(PATIENCE):
                turns.append(-begun + (begun := time.thread_time()))
                await asyncio.sleep(0)
                if transport.is_read and len(turns) > 1:
                    break
            turns.append(time.thread_time() - begun)
    ended = "refused" if transport.has_ended else "closed" if transport.is_closed else ""
    transport.abort()
    connection.connection_lost(None)
    spent, pieces = sum(turns), sum(charged)
    rates = (1e9 * spent / sent, 1e9 * spent / pieces)
    return Fed(shape.name, sent / 1e3, len(turns), pieces, *rates, 1e3 * max(turns), ended)


async def print_costs(count: int) -> None:
    """Print a line for each shape."""
    print(f"{'':36}   KB read   turns    pieces   us/KB  ns/piece  longest turn")
    for shape in SHAPES:
        found = await fed(shape, count)
        print(
            f"{found.shape:36} {found.kilobytes:9.1f} {found.turns:7,d} {found.pieces:9,d} {found.us_a_kilobyte:7.2f} "
            f"{found.ns_a_piece:9.0f} {found.longest_turn_ms:10.3f} ms  {found.ended}"
        )


def main(*, full: bool) -> None:
    """Print what each kind of stream costs."""
    gc.freeze()  # as the service does
    logging.disable()  # of what is refused
    print(f"{cpu_model()}: a read is charged {READ_PIECES} pieces")
    asyncio.run(print_costs(FULL if full else QUICK))


if __name__ == "__main__":
    main(full="--full" in sys.argv[1:])
