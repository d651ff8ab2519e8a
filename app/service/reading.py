"""When a connection is read: while nothing holds it up."""

import asyncio
from enum import Enum, auto

from uvicorn.protocols.http.flow_control import FlowControl


class Hold(Enum):
    """Why a connection is not read."""

    APPLICATION = auto()  # it has not taken yet what came before
    UNPARSED = auto()  # bytes wait for the answer to the request before them
    ALLOWANCE = auto()  # the client has had as much parsed as it may


class Reading(FlowControl):
    """Flow control as uvicorn has it, where others than the application may hold up the reading as well."""

    def __init__(self, transport: asyncio.Transport) -> None:
        super().__init__(transport)
        self._holds: set[Hold] = set()

    def hold(self, why: Hold) -> None:
        """Read nothing more, until this reason is gone as well."""
        if not self._holds:
            self._transport.pause_reading()
        self._holds.add(why)

    def free(self, why: Hold) -> None:
        """Read on, where there is no other reason not to."""
        if why in self._holds:
            self._holds.remove(why)
            if not self._holds:
                self._transport.resume_reading()

    def pause_reading(self) -> None:
        """Hold up the reading on the application's behalf."""
        self.hold(Hold.APPLICATION)

    def resume_reading(self) -> None:
        """Let the application have more."""
        self.free(Hold.APPLICATION)
