"""A `pricing serve` process, and how to speak to it over sockets."""

import http.client
import json
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from tests.app.held_work import HELD_STRIKE, HeldWork
from tests.app.service.preloaded import Forked
from tests.problems.eventually import PATIENCE

QUESTION = {"option_type": "put", "spot": 100, "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
EXPENSIVE = QUESTION | {"tolerance": 1e-8, "greeks": "extended"}  # by what it is expected to cost
HELD = EXPENSIVE | {"strike": HELD_STRIKE}
# Limits that nothing meets by chance, however slow the machine is; the drain would only be waited for.
SETTINGS = {
    "PRICING_BODY_SECONDS": "3600",
    "PRICING_DEADLINE_SECONDS": "3600",
    "PRICING_BATCH_DEADLINE_SECONDS": "3600",
    "PRICING_DRAIN_SECONDS": "0",
    "PRICING_SLOTS": "2",
}


class Server:
    """A `pricing serve` process on a free port.

    Parameters
    ----------
    held : HeldWork, optional
        What the test holds of its work.
    """

    def __init__(self, *arguments: str, held: HeldWork | None = None, **settings: str) -> None:
        self.held = held
        environment = os.environ | SETTINGS | settings | (held.environment if held else {})
        self.process = Forked(["serve", "--port", "0", *arguments], environment, held is not None)
        self.log: list[dict[str, Any]] = [json.loads(self.process.stderr.readline())]
        self.port: int = self.log[0]["port"]
        self._reads = threading.Event()
        self._reads.set()
        self._reader = threading.Thread(target=self._read_log, daemon=True)
        self._reader.start()

    def _read_log(self) -> None:
        for line in self.process.stderr:
            self._reads.wait()
            # A signal while the event loop is being made lets the interpreter say a line of its own.
            if line.startswith("{"):
                self.log.append(json.loads(line))

    def pause_log(self) -> None:
        """Leave the pipe of the log to fill up."""
        self._reads.clear()

    def resume_log(self) -> None:
        """Empty it again."""
        self._reads.set()

    def request(self, method: str, path: str, body: object = None, **headers: str) -> tuple[int, Any, Any]:
        """Return status, headers and parsed body of one request on a connection of its own."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        try:
            raw = None if body is None else json.dumps(body)
            connection.request(method, path, raw, {"Content-Type": "application/json"} | headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, json.loads(answer.read())
        finally:
            connection.close()

    def connect(self) -> socket.socket:
        """Return a new connection."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE)

    def is_refused(self) -> bool:
        """Tell whether a new connection is refused."""
        try:
            self.connect().close()
        except ConnectionRefusedError:
            return True
        return False

    def stop(self) -> int:
        """Release what is held, send SIGTERM and return the exit status."""
        if self.held is not None:
            self.held.release()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            status = self.process.wait(PATIENCE)
        finally:
            self.process.kill()  # where it has not ended
        self._reader.join(PATIENCE)
        assert not self._reader.is_alive(), "another process holds the log open"
        self.process.stderr.close()
        return status


@contextmanager
def running(*arguments: str, held: HeldWork | None = None, **settings: str) -> Iterator[Server]:
    server = Server(*arguments, held=held, **settings)
    try:
        yield server
    finally:
        server.stop()


def answer_to(server: Server, *parts: bytes) -> bytes:
    """Send raw bytes, and return all that comes until the server closes the connection."""
    with server.connect() as connection:
        with suppress(ConnectionError):  # it may close before it has read them all
            for part in parts:
                connection.sendall(part)
        return everything(connection)


def everything(connection: socket.socket) -> bytes:
    """Return all that comes until the server closes the connection."""
    received = b""
    with suppress(ConnectionResetError):
        while block := connection.recv(65_536):
            received += block
    return received


JSON = "Content-Type: application/json"


def head(length: str) -> bytes:
    return f"POST /v1/price HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{length}\r\n{JSON}\r\n\r\n".encode()


def raw(path: str, body: object) -> bytes:
    text = json.dumps(body).encode()
    length = f"Content-Length: {len(text)}\r\nContent-Type: application/json\r\n"
    return f"POST {path} HTTP/1.1\r\nHost: x\r\n{length}\r\n".encode() + text


@contextmanager
def asking(count: int, ask: Callable[[], object]) -> Iterator[None]:
    """Let so many clients ask meanwhile, each one question after the other."""
    stop = threading.Event()

    def client() -> None:
        while not stop.is_set():
            ask()

    threads = [threading.Thread(target=client) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def metric(server: Server, name: str, **labels: str) -> float:
    """Return the sum of the samples with these labels."""
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)) as connection:
        connection.request("GET", "/metrics")
        text = connection.getresponse().read().decode()
    return sum(
        sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == name and labels.items() <= sample.labels.items()
    )


def children(process: int) -> list[int]:
    with open(f"/proc/{process}/task/{process}/children", encoding="ascii") as file:
        return [int(word) for word in file.read().split()]
