"""A real server in a process of its own, spoken to over a socket."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from tests.app.service.server_process import (
    QUESTION,
    SETTINGS,
    Server,
    answer_to,
    everything,
    head,
    metric,
    running,
)
from tests.problems.eventually import PATIENCE, eventually


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running(PRICING_HEAD_SECONDS="3600") as server:
        yield server


@pytest.fixture(scope="module")
def hurried() -> Iterator[Server]:
    """A server that waits for nobody for long."""
    with running(PRICING_BODY_SECONDS="1", PRICING_HEAD_SECONDS="2") as server:
        yield server


def test_a_price_over_a_socket(server: Server) -> None:
    status, headers, body = server.request("POST", "/v1/price", QUESTION | {"tolerance": 1e-4})
    assert (status, body["status"]) == (200, "ok")
    assert body["price"] == pytest.approx(6.0904, abs=1e-2)
    assert len(headers["X-Request-ID"]) == 32
    assert "Server" not in headers


def test_health_over_a_socket(server: Server) -> None:
    for path in ("/livez", "/readyz", "/version"):
        assert server.request("GET", path)[0] == 200


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_the_host_of_all_addresses_takes_ipv4_and_ipv6() -> None:
    with running("--host", "::") as server:
        for address in ("127.0.0.1", "::1"):
            with socket.create_connection((address, server.port), timeout=PATIENCE) as connection:
                connection.sendall(b"GET /livez HTTP/1.1\r\nHost: x\r\n\r\n")
                assert connection.recv(65_536).startswith(b"HTTP/1.1 200 ")


def test_two_lengths_of_one_body_are_refused_and_the_connection_is_closed(server: Server) -> None:
    both = head("Content-Length: 4\r\nTransfer-Encoding: chunked")
    received = answer_to(server, both + b"0\r\n\r\nGET /livez HTTP/1.1\r\nHost: x\r\n\r\n")
    assert received.startswith(b"HTTP/1.1 400 ")
    assert b"/docs#bad-request" in received
    assert received.count(b"HTTP/1.1 ") == 1


def test_a_slow_body_times_out_with_a_problem(hurried: Server) -> None:
    received = answer_to(hurried, head("Content-Length: 100"), b'{"spot"')
    assert received.startswith(b"HTTP/1.1 408 ")
    assert b"application/problem+json" in received


def test_a_huge_declared_body_is_refused_before_it_is_sent(server: Server) -> None:
    received = answer_to(server, head("Content-Length: 10000000000"))
    assert received.startswith(b"HTTP/1.1 413 ")
    assert b"application/problem+json" in received


def test_a_huge_chunked_body_is_cut_off(server: Server) -> None:
    block = b"40000\r\n" + b"[" * 0x40000 + b"\r\n"
    received = answer_to(server, head("Transfer-Encoding: chunked"), *[block] * 5)
    assert received.startswith(b"HTTP/1.1 413 ")


def test_hostile_json_leaves_the_server_answering(server: Server) -> None:
    for body in (b"[" * 50_000, b'{"spot": NaN}', b'{"spot": ' + b"9" * 5_000 + b"}", b'{"\\ud800": 1}'):
        received = answer_to(server, head(f"Content-Length: {len(body)}"), body)
        assert received.startswith(b"HTTP/1.1 422 ")
    assert server.request("GET", "/livez")[0] == 200


def test_a_client_that_goes_away_does_no_harm(server: Server) -> None:
    with server.connect() as connection:
        connection.sendall(head("Content-Length: 100"))
    assert server.request("GET", "/livez")[0] == 200


@pytest.mark.parametrize("path", ["/livez", "/readyz", "/version", "/docs", "/openapi.json"])
def test_head_is_answered_as_get_without_a_body(server: Server, path: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)
    connection.request("HEAD", path)
    answer = connection.getresponse()
    assert (answer.status, answer.read()) == (200, b"")
    length = answer.headers["Content-Length"]
    connection.request("GET", path)  # on the same connection: nothing of a body was left in it
    assert len(connection.getresponse().read()) == int(length)
    connection.close()


def test_head_where_there_is_no_get_is_a_405(server: Server) -> None:
    received = answer_to(server, b"HEAD /v1/price HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
    assert received.startswith(b"HTTP/1.1 405 ")
    assert b"allow: POST" in received


@pytest.mark.parametrize(
    "raw",
    [
        b"hello\r\n\r\n",
        b"GET /livez HTTP/1.1\r\nHost: x\r\nX-Long: " + b"x" * 100_000,
        b"GET /livez HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n",
        b"POST /v1/price HTTP/1.1\r\nHost: x\r\nContent-Length: Xq7canary\r\n\r\n",
        head("Transfer-Encoding: chunked") + b"Xq7canary\r\n",
    ],
    ids=["no HTTP", "a long head", "two hosts", "a length in words", "a bad chunk"],
)
def test_what_is_not_http_is_a_problem_too(server: Server, raw: bytes) -> None:
    top, _, body = answer_to(server, raw).partition(b"\r\n\r\n")
    assert top.startswith(b"HTTP/1.1 400 ")
    assert b"content-type: application/problem+json" in top
    assert b"nosniff" in top
    problem = json.loads(body)
    assert (problem["status"], problem["type"]) == (400, "/docs#bad-request")
    assert problem["request_id"].encode() in top
    assert b"canary" not in body


def half_open(server: Server, count: int, stack: ExitStack) -> list[socket.socket]:
    """Return connections on which half a head has been sent."""
    opened = [stack.enter_context(server.connect()) for _ in range(count)]
    for connection in opened:
        with suppress(ConnectionError):  # it may have been closed already
            connection.sendall(b"GET /livez HT")
    return opened


def test_half_open_connections_keep_nobody_out() -> None:
    limit, attempts = 10, 100
    with running(PRICING_MAX_CONNECTIONS=str(limit), PRICING_HEAD_SECONDS="3600") as server:
        with ExitStack() as stack:
            closed = half_open(server, attempts, stack)[:-limit]
            assert server.request("GET", "/livez")[0] == 200
            assert [everything(connection) for connection in closed] == [b""] * len(closed)
        assert server.stop() == 0
    assert [line["level"] for line in server.log].count("ERROR") == 0
    assert "connections closed to make room for new ones" in {line["message"] for line in server.log}


def test_half_open_connections_are_dropped_in_time(hurried: Server) -> None:
    with ExitStack() as stack:
        assert [everything(connection) for connection in half_open(hurried, 20, stack)] == [b""] * 20


def test_probes_are_answered_beside_500_idle_connections_and_a_header_flood(server: Server) -> None:
    flood = b"GET /livez HTTP/1.1\r\nHost: x\r\n" + b"".join(b"X-%d: y\r\n" % k for k in range(3_000))
    with ExitStack() as stack:
        for number in range(500):
            connection = stack.enter_context(server.connect())
            if number % 10 == 0:
                with suppress(ConnectionError):
                    connection.sendall(flood)
        for path in ("/livez", "/readyz", "/version"):
            assert server.request("GET", path)[0] == 200


def test_bytes_now_and_then_do_not_keep_half_a_request_open(hurried: Server) -> None:
    with socket.create_connection(("127.0.0.1", hurried.port), timeout=0.1) as connection:
        received, began = b"", time.monotonic()

        def is_closed() -> bool:
            nonlocal received
            try:
                connection.sendall(b"X")
                received += (block := connection.recv(65_536))
            except TimeoutError:
                return False
            except ConnectionError:
                return True
            return not block

        connection.sendall(b"GET /livez HTTP/1.1\r\nHost: x\r\n\r\nGET /livez HT")
        assert eventually(is_closed)
        assert received.startswith(b"HTTP/1.1 200 ")
        assert time.monotonic() - began > 1.9  # it was given its time


@pytest.mark.parametrize(
    ("files", "line"),
    [
        (
            600,
            "pricing: PRICING_MAX_CONNECTIONS = 500: must be at most 88, as the process may open 600 files",
        ),
        (200, "pricing: limit of open files = 200: must be at least 513 (ulimit -n), for one connection"),
    ],
)
def test_a_low_limit_of_open_files_is_one_sentence(files: int, line: str) -> None:
    command = f"ulimit -n {files} && exec {sys.executable} -m app serve --port 0"
    found = subprocess.run(
        ["sh", "-c", command],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        env=os.environ | SETTINGS,
    )
    assert found.returncode == 2
    assert found.stderr == line + "\n"


def test_many_requests_at_once_are_each_answered_or_told_to_come_back(server: Server) -> None:
    answers: list[tuple[int, Any, Any]] = []

    def ask() -> None:
        answers.append(server.request("POST", "/v1/price", QUESTION | {"tolerance": 1e-3}))

    threads = [threading.Thread(target=ask) for _ in range(24)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 24
    assert {status for status, _, _ in answers} <= {200, 429, 503}
    assert all(headers["Retry-After"] for status, headers, _ in answers if status != 200)
    assert len({body["price"] for status, _, body in answers if status == 200}) == 1


def test_sigterm_turns_readiness_503_finishes_requests_in_flight_and_ends_with_status_0() -> None:
    with running(PRICING_DRAIN_SECONDS="300") as server:
        body = json.dumps(QUESTION | {"tolerance": 1e-3}).encode()
        with server.connect() as in_flight:
            in_flight.sendall(head(f"Content-Length: {len(body)}") + body[:10])
            assert eventually(
                lambda: metric(server, "pricing_requests_in_flight") == 2.0
            )  # and the one that asks
            server.process.send_signal(signal.SIGTERM)
            assert eventually(lambda: server.request("GET", "/readyz")[0] == 503)
            assert server.request("GET", "/livez")[0] == 200
            server.process.send_signal(signal.SIGTERM)  # the drain is over; the one in flight still lives
            assert eventually(server.is_refused)
            in_flight.sendall(body[10:])
            assert everything(in_flight).startswith(b"HTTP/1.1 200 ")
        assert server.stop() == 0


def test_the_log_is_one_json_line_per_request() -> None:
    with running() as server:
        server.request("GET", "/livez", **{"X-Request-ID": "the-first"})
        server.request("GET", "/nowhere", **{"X-Request-ID": "the-second"})
        assert server.stop() == 0
    requests = [line for line in server.log if line["message"] == "request"]
    assert [
        (line["request_id"], line.get("route"), line.get("path"), line["status"]) for line in requests
    ] == [
        ("the-first", "/livez", None, 200),
        ("the-second", None, "/nowhere", 404),
    ]


def test_a_port_in_use_is_one_line_and_status_2(server: Server) -> None:
    command = [sys.executable, "-m", "app", "serve", "--port", str(server.port)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    lines = [line for line in found.stderr.splitlines() if line.startswith("pricing: ")]
    assert found.returncode == 2
    assert lines == found.stderr.splitlines()
    assert len(lines) == 1
