"""Batches over sockets: rows answered as they arrive, clients that leave, memory that bodies cannot exhaust."""

import contextlib
import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from benchmarks.problems.hostile_questions import SEARCH
from tests.app.service.server_process import QUESTION, Server, everything, running
from tests.app.service.test_server_lanes import eventually, resident_megabytes
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
LINE = json.dumps(QUESTION).encode() + b"\n"
HARD = {**QUESTION, "rate": -0.01, "dividend_yield": -0.02, "expiry": 30, "tolerance": 1e-8}
HEAD = (
    b"POST /v1/batch HTTP/1.1\r\nHost: x\r\nContent-Type: application/x-ndjson\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n"
)


def chunk(data: bytes) -> bytes:
    return f"{len(data):x}\r\n".encode() + data + b"\r\n"


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running(PRICING_BATCH_DEADLINE_SECONDS="20") as server:
        yield server


@contextlib.contextmanager
def sent(server: Server, *parts: bytes) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
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
        assert received(connection, 50).endswith(b"0\r\n\r\n") or connection.recv(99) == b"0\r\n\r\n"


def test_a_client_that_reads_nothing_before_it_has_sent_all_is_answered(server: Server) -> None:
    count = 30_000  # the answer is longer than the buffers of both sockets
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
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


def test_a_client_that_leaves_ends_its_batch() -> None:
    with running(PRICING_SLOTS="1", PRICING_BATCH_DEADLINE_SECONDS="60") as server:
        hard = json.dumps(HARD).encode() + b"\n"
        with sent(server, HEAD.replace(b"batch", b"batch?greeks=extended"), chunk(hard * 2_000)):
            time.sleep(0.7)
        assert eventually(lambda: any(line.get("status") == 499 for line in server.log), 3.0)
        begun = time.monotonic()
        expensive = QUESTION | {"tolerance": 1e-8, "greeks": "extended"}
        assert server.request("POST", "/v1/price", expensive)[0] == 200
        assert time.monotonic() - begun < 5.0


def test_an_answer_that_cannot_be_ended_is_broken_off_and_the_log_says_why(server: Server) -> None:
    with sent(server, HEAD, chunk(LINE)) as connection:
        begun = received(connection, 1)
        connection.sendall(chunk(b"x" * 1_100_000))
        rest = everything(connection)
    assert not (begun + rest).endswith(b"0\r\n\r\n")
    assert eventually(lambda: any("a line" in str(line.get("reason")) for line in server.log))


def test_many_long_bodies_neither_fill_the_memory_nor_stop_an_honest_client() -> None:
    with running(PRICING_BATCH_DEADLINE_SECONDS="8", PRICING_SLOTS="2") as server:
        stop = threading.Event()
        statuses: list[bytes] = []

        def attack() -> None:
            """Send 40 MB of one column of JSON, of an Arrow stream, or of lines, and wait."""
            kinds = (b"application/json", b"application/vnd.apache.arrow.stream", b"application/x-ndjson")
            while not stop.is_set():
                for kind in kinds:
                    head = HEAD.replace(b"application/x-ndjson", kind)
                    with contextlib.suppress(OSError), sent(server, head) as connection:
                        for _ in range(40):
                            connection.sendall(chunk(b" " * (1 << 20)))
                        statuses.append(connection.recv(12))

        attackers = [threading.Thread(target=attack, daemon=True) for _ in range(6)]
        for thread in attackers:
            thread.start()
        largest, slowest = 0.0, 0.0
        for _ in range(40):
            begun = time.monotonic()
            assert server.request("POST", "/v1/price", QUESTION)[0] == 200
            slowest = max(slowest, time.monotonic() - begun)
            largest = max(largest, resident_megabytes(server.process.pid))
            time.sleep(0.05)
        stop.set()
        assert largest < 450.0
        assert slowest < 1.0
        assert eventually(lambda: bool(statuses))
        for thread in attackers:
            thread.join(15)


def test_a_batch_holds_its_deadline() -> None:
    with running(PRICING_BATCH_DEADLINE_SECONDS="1", PRICING_SLOTS="1") as server:
        search = {name: SEARCH[name] for name in ("cash_dividends", "proportional_dividends", "tolerance")}
        hard = json.dumps({**QUESTION, **search}).encode() + b"\n"
        begun = time.monotonic()
        with sent(server, HEAD.replace(b"HTTP/1.1\r\n", b"HTTP/1.1\r\nConnection: close\r\n")) as connection:
            connection.sendall(chunk(hard * 60 + LINE * 1_000) + b"0\r\n\r\n")
            answer = everything(connection)
        assert time.monotonic() - begun < 5.0  # the whole batch takes minutes
        assert answer.count(b'"status": ') == 1_060
        assert answer.count(b'"status": "deadline"') > 10
        assert answer.endswith(b"0\r\n\r\n")
