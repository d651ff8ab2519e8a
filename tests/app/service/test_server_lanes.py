"""Expensive and hostile questions to a real server: deadlines, clients that leave, limits, shutdown, workers."""

import http.client
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from benchmarks.problems.hostile_questions import SEARCH
from tests.app.held_work import HeldWork
from tests.app.service.server_process import (
    EXPENSIVE,
    HELD,
    QUESTION,
    Server,
    answer_to,
    asking,
    children,
    everything,
    metric,
    raw,
    running,
)
from tests.problems.eventually import PATIENCE, eventually
from tests.problems.needs_kernel import needs_kernel

BODIES: dict[str, tuple[str, dict[str, Any]]] = {
    "a spot of 1e30": (
        "/v1/price",
        {
            "option_type": "put",
            "strike": 100,
            "spot": 1e30,
            "expiry": 1e-9,
            "rate": {"times": [1, 2], "values": [0.01, 0.02]},
            "volatility": 1e-8,
            "tolerance": 1e-4,
            "greeks": "extended",
        },
    ),
    "two boundaries and a dividend": (
        "/v1/price",
        {
            "option_type": "put",
            "strike": 100,
            "spot": 100,
            "expiry": 30,
            "rate": -0.01,
            "dividend_yield": -0.02,
            "cash_dividends": [{"time": 15, "amount": 1}],
            "volatility": 0.1,
            "tolerance": 1e-8,
            "greeks": "extended",
        },
    ),
    "600 dividends": ("/v1/implied-volatility", SEARCH),
    "a volatility of 15": (
        "/v1/price",
        QUESTION | {"expiry": 200, "volatility": 15, "tolerance": 1e-8},
    ),
    "366 cash dividends": (
        "/v1/price",
        QUESTION | {"cash_dividends": [{"time": (k + 1) / 367, "amount": 0.01} for k in range(366)]},
    ),
}
pytestmark = needs_kernel


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    held = HeldWork(tmp_path_factory.mktemp("held"))
    with running(held=held, PRICING_DEADLINE_SECONDS="1", PRICING_GRACE_SECONDS="5") as server:
        yield server


def asked(server: Server, body: object) -> socket.socket:
    """Return a connection on which a price has been asked for."""
    connection = server.connect()
    connection.sendall(raw("/v1/price", body))
    return connection


def resident_megabytes(process: int) -> float:
    with open(f"/proc/{process}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.parametrize("name", BODIES)
def test_a_hostile_body_is_answered_honestly_within_the_deadline(server: Server, name: str) -> None:
    path, body = BODIES[name]
    status, headers, answer = server.request("POST", path, body)
    if status == 200:
        assert answer["status"] in ("ok", "tolerance_not_met", "deadline")
        assert path != "/v1/price" or 0.0 <= answer["price"] <= body["strike"]
    else:
        assert (status, answer["type"]) in ((503, "/docs#deadline"), (422, "/docs#out-of-domain"))
        assert headers["Content-Type"] == "application/problem+json"
    assert resident_megabytes(server.process.pid) < 350.0


def test_work_that_would_never_end_is_answered_at_the_deadline(server: Server) -> None:
    status, headers, answer = server.request("POST", "/v1/price", HELD)
    assert (status, answer["type"]) == (503, "/docs#deadline")
    assert headers["Content-Type"] == "application/problem+json"


def test_a_client_that_leaves_ends_its_work(held: HeldWork) -> None:
    with running(held=held, PRICING_SLOTS="1") as server:
        with asked(server, HELD):
            assert eventually(lambda: held.begun == 1)
        assert eventually(lambda: any(line.get("status") == 499 for line in server.log))
        assert server.request("POST", "/v1/price", EXPENSIVE)[0] == 200  # the one slot is free


def test_an_honest_client_does_not_notice_hostile_ones_at_its_address(held: HeldWork) -> None:
    statuses: list[int] = []

    def attack() -> None:
        with asked(server, HELD) as connection:
            statuses.append(int(connection.recv(65_536).split()[1]))

    with running(held=held) as server, asking(20, attack), held:
        assert eventually(lambda: held.begun == 1 and 429 in statuses)
        honest = [server.request("POST", "/v1/price", QUESTION)[0] for _ in range(100)]
        assert honest == [200] * 100
        assert set(statuses) == {429}  # as many as may are in work or wait, and the others are refused


def test_an_address_at_its_limit_of_connections_loses_its_oldest_question(held: HeldWork) -> None:
    settings = {"PRICING_CLIENT_CONNECTIONS": "3", "PRICING_SLOTS": "4"}
    with running(held=held, **settings) as server, ExitStack() as stack:
        oldest, *others = [stack.enter_context(asked(server, HELD)) for _ in range(3)]
        assert eventually(lambda: held.begun == 3)
        assert server.request("POST", "/v1/price", QUESTION)[0] == 200
        assert b"/docs#client-limit" in everything(oldest)
        held.release()
        for other in others:
            assert other.recv(65_536).startswith(b"HTTP/1.1 200 ")


def test_an_address_is_what_a_named_proxy_says_it_is(tmp_path: Path) -> None:
    for trusted, expected in (("127.0.0.1", 200), ("", 429)):
        held = HeldWork(tmp_path / str(expected))
        settings = {"PRICING_CLIENT_QUEUE": "1", "PRICING_TRUSTED_PROXIES": trusted}
        with running(held=held, **settings) as server, asked(server, HELD):
            assert eventually(lambda: held.begun == 1)  # noqa: B023
            forwarded = {"X-Forwarded-For": "192.0.2.7"}
            status, headers, _ = server.request("POST", "/v1/price", EXPENSIVE, **forwarded)
            assert status == expected
            assert (headers["Retry-After"] is not None) == (expected == 429)


def test_sigterm_with_expensive_questions_in_work_answers_them_and_ends_in_time(held: HeldWork) -> None:
    with running(held=held, PRICING_GRACE_SECONDS="2") as server, ExitStack() as stack:
        questions = [stack.enter_context(asked(server, HELD)) for _ in range(4)]
        slow = stack.enter_context(server.connect())
        slow.sendall(raw("/v1/price", QUESTION)[:-5])
        assert eventually(lambda: held.begun == 1)
        assert eventually(
            lambda: metric(server, "pricing_requests_in_flight") == 6.0
        )  # and the one that asks
        server.process.send_signal(signal.SIGTERM)
        for connection in (*questions, slow):
            answer = everything(connection)
            assert answer.startswith(b"HTTP/1.1 503 ")
            assert b"application/problem+json" in answer
        assert server.process.wait(PATIENCE) == 0


def test_a_log_that_nobody_reads_holds_nobody_up() -> None:
    with running() as server:
        server.pause_log()
        for _ in range(600):  # more than a pipe holds
            received = answer_to(server, b"GET /livez HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            assert received.startswith(b"HTTP/1.1 200 ")
        server.resume_log()
        assert eventually(lambda: len(server.log) > 500)
        assert server.stop() == 0


def test_a_killed_worker_is_replaced_and_the_others_go_on() -> None:
    statuses: list[int | None] = []

    def ask() -> None:
        try:
            statuses.append(server.request("POST", "/v1/price", QUESTION)[0])
        except (OSError, http.client.HTTPException):
            statuses.append(None)  # the killed worker's

    with running("--workers", "2") as server:
        assert eventually(lambda: len(children(server.process.pid)) == 2)
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        with asking(4, ask):
            assert eventually(lambda: len(statuses) > 20)
            killed = children(server.process.pid)[0]
            os.kill(killed, signal.SIGKILL)
            assert eventually(lambda: killed not in (now := children(server.process.pid)) and len(now) == 2)
            before = len(statuses)
            assert eventually(lambda: len(statuses) > before + 20)
        assert set(statuses) <= {200, None}
        assert statuses.count(None) <= 4  # one request of each client at most
        assert server.stop() == 0
    died = [line for line in server.log if line["message"] == "a worker has died"]
    assert [(line["process"], line["status"]) for line in died] == [(killed, -signal.SIGKILL)]


@pytest.mark.parametrize("ready", [False, True])
def test_workers_end_when_their_parent_is_killed(ready: bool) -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: len(children(server.process.pid)) == 2)
        workers = children(server.process.pid)
        assert not ready or eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        server.process.kill()
        server.process.wait(PATIENCE)
        assert eventually(lambda: not any(os.path.exists(f"/proc/{worker}") for worker in workers))
