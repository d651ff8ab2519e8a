"""The server process: one uvicorn server that drains before it closes."""

import asyncio
import gc
import logging
import math
import mmap
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType

from pricing_core.extras import needs_extra

with needs_extra("service"):
    import uvicorn
    from fastapi import FastAPI

    from app.command_failures import FAILED
    from app.main import create_app
    from app.service.api_keys import read_keys
    from app.service.connections import BACKLOG, BoundedConnection, reserve_descriptors
    from app.service.listening_socket import accept_all, let_nobody_begin, listen
    from app.service.logs import configure_logging
    from app.service.memory import spare_memory
    from app.service.metrics import forget_process, remove_folder, share_as, shared_folder
    from app.service.worker_processes import supervise
    from app.settings import Settings, parts

log = logging.getLogger("pricing.server")

# Seconds after which a thread that computes lets the event loop's thread have the interpreter; Python's own are five
# times as many; chosen.
SWITCH_SECONDS = 1e-3
# Share of the grace period after which what is still being priced is ended, so that it can be answered; chosen.
WORK_SHARE = 0.8
# Seconds in which those who have begun to connect can do so, and then for a first request of theirs; chosen.
CONNECT_SECONDS, LAST_SECONDS = 0.2, 0.5


class DrainingServer(uvicorn.Server):
    """On SIGTERM readiness turns 503 first; connections are refused only `drain_seconds` later.

    Requests in flight are finished and the process ends with status 0. A second signal, or SIGINT, closes
    at once. A worker whose parent has died drains likewise.

    Parameters
    ----------
    parent : int, optional
        The process that supervises this one.
    all_stop : callable
        Tells, once this process stops, whether all do that share its listening socket.
    """

    def __init__(
        self, config: uvicorn.Config, application: FastAPI, parent: int | None, all_stop: Callable[[], bool]
    ) -> None:
        super().__init__(config)
        self._all_stop = all_stop
        self._application = application
        self._draining: threading.Event = application.state.draining
        self._settings: Settings = application.state.settings
        self._closes_at = float("inf")
        self._parent = parent

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal; unlike the base class, do not raise it again once the server has closed."""
        if sig == signal.SIGTERM and not self._draining.is_set():
            self._closes_at = time.monotonic() + self._settings.drain_seconds
        else:
            self.force_exit = self.should_exit and sig == signal.SIGINT
            self.should_exit = True
        self._draining.set()

    async def on_tick(self, counter: int) -> bool:
        """Close once the drain is over; called ten times a second."""
        if self._parent not in (None, os.getppid()) and not self._draining.is_set():
            self.handle_exit(signal.SIGTERM, None)
        if time.monotonic() >= self._closes_at:
            self.should_exit = True
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Refuse connections, answer what is in work, with what there is of it by then, and close."""
        end = time.monotonic() + WORK_SHARE * self._settings.grace_seconds
        self._application.state.expensive_lane.end_by(end)
        await self._refuse_connections(sockets or [])
        await super().shutdown(sockets)

    async def _refuse_connections(self, listeners: list[socket.socket]) -> None:
        """Take up who has begun to connect already, no more, and leave them a moment for a last request."""
        loop = asyncio.get_running_loop()
        if self._all_stop():
            for listener in listeners:
                let_nobody_begin(listener)
            await asyncio.sleep(CONNECT_SECONDS)
        arrived = [connection for listener in listeners for connection in accept_all(listener)]
        for server in self.servers:
            server.close()
        for connection in arrived:
            connection.setblocking(False)
            await loop.connect_accepted_socket(self._connection, connection)
        await asyncio.sleep(LAST_SECONDS)

    def _connection(self) -> asyncio.Protocol:
        return BoundedConnection(self.config, self.server_state, self.lifespan.state)


def serve(settings: Settings) -> None:
    """Serve until SIGTERM or SIGINT; port 0 takes a free one, which the first log line names.

    Raises
    ------
    OSError
        The address cannot be bound.
    InvalidInputError
        The process may not open as many files as there may be connections, or the file of keys is not what it must be.
    """
    if settings.api_keys_file:
        read_keys(settings.api_keys_file)  # here too, where what is wrong is said in one line
    reserve_descriptors(settings.max_connections)
    with listen(settings.host, settings.port) as listener:
        if settings.workers == 1:
            configure_logging(settings.log_level)
            _say_where(listener)
            _serve_here(listener, settings, None, lambda: True)
        else:
            configure_logging(settings.log_level, in_background=False)
            _say_where(listener)
            with shared_folder():
                supervise(_Workers(listener, settings, parent=os.getpid()), settings.workers)


def _say_where(listener: socket.socket) -> None:
    host, port = listener.getsockname()[:2]
    log.info("listening", extra={"fields": {"host": host, "port": port}})


@dataclass(frozen=True)
class _Workers:
    """What each of several server processes does, and what their parent does when they stop or die."""

    listener: socket.socket
    settings: Settings
    parent: int  # known before the fork: it may have died before a worker looks
    told: mmap.mmap = field(default_factory=lambda: mmap.mmap(-1, 1))  # shared: 1 once all shall stop

    @property
    def stop_seconds(self) -> float:
        return self.settings.drain_seconds + self.settings.grace_seconds

    def work(self, number: int) -> None:
        configure_logging(self.settings.log_level)
        share_as(number)
        _serve_here(self.listener, self.settings, self.parent, self._all_stop)
        if os.getppid() != self.parent:  # it was killed: nobody else clears up
            remove_folder()

    def died(self, number: int) -> None:
        forget_process(number)

    def stopping(self) -> None:
        self.told[0] = 1
        self.listener.close()  # else clients would wait in its queue once the workers have closed theirs

    def _all_stop(self) -> bool:
        return self.told[0] == 1 or os.getppid() != self.parent


def _serve_here(
    listener: socket.socket, settings: Settings, parent: int | None, all_stop: Callable[[], bool]
) -> None:
    sys.setswitchinterval(SWITCH_SECONDS)
    spare_memory()
    app = create_app(settings)
    gc.collect()
    gc.freeze()  # what is here now stays, and collections need not look at it, which stops everybody
    config = uvicorn.Config(
        app,
        http=BoundedConnection,
        ws="none",
        backlog=BACKLOG,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=bool(settings.trusted_proxies),
        forwarded_allow_ips=parts(settings.trusted_proxies),
        timeout_keep_alive=math.ceil(settings.head_seconds),
        timeout_graceful_shutdown=settings.grace_seconds,
    )
    server = DrainingServer(config, app, parent, all_stop)
    server.run(sockets=[listener])
    if not server.started:
        sys.exit(FAILED)
    if not app.state.expensive_lane.close():
        log.error("work that was told to end has not: the process ends without it")
        logging.shutdown()
        os._exit(FAILED)  # the interpreter would wait for its thread
