"""Batches over sockets: rows answered as they arrive, clients that leave, memory that bodies cannot exhaust."""

import contextlib
import http.client
import itertools
import json
import socket
from collections.abc import Iterator

import pytest

from tests.app.held_work import HELD_STRIKE, HeldWork
from tests.app.service.server_process import (
    EXPENSIVE,
    QUESTION,
    Server,
    asking,
    everything,
    running,
)
from tests.app.service.test_server_lanes import resident_megabytes
from tests.problems.eventually import PATIENCE, eventually
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
LINE = json.dumps(QUESTION).encode() + b"\n"
HELD_LINE = json.dumps(QUESTION | {"strike": HELD_STRIKE}).encode() + b"\n"
LINES = b"application/x-ndjson"
HEAD = (
    b"POST /v1/batch HTTP/1.1\r\nHost: x\r\nContent-Type: " + LINES + b"\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n"
)


def chunk(data: bytes) -> bytes:
    return f"{len(data):x}\r\n".encode() + data + b"\r\n"


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running() as server:
        yield server


@contextlib.contextmanager
def sent(server: Server, *parts: bytes) -> Iterator[socket.socket]:
    with server.connect() as connection:
        for part in parts:
            connection.sendall(part)
        yield connection


def received(connection: socket.socket, count: int) -> bytes:
    """Return what comes until there are so many lines of answers."""
    found = b""
    while found.count(b'"status": "ok"') < count:
        block = connection.recv(65_536)
        assert block
        found += block
    return found


def test_lines_are_answered_before_the_last_one_is_sent(server: Server) -> None:
    with sent(server, HEAD, chunk(LINE * 2 + LINE[:30])) as connection:
        assert b"200 OK" in received(connection, 2)
        connection.sendall(chunk(LINE[30:]))
        received(connection, 1)
        connection.sendall(chunk(LINE * 50) + b"0\r\n\r\n")
        last = received(connection, 50)
        while not last.endswith(b"\r\n0\r\n\r\n"):
            block = connection.recv(65_536)
            assert block
            last += block


def test_a_client_that_reads_nothing_before_it_has_sent_all_is_answered(server: Server) -> None:
    count = 12_000  # the answer is longer than the buffers of both sockets
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)
    with contextlib.closing(connection):
        connection.request(
            "POST",
            "/v1/batch?greeks=none&tolerance=1e-3",
            LINE * count,
            {"Content-Type": "application/x-ndjson"},
        )
        answer = connection.getresponse()
        assert answer.status == 200
        assert answer.read().count(b'"status": "ok"') == count


def test_a_client_that_leaves_ends_its_batch(held: HeldWork) -> None:
    with running(held=held, PRICING_SLOTS="1") as server:
        with sent(server, HEAD, chunk(HELD_LINE * 20)):
            assert eventually(lambda: held.begun == 1)
        assert eventually(lambda: any(line.get("status") == 499 for line in server.log))
        assert server.request("POST", "/v1/price", EXPENSIVE)[0] == 200  # the one slot is free


def test_an_answer_that_cannot_be_ended_is_broken_off_and_the_log_says_why(server: Server) -> None:
    with sent(server, HEAD, chunk(LINE)) as connection:
        begun = received(connection, 1)
        connection.sendall(chunk(b"x" * 1_100_000))
        rest = everything(connection)
    assert not (begun + rest).endswith(b"0\r\n\r\n")
    assert eventually(lambda: any("a line" in str(line.get("reason")) for line in server.log))


def test_many_long_bodies_neither_fill_the_memory_nor_stop_an_honest_client() -> None:
    kinds = itertools.cycle((b"application/json", b"application/vnd.apache.arrow.stream", LINES))
    answers: list[bytes] = []

    def attack() -> None:
        """Send 40 MB of one column of JSON, of an Arrow stream, or of lines, and wait."""
        head = HEAD.replace(LINES, next(kinds))
        with contextlib.suppress(OSError), sent(server, head) as connection:
            for _ in range(40):
                connection.sendall(chunk(b" " * (1 << 20)))
            answers.append(connection.recv(12))

    with running(PRICING_BATCH_DEADLINE_SECONDS="8") as server, asking(6, attack):
        largest, honest = 0.0, 0
        while honest < 15 or len(answers) < 7:
            assert server.request("POST", "/v1/price", QUESTION)[0] == 200
            honest += 1
            largest = max(largest, resident_megabytes(server.process.pid))
        assert largest < 450.0


def test_a_batch_holds_its_deadline(held: HeldWork) -> None:
    with running(held=held, PRICING_BATCH_DEADLINE_SECONDS="3", PRICING_SLOTS="1") as server:
        with sent(server, HEAD.replace(b"HTTP/1.1\r\n", b"HTTP/1.1\r\nConnection: close\r\n")) as connection:
            connection.sendall(chunk(HELD_LINE * 60 + LINE * 1_000) + b"0\r\n\r\n")
            answer = everything(connection)
        assert answer.count(b'"status": ') == 1_060
        assert answer.count(b'"status": "deadline"') > 10
        assert answer.endswith(b"0\r\n\r\n")
