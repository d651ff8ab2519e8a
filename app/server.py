"""The server process: one uvicorn server that drains before it closes."""

import logging
import signal
import socket
import threading
import time
from types import FrameType

from pricing_core.extras import needs_extra

with needs_extra("service"):
    import uvicorn

    from app.connections import BACKLOG, BoundedConnection, reserve_descriptors
    from app.logs import configure_logging
    from app.main import create_app
    from app.settings import settings_from_environment

log = logging.getLogger("pricing.server")


class DrainingServer(uvicorn.Server):
    """On SIGTERM readiness turns 503 first; connections are refused only `drain_seconds` later.

    Requests in flight are finished and the process ends with status 0. A second signal, or SIGINT, closes
    at once.
    """

    def __init__(self, config: uvicorn.Config, draining: threading.Event, drain_seconds: float) -> None:
        super().__init__(config)
        self._draining = draining
        self._drain_seconds = drain_seconds
        self._closes_at = float("inf")

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal; unlike the base class, do not raise it again once the server has closed."""
        if sig == signal.SIGTERM and not self._draining.is_set():
            self._closes_at = time.monotonic() + self._drain_seconds
        else:
            self.force_exit = self.should_exit and sig == signal.SIGINT
            self.should_exit = True
        self._draining.set()

    async def on_tick(self, counter: int) -> bool:
        """Close once the drain is over; called ten times a second."""
        if time.monotonic() >= self._closes_at:
            self.should_exit = True
        return await super().on_tick(counter)


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket; the host `::` takes clients of both IPv6 and IPv4.

    Raises
    ------
    OSError
        The address cannot be bound.
    """
    kind, both = socket.SOCK_STREAM, host == "::"
    # The protocol is named because asyncio sets TCP_NODELAY on what it knows to be TCP alone: without that a second
    # answer on a connection waits 40 ms for the acknowledgement of the first.
    found = socket.getaddrinfo(host, port, type=kind, proto=socket.IPPROTO_TCP, flags=socket.AI_PASSIVE)
    family, _, protocol, _, address = found[0]
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, not both)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError:
        listener.close()
        raise
    return listener


def serve(host: str, port: int) -> None:
    """Serve until SIGTERM or SIGINT; port 0 takes a free one, which the first log line names.

    Raises
    ------
    OSError
        The address cannot be bound.
    InvalidInputError
        An environment variable does not hold what its setting must be.
    """
    settings = settings_from_environment()
    reserve_descriptors(settings.max_connections)
    with listen(host, port) as listener:
        configure_logging(settings.log_level)
        app = create_app(settings)
        config = uvicorn.Config(
            app,
            http=BoundedConnection,
            ws="none",
            backlog=BACKLOG,
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=settings.grace_seconds,
        )
        bound_host, bound_port = listener.getsockname()[:2]
        log.info("listening", extra={"fields": {"host": bound_host, "port": bound_port}})
        DrainingServer(config, app.state.draining, settings.drain_seconds).run(sockets=[listener])
