"""What operators rely on, shown on real servers: keys, metrics, workers, shutdown and clients that misbehave."""

import hashlib
import http.client
import json
import os
import re
import signal
import socket
import threading
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.app.held_work import HeldWork
from tests.app.service.server_process import (
    HELD,
    QUESTION,
    Server,
    children,
    everything,
    head,
    metric,
    raw,
    running,
)
from tests.problems.eventually import PATIENCE, eventually
from tests.problems.needs_kernel import needs_kernel

SHORT = b"GET /livez HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
pytestmark = needs_kernel


def metric_folder(server: Server) -> str:
    """Return the folder in which the workers of a server keep their metrics."""
    with open(f"/proc/{children(server.process.pid)[0]}/maps", encoding="utf-8") as file:
        (folder,) = set(re.findall(r"(/\S*/pricing-metrics-[^/]*)/", file.read()))
    return str(folder)


def priced(server: Server) -> float:
    return metric(server, "pricing_contracts_total", route="/v1/price", status="ok")


def test_a_key_is_wanted_over_a_socket_and_the_rest_of_a_refused_body_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    path.write_text(f"desk {hashlib.sha256(b'pk_one').hexdigest()}\n")
    with running(PRICING_API_KEYS_FILE=str(path)) as server:
        assert server.request("POST", "/v1/price", QUESTION, Authorization="Bearer pk_one")[0] == 200
        status, headers, body = server.request("POST", "/v1/price", QUESTION, Authorization="Bearer pk_two")
        assert (status, body["type"]) == (401, "/docs#unauthorized")
        assert headers["WWW-Authenticate"] == 'Bearer realm="pricing", error="invalid_token"'
        with server.connect() as connection:
            connection.sendall(head("Content-Length: 60000")[:-2].replace(b"close", b"keep-alive") + b"\r\n")
            assert everything(connection).startswith(b"HTTP/1.1 401 ")  # and it is closed
        for probe in ("/livez", "/readyz", "/version"):
            assert server.request("GET", probe)[0] == 200
        assert metric(server, "pricing_refusals_total", reason="unauthorized") == 2
        assert server.stop() == 0
    assert all("pk_" not in json.dumps(line) for line in server.log)


def test_workers_share_their_metrics_and_a_killed_one_takes_none_away() -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        folder = metric_folder(server)
        for _ in range(40):
            assert server.request("POST", "/v1/price", QUESTION)[0] == 200
        assert eventually(lambda: priced(server) == 40.0)
        assert metric(server, "pricing_build") == 1.0
        killed = children(server.process.pid)[0]
        os.kill(killed, signal.SIGKILL)
        assert eventually(lambda: killed not in (now := children(server.process.pid)) and len(now) == 2)
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        for _ in range(40):
            assert server.request("POST", "/v1/price", QUESTION)[0] == 200
        assert eventually(lambda: priced(server) == 80.0)
        assert eventually(lambda: metric(server, "pricing_requests_in_flight") == 1.0)  # the one that asks
        assert os.path.exists(folder)
        assert server.stop() == 0
    assert not os.path.exists(folder)


def test_the_metrics_of_workers_are_removed_when_their_parent_is_killed() -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        folder = metric_folder(server)
        assert os.path.exists(folder)
        server.process.kill()
        assert eventually(lambda: not os.path.exists(folder))


def keep_asking(server: Server, stop: threading.Event, ends: Counter[str], body: dict[str, Any]) -> None:
    """Ask on kept connections until the server takes no more, and count how each attempt ended."""
    connection = None
    while not stop.is_set():
        try:
            if connection is None:
                connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)
                connection.connect()
        except OSError:
            connection.close()
            ends["refused"] += 1
            return
        try:
            connection.request("POST", "/v1/price", json.dumps(body), {"Content-Type": "application/json"})
            answer = connection.getresponse()
            answer.read()
            ends[str(answer.status)] += 1
            if answer.getheader("Connection") == "close":
                connection.close()
                connection = None
        except (OSError, http.client.HTTPException) as error:
            ends[type(error).__name__] += 1
            connection.close()
            return


@pytest.mark.parametrize("workers", [1, 2])
def test_sigterm_under_load_answers_every_request_and_ends_with_status_0(
    workers: int, tmp_path: Path
) -> None:
    held = HeldWork(tmp_path / "held", last_seconds=2.0)
    settings = {"PRICING_DRAIN_SECONDS": "1", "PRICING_GRACE_SECONDS": "4"}
    with running("--workers", str(workers), held=held, **settings) as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        stop, ends = threading.Event(), Counter[str]()
        bodies = [QUESTION] * 6 + [HELD] * 3
        clients = [threading.Thread(target=keep_asking, args=(server, stop, ends, body)) for body in bodies]
        for client in clients:
            client.start()
        assert eventually(lambda: ends["200"] > 20 and held.begun > 0)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(PATIENCE) == 0
        stop.set()
        for client in clients:
            client.join()
    assert ends["503"] > 0  # what was in work
    assert set(ends) <= {"200", "503", "refused"}


def connect_and_ask(server: Server, ends: Counter[str]) -> None:
    """Ask on one new connection after the other until one is refused, and count how each attempt ended."""
    connected = False
    while not ends["refused"]:
        try:
            connected = False
            with server.connect() as connection:
                connected = True
                connection.sendall(SHORT)
                received = b""
                while block := connection.recv(65_536):
                    received += block
            ends[received[9:12].decode()] += 1
        except OSError as error:
            ends[type(error).__name__ if connected else "refused"] += 1


@pytest.mark.parametrize("workers", [1, 2])
def test_who_connects_in_the_last_instant_is_answered_or_refused_and_never_reset(
    workers: int, tmp_path: Path
) -> None:
    held = HeldWork(tmp_path / "held", last_seconds=2.0)
    with running("--workers", str(workers), held=held) as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        ends = Counter[str]()
        clients = [threading.Thread(target=connect_and_ask, args=(server, ends)) for _ in range(8)]
        for client in clients:
            client.start()
        assert eventually(lambda: ends["200"] > 20)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(PATIENCE) == 0
        for client in clients:
            client.join()
    assert set(ends) <= {"200", "503", "refused"}


def test_a_worker_that_is_told_to_stop_alone_is_replaced_and_clients_still_connect() -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        told = children(server.process.pid)[0]
        os.kill(told, signal.SIGTERM)
        assert eventually(lambda: told not in (now := children(server.process.pid)) and len(now) == 2)
        for _ in range(20):
            assert server.request("GET", "/readyz")[0] == 200


def test_after_the_drain_no_client_waits_in_the_queue_of_a_parent() -> None:
    with running("--workers", "2", PRICING_GRACE_SECONDS="60") as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        body = raw("/v1/price", QUESTION)
        with server.connect() as in_flight:
            in_flight.sendall(body[:-5])
            assert eventually(
                lambda: metric(server, "pricing_requests_in_flight") == 2.0
            )  # and the one that asks
            server.process.send_signal(signal.SIGTERM)
            assert eventually(server.is_refused)
            in_flight.sendall(body[-5:])
            assert everything(in_flight).startswith(b"HTTP/1.1 200 ")
        assert server.process.wait(PATIENCE) == 0


def test_a_client_that_does_not_read_its_answers_is_dropped() -> None:
    with running(PRICING_STALL_SECONDS="1") as server:
        with socket.socket() as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
            connection.connect(("127.0.0.1", server.port))
            connection.settimeout(PATIENCE)
            question = b"GET /openapi.json HTTP/1.1\r\nHost: x\r\n\r\n"
            with suppress(ConnectionError):  # it is dropped before it has sent them all, or later
                for _ in range(2_000):
                    connection.sendall(question)
            words = "a client was dropped that did not read its answer"
            assert eventually(lambda: any(line["message"] == words for line in server.log))
        assert server.request("GET", "/livez")[0] == 200
        assert eventually(lambda: metric(server, "pricing_connections") == 1.0)
        assert server.stop() == 0


def test_slow_clients_hold_nobody_up() -> None:
    with running() as server, ExitStack() as stack:
        slow = [stack.enter_context(server.connect()) for _ in range(80)]
        body = raw("/v1/price", QUESTION)
        for connection in slow:
            connection.sendall(body[:-20])
        for _ in range(20):
            assert server.request("POST", "/v1/price", QUESTION)[0] == 200
        for connection in slow:
            connection.sendall(body[-20:])
            assert connection.recv(65_536).startswith(b"HTTP/1.1 200 ")


def test_a_full_log_keeps_no_worker_from_being_replaced_and_no_signal_from_being_heard() -> None:
    with running("--workers", "2") as server:
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        server.pause_log()
        for _ in range(900):
            with server.connect() as connection:
                connection.sendall(SHORT)
                assert everything(connection).startswith(b"HTTP/1.1 200 ")
        for killed in children(server.process.pid):
            os.kill(killed, signal.SIGKILL)
            assert eventually(lambda: killed not in (now := children(server.process.pid)) and len(now) == 2)  # noqa: B023
        assert eventually(lambda: server.request("GET", "/readyz")[0] == 200)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(PATIENCE) == 0
        server.resume_log()


def test_a_proxy_s_network_is_trusted_and_its_connections_are_not_counted_as_one_client_s() -> None:
    settings = {"PRICING_TRUSTED_PROXIES": "192.0.2.1, 127.0.0.0/8", "PRICING_CLIENT_CONNECTIONS": "2"}
    with running(**settings) as server, ExitStack() as stack:
        opened = [stack.enter_context(server.connect()) for _ in range(5)]
        server.request("GET", "/livez", **{"X-Forwarded-For": "198.51.100.7", "X-Request-ID": "proxied"})
        for connection in opened:
            connection.sendall(SHORT)
            assert everything(connection).startswith(b"HTTP/1.1 200 ")
        assert eventually(lambda: any(line.get("request_id") == "proxied" for line in server.log))
    (line,) = [line for line in server.log if line.get("request_id") == "proxied"]
    assert line["client"] == "198.51.100.7"


def test_the_line_of_a_request_says_what_was_done() -> None:
    trace = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    with running() as server:
        headers = {"X-Request-ID": "one", "traceparent": trace}
        assert server.request("POST", "/v1/price", QUESTION, **headers)[0] == 200
        hard = QUESTION | {
            "cash_dividends": [{"time": 0.3, "amount": 200}],
            "tolerance": 1e-7,
            "greeks": "extended",
        }
        server.request("POST", "/v1/price", hard, **{"X-Request-ID": "two", "traceparent": "00-" + "0" * 40})
        server.request("POST", "/v1/price", {}, **{"X-Request-ID": "three"})
        assert server.stop() == 0
    lines = {line["request_id"]: line for line in server.log if line["message"] == "request"}
    first = lines["one"]
    assert first["traceparent"] == trace
    assert (
        first.items()
        >= {"client": "127.0.0.1", "method": "POST", "route": "/v1/price", "status": 200}.items()
    )
    assert (first["engine"], first["contracts"]) == ("premium-march", {"ok": 1})
    assert 0.0 < first["cost"] < 2e-3
    assert first["seconds"] > 0.0
    assert "traceparent" not in lines["two"]
    assert lines["three"]["problem"] == "invalid-input"
    assert "engine" not in lines["three"]
