"""The socket that clients connect to, and how to close it without a reset of those that have connected."""

import contextlib
import ctypes
import socket
import struct

from app.service.connections import BACKLOG

SO_ATTACH_FILTER = 26  # of Linux; Python does not name it
# A filter that the system runs on each packet to the socket, from its TCP header on: (operation, steps if true, steps
# if false, operand), as in Linux's filter.txt.
FLAGS, SYN = 13, 0x02  # the byte of the flags, and the flag of a client that begins to connect
LOAD_BYTE, JUMP_IF_SET, RETURN = 0x30, 0x45, 0x06
DROP, KEEP = 0, 0xFFFFFFFF
NO_NEW_CLIENTS = (
    (LOAD_BYTE, 0, 0, FLAGS),
    (JUMP_IF_SET, 0, 1, SYN),
    (RETURN, 0, 0, DROP),
    (RETURN, 0, 0, KEEP),
)


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
    except OSError as error:
        listener.close()
        error.filename = f"host {host}, port {port}"
        raise
    return listener


def let_nobody_begin(listener: socket.socket) -> None:
    """Leave new connections unanswered from now on, in all processes that share the socket.

    The client's system tries again a second later, and is refused if the socket has been closed by then. Who has begun
    already can still be accepted: a close would reset them. Where the system has no such filters nothing changes.
    """
    program = b"".join(struct.pack("HBBI", *step) for step in NO_NEW_CLIENTS)
    memory = ctypes.create_string_buffer(program, len(program))
    with contextlib.suppress(OSError):
        listener.setsockopt(
            socket.SOL_SOCKET,
            SO_ATTACH_FILTER,
            struct.pack("HP", len(NO_NEW_CLIENTS), ctypes.addressof(memory)),
        )


def accept_all(listener: socket.socket) -> list[socket.socket]:
    """Return the connections that are established and not accepted yet."""
    arrived = []
    with contextlib.suppress(BlockingIOError):
        while True:
            arrived.append(listener.accept()[0])
    return arrived
