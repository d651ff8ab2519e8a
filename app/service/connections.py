"""Connections, bounded in number, and closed where no request comes or no answer is taken."""

import asyncio
import logging
import resource
import uuid

from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from app.service.bounded_protocol import SOON, BoundedProtocol
from app.service.clients import network_of
from app.service.connection_ledger import ConnectionLedger
from app.service.envelope import SECURITY_HEADERS
from app.service.errors import ProtocolError, ServiceError, problem_response, problem_type
from app.service.metrics import Metrics
from app.settings import Settings
from pricing_core.errors import InvalidInputError, Told

log = logging.getLogger("pricing.connections")

BACKLOG = 128  # connections taken up in one go, before the first of them is counted
CONNECTION_PIECES = (
    200  # that a new connection is charged to its client: as much as the event loop takes for it
)
# Pieces of a read after which the next one waits for its turn, whatever the client may still have parsed: twice those
# of an ordinary request. Clients without number may each have some left; chosen.
MOST_AT_ONCE = 500
SPARE_DESCRIPTORS = 4 * BACKLOG  # for such bursts, on their way in and out, and for all other files


def reserve_descriptors(connections: int) -> None:
    """Let the process open as many files as `connections` take.

    Raises
    ------
    InvalidInputError
        The system does not allow that many.
    """
    needed = connections + SPARE_DESCRIPTORS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard <= SPARE_DESCRIPTORS:
        least = SPARE_DESCRIPTORS + 1
        raise InvalidInputError(
            "limit of open files", Told(str(hard)), f"at least {least} (ulimit -n), for one connection"
        )
    if hard != resource.RLIM_INFINITY and needed > hard:
        allowed = f"at most {hard - SPARE_DESCRIPTORS}, as the process may open {hard} files"
        raise InvalidInputError("PRICING_MAX_CONNECTIONS", connections, allowed)
    if soft != resource.RLIM_INFINITY and needed > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


class BoundedConnection(BoundedProtocol):
    """One client; what never becomes a request is refused or dropped here, as a problem where one fits.

    Where there are too many the ledger says which one is closed. One without a request in work is dropped
    `head_seconds` after it was opened, or after the answer before: half a head keeps nothing open, nor does
    an answer that nobody reads.
    """

    _head_timer: asyncio.TimerHandle | None = None
    _stall_timer: asyncio.TimerHandle | None = None
    _has_answered = False
    _last = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Enter a new connection into the ledger, and start its clocks."""
        super().connection_made(transport)
        self.longest_body = self._settings.max_batch_bytes
        self._restart_head_timer()
        self._metrics.connections.inc()
        self._ledger.enter(self)
        self._ledger.charge(self, CONNECTION_PIECES)

    def connection_lost(self, exc: Exception | None) -> None:
        """Take a closed connection out of the ledger."""
        for timer in (self._head_timer, self._stall_timer):
            if timer is not None:
                timer.cancel()
        self._metrics.connections.dec()
        self._ledger.turns.leave(self)
        self._ledger.leave(self)
        super().connection_lost(exc)

    def charge(self, pieces: int) -> None:
        """Count work to the connection and to its client, and let others go first after a read that was much."""
        super().charge(pieces)
        self._ledger.charge(self, pieces)
        if pieces > MOST_AT_ONCE:
            self.hold(SOON)

    def hold(self, seconds: float) -> None:
        """Read nothing for so long, and then until it is the connection's turn."""
        if seconds:
            self._ledger.turns.leave(self)
        super().hold(seconds)

    def wait_is_over(self) -> None:
        """Read on when it is the connection's turn."""
        self._ledger.turns.enter(self)

    def pause_writing(self) -> None:
        """Wait until the client has read some of what is to be sent, but not for ever."""
        self._stall_timer = self.loop.call_later(self._settings.stall_seconds, self._drop_stalled)
        super().pause_writing()

    def resume_writing(self) -> None:
        """Continue to send."""
        if self._stall_timer is not None:
            self._stall_timer.cancel()
        super().resume_writing()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._has_answered = True
        self._restart_head_timer()
        super().on_response_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are not HTTP with a problem document."""
        self._refuse(ProtocolError("the request is not well-formed HTTP/1.1, or its head is too long"))

    @property
    def address(self) -> str:
        """The client's address."""
        return self.client[0] if self.client else ""

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Whether a request is in work, whether one was ever answered, and when the last one was, or it was opened."""
        return not self.is_idle, self._has_answered, self._last

    def make_room(self, reason: ServiceError) -> None:
        """Close the connection in favour of another one; a client that waits for an answer is told the reason."""
        self._metrics.connections_closed.inc()
        if self.is_idle:
            self.transport.abort()
        else:
            self._refuse(reason)
            self.transport.close()

    @property
    def _ledger(self) -> ConnectionLedger:
        ledger: ConnectionLedger = self.config.app.state.ledger  # type: ignore[union-attr]
        return ledger

    @property
    def _metrics(self) -> Metrics:
        metrics: Metrics = self.config.app.state.metrics  # type: ignore[union-attr]
        return metrics

    @property
    def _settings(self) -> Settings:
        settings: Settings = self.config.app.state.settings  # type: ignore[union-attr]
        return settings

    def _restart_head_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
        self._last = self.loop.time()
        self._head_timer = self.loop.call_later(self._settings.head_seconds, self._drop_if_idle)

    def _drop_if_idle(self) -> None:
        if self.is_idle:
            self.transport.abort()  # unlike close(), without waiting for the client to read what is left

    def _drop_stalled(self) -> None:
        words = "a client was dropped that did not read its answer"
        log.warning(words, extra={"fields": {"client": network_of(self.address)}})
        self.transport.abort()

    def _refuse(self, error: Exception) -> None:
        """Answer outside the application, unless an answer has begun, and end what is in work."""
        request_id = uuid.uuid4().hex
        response = problem_response(error, request_id, self._settings.retry_after_seconds)
        self._metrics.refused(problem_type(error).name)
        log.warning(str(error), extra={"fields": {"request_id": request_id, "status": response.status_code}})
        if self.is_idle or not self.cycle.response_started:
            extra = {"connection": "close", "x-request-id": request_id, **SECURITY_HEADERS}
            headers = {**response.headers, **extra}
            lines = [f"{name.lower()}: {value}\r\n".encode("latin-1") for name, value in headers.items()]
            self.transport.write(
                STATUS_LINE[response.status_code] + b"".join(lines) + b"\r\n" + bytes(response.body)
            )
        if not self.is_idle:
            self.cycle.disconnected = True  # ends the work, and keeps its answer from what is closed
            self.cycle.message_event.set()
