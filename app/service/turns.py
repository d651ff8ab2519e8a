"""The turns of connections that have much parsed: they are read one after the other, never many at once."""

import asyncio
from typing import Protocol

# Between two turns: what one read takes, at most 1 ms, is then at most a quarter of the event loop's time; chosen.
TURN_SECONDS = 4e-3


class Reads(Protocol):
    """A connection that is not read."""

    def read_again(self) -> None:
        """Read it from now on."""
        ...


class Turns:
    """Connections whose wait is over, in the order in which it was.

    They may be hundreds, of many clients: read in the same turn of the event loop they would hold up everybody else.
    """

    def __init__(self) -> None:
        self._waiting: dict[Reads, None] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._next = 0.0  # reading of the event loop's clock before which no turn begins

    def enter(self, connection: Reads) -> None:
        """Let a connection be read when it is its turn."""
        self._waiting[connection] = None
        self._arrange()

    def leave(self, connection: Reads) -> None:
        """Forget a connection."""
        self._waiting.pop(connection, None)

    def _arrange(self) -> None:
        if self._waiting and self._timer is None:
            self._timer = asyncio.get_running_loop().call_at(self._next, self._begin)

    def _begin(self) -> None:
        self._timer = None
        if self._waiting:
            connection = next(iter(self._waiting))
            del self._waiting[connection]
            self._next = asyncio.get_running_loop().time() + TURN_SECONDS
            connection.read_again()
        self._arrange()
