"""The open connections by client, and which of them to close where a client, or all together, have too many."""

import functools
import logging
import random
import time
from collections import defaultdict
from typing import Protocol

from app.service.allowance import Allowance
from app.service.clients import NamedNetworks, network_of
from app.service.errors import ClientLimitError, OverloadedError, ServiceError
from app.service.turns import Turns
from app.settings import Settings, parts

log = logging.getLogger("pricing.connections")
LEAST_SECONDS = 1.0  # between two lines of the log; chosen
# What is parsed of all connections of one client together: at most 13 % of the event loop's time, and 4 ms at once.
PIECES_A_SECOND, MOST_PIECES = 400_000, 12_000
MOST_CLIENTS = 4096  # whose allowances are remembered once they have no connection; chosen


class Closable(Protocol):
    """A connection that may be closed in favour of another one."""

    @property
    def address(self) -> str:
        """The client's address."""
        ...

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Whether a request is in work, whether one was ever answered, and when something last happened.

        The connection with the lowest rank is closed first.
        """
        ...

    def make_room(self, reason: ServiceError) -> None:
        """Close the connection in favour of another one; a client that waits for an answer is told the reason."""
        ...

    def hold(self, seconds: float) -> None:
        """Read nothing for so long."""
        ...


LONGEST_HOLD = 5.0  # seconds that a client waits at most; chosen


class ConnectionLedger:
    """At most `client_connections` of one client, the named proxies left out, and `max_connections` in all.

    Beyond that the client's connection of the lowest rank is closed, or that of the client with the most of them: the
    new one is always taken, so that no client can keep another one, or a probe, out.
    """

    def __init__(self, settings: Settings) -> None:
        self.turns = Turns()
        self._settings = settings
        trusted = NamedNetworks(parts(settings.trusted_proxies))
        self._trusts = functools.lru_cache(MOST_CLIENTS)(trusted.__contains__)
        self._open: defaultdict[str, set[Closable]] = defaultdict(set)
        self._count = self._closed = 0
        self._told = -LEAST_SECONDS
        self._held: dict[
            str, float
        ] = {}  # clients that have had as much parsed as they may, and until when they wait
        self._allowance = functools.lru_cache(MOST_CLIENTS)(
            lambda client: Allowance(PIECES_A_SECOND, MOST_PIECES, time.monotonic)
        )

    def enter(self, connection: Closable) -> None:
        """Take up a new connection, and close another one where there are too many."""
        client = network_of(connection.address)
        self._open[client].add(connection)
        self._count += 1
        too_many = len(self._open[client]) > self._settings.client_connections
        if too_many and not self._trusts(connection.address):
            reason: ServiceError = ClientLimitError("this client has more connections open than it may")
            self._close_one(client, connection, reason)
        elif self._count > self._settings.max_connections:
            most = max(self._open, key=lambda client: len(self._open[client]))
            self._close_one(
                most, connection, OverloadedError("all clients have more connections open than they may")
            )

    def charge(self, connection: Closable, pieces: int) -> None:
        """Count what was parsed of a client, and read nothing of it for a while where that is more than it may.

        All of its connections are held at once: each would have one more read otherwise. One that comes later is held
        alone, so that the work does not grow with the square of their number. Where several clients are held they wait
        as many times as long: all together have little more parsed than one of them alone.
        """
        if self._trusts(connection.address):
            return
        client = network_of(connection.address)
        seconds = self._allowance(client).charge(pieces)
        if not seconds:
            return
        now = time.monotonic()
        self._held = {other: until for other, until in self._held.items() if until > now}
        seconds = min(LONGEST_HOLD, seconds * len({*self._held, client}))
        if client in self._held:
            connection.hold(seconds)
            return
        self._held[client] = now + seconds
        others = [*self._open.get(client, ())]
        random.shuffle(others)  # which is read first afterwards, before they are all held again
        for other in others:
            other.hold(seconds)

    def leave(self, connection: Closable) -> None:
        """Forget a connection."""
        client = network_of(connection.address)
        if connection in self._open[client]:
            self._open[client].remove(connection)
            self._count -= 1
        if not self._open[client]:
            del self._open[client]

    def _close_one(self, client: str, new: Closable, reason: ServiceError) -> None:
        least = min(self._open[client] - {new}, key=lambda other: other.rank, default=new)
        self.leave(least)
        least.make_room(reason)
        self._closed += 1
        if time.monotonic() - self._told >= LEAST_SECONDS:
            fields = {"client": client, "closed": self._closed}
            log.warning("connections closed to make room for new ones", extra={"fields": fields})
            self._told, self._closed = time.monotonic(), 0
