"""Expensive and hostile questions to a real server: deadlines, clients that leave, limits, shutdown, workers."""

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.problems.hostile_questions import SEARCH
from tests.app.service.server_process import (
    QUESTION,
    Server,
    answer_to,
    children,
    eventually,
    everything,
    raw,
    running,
)
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
def server() -> Iterator[Server]:
    with running(PRICING_DEADLINE_SECONDS="1", PRICING_GRACE_SECONDS="5") as server:
        yield server


def asked(server: Server, path: str, body: object) -> socket.socket:
    """Return a connection on which a question has been asked."""
    connection = socket.create_connection(("127.0.0.1", server.port), timeout=30)
    connection.sendall(raw(path, body))
    return connection


def resident_megabytes(process: int) -> float:
    with open(f"/proc/{process}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.parametrize("name", BODIES)
def test_a_hostile_body_is_answered_honestly_within_the_deadline(server: Server, name: str) -> None:
    path, body = BODIES[name]
    begun = time.monotonic()
    status, headers, answer = server.request("POST", path, body)
    seconds = time.monotonic() - begun
    assert seconds < 1.3  # 5 % of the deadline, and what a busy machine adds
    if status == 200:
        assert answer["status"] in ("ok", "tolerance_not_met", "deadline")
        assert path != "/v1/price" or 0.0 <= answer["price"] <= body["strike"]
    else:
        assert (status, answer["type"]) in ((503, "/docs#deadline"), (422, "/docs#out-of-domain"))
        assert headers["Content-Type"] == "application/problem+json"
    assert resident_megabytes(server.process.pid) < 350.0


def test_a_client_that_leaves_ends_its_work() -> None:
    with running(PRICING_SLOTS="1", PRICING_DEADLINE_SECONDS="20") as server:
        with asked(server, "/v1/implied-volatility", SEARCH):
            time.sleep(0.1)  # of half a second that the search takes
        assert eventually(lambda: any(line.get("status") == 499 for line in server.log), 10.0)
        begun = time.monotonic()
        body = BODIES["366 cash dividends"][1] | {"tolerance": 1e-4}
        assert server.request("POST", "/v1/price", body)[0] == 200  # the one slot is free
        assert time.monotonic() - begun < 3.0


def test_an_honest_client_does_not_notice_hostile_ones_at_its_address(server: Server) -> None:
    stop = threading.Event()
    statuses: list[int] = []

    def attack() -> None:
        while not stop.is_set():
            with asked(server, "/v1/implied-volatility", SEARCH) as connection:
                statuses.append(int(connection.recv(65_536).split()[1]))
            stop.wait(0.05)

    hostile = [threading.Thread(target=attack) for _ in range(20)]
    for thread in hostile:
        thread.start()
    time.sleep(0.5)
    seconds, refused = [], 0
    for _ in range(100):
        begun = time.monotonic()
        refused += server.request("POST", "/v1/price", QUESTION)[0] != 200
        seconds.append(time.monotonic() - begun)
    stop.set()
    for thread in hostile:
        thread.join()
    assert refused == 0
    assert sorted(seconds)[90] < 0.3  # the benchmark measures it; here other tests run beside it
    assert set(statuses) <= {200, 429, 503}
    assert 429 in statuses


def test_an_address_at_its_limit_of_connections_loses_its_oldest_question() -> None:
    with running(PRICING_CLIENT_CONNECTIONS="3", PRICING_SLOTS="1", PRICING_DEADLINE_SECONDS="8") as server:
        busy = [asked(server, "/v1/implied-volatility", SEARCH) for _ in range(3)]
        time.sleep(0.3)
        assert server.request("POST", "/v1/price", QUESTION)[0] == 200
        assert b"/docs#client-limit" in everything(busy[0])
        for connection in busy:
            connection.close()


def test_an_address_is_what_a_named_proxy_says_it_is() -> None:
    settings = {"PRICING_SLOTS": "2", "PRICING_CLIENT_QUEUE": "1", "PRICING_DEADLINE_SECONDS": "3"}
    for trusted, expected in (("127.0.0.1", 200), ("", 429)):
        with (
            running(**settings, PRICING_TRUSTED_PROXIES=trusted) as server,
            asked(server, "/v1/implied-volatility", SEARCH),
        ):
            time.sleep(0.3)
            body, forwarded = BODIES["366 cash dividends"][1], {"X-Forwarded-For": "192.0.2.7"}
            status, headers, _ = server.request("POST", "/v1/price", body, **forwarded)
            assert status == expected
            assert (headers["Retry-After"] is not None) == (expected == 429)


def test_sigterm_with_expensive_questions_in_work_answers_them_and_ends_in_time() -> None:
    settings = {"PRICING_DEADLINE_SECONDS": "60", "PRICING_GRACE_SECONDS": "2", "PRICING_DRAIN_SECONDS": "0"}
    with running(**settings) as server:
        questions = [asked(server, "/v1/implied-volatility", SEARCH) for _ in range(4)]
        slow = socket.create_connection(("127.0.0.1", server.port), timeout=30)
        slow.sendall(raw("/v1/price", QUESTION)[:-5])
        time.sleep(0.5)
        begun = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        for connection in (*questions, slow):
            answer = everything(connection)
            assert answer.startswith((b"HTTP/1.1 200 ", b"HTTP/1.1 503 ", b"HTTP/1.1 408 "))
            assert b"application/problem+json" in answer or b'"status":"ok"' in answer
            connection.close()
        assert server.process.wait(30) == 0
        assert time.monotonic() - begun < 20.0  # 2.0 for the work and the rest for a slow machine


def test_a_log_that_nobody_reads_holds_nobody_up() -> None:
    with running() as server:
        os.kill(server.process.pid, 0)
        server.pause_log()
        for _ in range(600):  # more than a pipe holds
            received = answer_to(server, b"GET /livez HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            assert received.startswith(b"HTTP/1.1 200 ")
        server.resume_log()
        assert eventually(lambda: len(server.log) > 500)
        assert server.stop() == 0


def test_a_killed_worker_is_replaced_and_the_others_go_on() -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: len(children(server.process.pid)) == 2)
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        statuses: list[int | None] = []
        stop = threading.Event()

        def load() -> None:
            while not stop.is_set():
                try:
                    statuses.append(server.request("POST", "/v1/price", QUESTION)[0])
                except OSError:
                    statuses.append(None)  # the killed worker's
                except Exception:
                    statuses.append(None)

        threads = [threading.Thread(target=load) for _ in range(4)]
        for thread in threads:
            thread.start()
        time.sleep(0.5)
        killed = children(server.process.pid)[0]
        os.kill(killed, signal.SIGKILL)
        assert eventually(
            lambda: len(children(server.process.pid)) == 2 and killed not in children(server.process.pid)
        )
        time.sleep(0.5)
        stop.set()
        for thread in threads:
            thread.join()
        assert set(statuses) <= {200, None}
        assert statuses.count(None) <= 4  # one request of each client at most
        assert statuses.count(200) > 20
        assert server.stop() == 0
    died = [line for line in server.log if line["message"] == "a worker has died"]
    assert [(line["process"], line["status"]) for line in died] == [(killed, -signal.SIGKILL)]


@pytest.mark.parametrize("ready", [False, True])
def test_workers_end_when_their_parent_is_killed(ready: bool) -> None:
    with running("--workers", "2", PRICING_DRAIN_SECONDS="0") as server:
        assert eventually(lambda: len(children(server.process.pid)) == 2)
        workers = children(server.process.pid)
        assert not ready or eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        server.process.kill()
        server.process.wait(10)
        assert eventually(lambda: not any(os.path.exists(f"/proc/{worker}") for worker in workers))
