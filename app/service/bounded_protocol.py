"""HTTP/1.1 with bounds on what is parsed: in one turn of the event loop, in a second, and after a refusal.

One request is parsed at a time; what follows it waits unparsed, at most one read, until that is answered and others
have had their turn.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import httptools
from uvicorn.protocols.http.flow_control import HIGH_WATER_LIMIT
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app.service.allowance import Allowance
from app.service.errors import ProtocolError
from app.service.incoming_head import LONGEST_HEAD, MOST_LINES, IncomingHead, check_request, without_upgrade
from app.service.reading import Hold, Reading

# Bytes that are read in one turn: of six-byte chunks, which take the parser longest, those are 2,730, about 1 ms.
READ_BYTES = 1 << 14
BODY_READ_BYTES = 1 << 18  # of a body whose length is known, or of what is thrown away
# A piece is what takes about .3 us: a call of the parser, 32 bytes that it reads for itself, 256 of a body or of what
# is thrown away. A header is two, a read as many as the event loop takes for it, and a request as many as a tenth of
# what its way to an answer takes.
READ_PIECES, HEADER_PIECES, REQUEST_PIECES = 60, 2, 100
PARSED_BYTES, BODY_BYTES = 1 << 5, 1 << 8
# What one connection may take: at most 8 % of the event loop's time. Chosen: 1,400 small requests a second are 250,000.
PIECES_A_SECOND, MOST_PIECES = 250_000, 10_000
# In which a client that still sends can read why nothing of it is wanted any more; chosen.
LINGER_SECONDS = 2.0
SOON = 1e-6  # seconds of a wait that is for others to go first

_block = memoryview(
    bytearray(BODY_READ_BYTES)
)  # for all connections: it is parsed before the next one is read


class BoundedProtocol(HttpToolsProtocol, asyncio.BufferedProtocol):
    """One connection. It stands between a request and the transport, so that it can close late: see `close`."""

    flow: Reading
    longest_body = 1 << 26  # bytes that are thrown away after a refusal

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._head = IncomingHead()
        self._in_head = False
        self._ends = False  # nothing more is parsed
        self._unparsed = bytearray()
        self._body_left: int | None = 0  # bytes; None where chunks tell
        self._framing = self._trailers = 0  # bytes since the last ones of a body, and lines after it
        self.pieces = 0
        self._allowance = Allowance(PIECES_A_SECOND, MOST_PIECES)
        self._held: asyncio.TimerHandle | None = None
        self._lingering: asyncio.TimerHandle | None = None
        self._thrown_away = 0
        self._when_sent: list[Callable[[], None]] = []

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Read from a new connection."""
        super().connection_made(transport)
        self.flow = Reading(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clocks."""
        for timer in (self._held, self._lingering):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)
        self._tell_sent()

    def resume_writing(self) -> None:
        """Go on, for the client has taken what was to be sent."""
        super().resume_writing()
        self._tell_sent()

    def when_sent(self, do: Callable[[], None]) -> None:
        """Do something once the client has taken nearly all that was to be sent, or is gone."""
        self._when_sent.append(do)
        if not self.flow.write_paused:
            self._tell_sent()

    def _tell_sent(self) -> None:
        waiting, self._when_sent = self._when_sent, []
        for do in waiting:
            do()

    @property
    def is_idle(self) -> bool:
        """Whether no request is in work."""
        return self.cycle is None or self.cycle.response_complete

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return where to read to: no more than what is parsed in one turn."""
        if self._lingering:
            return _block
        return _block[: max(READ_BYTES, min(self._body_left or 0, BODY_READ_BYTES))]

    def buffer_updated(self, nbytes: int) -> None:
        """Parse what has been read."""
        self._unset_keepalive_if_required()
        self.pieces = READ_PIECES
        if self._lingering:
            self.pieces += nbytes // BODY_BYTES
            self._thrown_away += nbytes
            if self._thrown_away > self.longest_body:
                self.transport.close()
        else:
            self._take(_block[:nbytes])
        self.charge(self.pieces)

    def charge(self, pieces: int) -> None:
        """Count work, and hold up the reading where it was more than allowed."""
        self.hold(self._allowance.charge(pieces))

    def hold(self, seconds: float) -> None:
        """Read nothing for so long."""
        if not seconds or (self._held and self._held.when() > self.loop.time() + seconds):
            return
        if self._held:
            self._held.cancel()
        self.flow.hold(Hold.ALLOWANCE)
        self._held = self.loop.call_later(seconds, self.wait_is_over)

    def wait_is_over(self) -> None:
        """Read on."""
        self.read_again()

    def read_again(self) -> None:
        """Parse what has been read, and read on, where nothing else holds the connection up."""
        self.flow.free(Hold.ALLOWANCE)
        if self._unparsed and self.is_idle and not self.is_closing():
            data, self._unparsed = self._unparsed, bytearray()
            self.pieces = 0
            self._take(memoryview(data))
            if not self._unparsed:
                self.flow.free(Hold.UNPARSED)
            self.charge(self.pieces)

    def on_message_begin(self) -> None:
        """Begin a request; one that comes in the same read as the last chunk before it is not taken."""
        if not self._in_head:
            self._end_with_this_answer()
            raise ProtocolError("nothing more is parsed")
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; those after a body are counted and dropped."""
        self.pieces += HEADER_PIECES
        if self._in_head:
            super().on_header(name, value.strip(b" \t"))
            return
        self._trailers += 1
        if self._trailers > MOST_LINES:
            raise ProtocolError("there are too many lines after the body")

    def on_headers_complete(self) -> None:
        """Begin to answer."""
        self.pieces += REQUEST_PIECES
        check_request(self.url, self.parser.get_http_version(), self.headers)
        fields = dict(self.headers)
        self._body_left = None if b"transfer-encoding" in fields else int(fields.get(b"content-length", b"0"))
        self._framing = self._trailers = 0
        super().on_headers_complete()
        cycle = self.cycle
        cycle.transport = self  # type: ignore[assignment]
        self.scope["state"].update(
            receives=lambda: cycle.more_body, peer=self.client, when_sent=self.when_sent
        )

    def on_body(self, body: bytes) -> None:
        """Take a piece of a body; its request is told once all that was read is parsed."""
        self.pieces += 1
        self.cycle.body += body

    def on_response_complete(self) -> None:
        """Go on to what came after the request; where that came in part only, end."""
        if self.cycle.more_body:
            self.close()
            return
        super().on_response_complete()
        if self._unparsed and not self.is_closing():
            self._unset_keepalive_if_required()
            self.hold(SOON)

    def write(self, data: bytes) -> None:
        """Send a part of an answer."""
        self.transport.write(data)

    def is_closing(self) -> bool:
        """Tell whether nothing more is answered."""
        return self._lingering is not None or self.transport.is_closing()

    def close(self) -> None:
        """Close once all is sent. Where the client may still send, say so and throw that away for a while first.

        The system would end a connection that is closed with unread bytes so that the answer may be lost.
        """
        receives = self.cycle is not None and self.cycle.more_body
        if not (self._ends or receives or self._unparsed):
            self.transport.close()
        elif not self.is_closing():
            self.transport.write_eof()
            self._lingering = self.loop.call_later(LINGER_SECONDS, self.transport.close)
            self._unparsed.clear()
            self.flow.free(Hold.UNPARSED)
            self.flow.free(Hold.APPLICATION)

    def end(self) -> None:
        """Parse nothing more, and close."""
        self._ends = True
        self.close()

    def _end_with_this_answer(self) -> None:
        self._ends = True
        self.cycle.keep_alive = False
        self.flow.hold(Hold.UNPARSED)

    def _take(self, data: memoryview) -> None:
        """Parse bytes up to the end of a request; what follows that waits until it is answered."""
        while data and not self._ends:
            if self.cycle is not None and self.cycle.more_body:
                data = self._take_body(data)
            elif self.is_idle:
                data = self._take_head(data)
            else:
                self._unparsed += data
                self.flow.hold(Hold.UNPARSED)
                return

    def _take_head(self, data: memoryview) -> memoryview:
        try:
            head, rest = self._head.take(data)
        except ProtocolError as error:
            self._refuse_bytes(str(error))
            return data
        if head:
            plain = without_upgrade(head)
            self.pieces += len(head) // PARSED_BYTES
            self._in_head = True
            self._parse(memoryview(plain))
            self._in_head = False
            if plain != head and not self._ends:
                self.cycle.keep_alive = False
        return rest

    def _take_body(self, data: memoryview) -> memoryview:
        count = len(data) if self._body_left is None else min(len(data), self._body_left)
        before = len(self.cycle.body)
        self._parse(data[:count])
        taken = len(self.cycle.body) - before
        if self._body_left is not None:
            self._body_left -= count
        self.pieces += taken // BODY_BYTES + (count - taken) // PARSED_BYTES
        self._framing = 0 if taken else self._framing + count
        if self._framing > LONGEST_HEAD and not self._ends:
            self._refuse_bytes("what frames the body is too long")
        if len(self.cycle.body) > HIGH_WATER_LIMIT:
            self.flow.pause_reading()
        if taken:
            self.cycle.message_event.set()
        return data[count:]

    def _parse(self, data: memoryview) -> None:
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserUpgrade:  # CONNECT
            self._end_with_this_answer()
        except httptools.HttpParserError as error:
            if not self._ends:
                self._refuse_bytes(str(error))

    def _refuse_bytes(self, words: str) -> None:
        self.send_400_response(words)
        self.end()
