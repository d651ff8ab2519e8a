"""A `pricing serve` process, and how to speak to it over sockets."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

QUESTION = {"option_type": "put", "spot": 100, "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
SETTINGS = {"PRICING_BODY_SECONDS": "1", "PRICING_DRAIN_SECONDS": "1", "PRICING_SLOTS": "2"}


class Server:
    """A `pricing serve` process on a free port."""

    def __init__(self, *arguments: str, **settings: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "app", "serve", "--port", "0", *arguments],
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | SETTINGS | settings,
        )
        assert self.process.stderr is not None
        self.log: list[dict[str, Any]] = [json.loads(self.process.stderr.readline())]
        self.port: int = self.log[0]["port"]
        self._reads = threading.Event()
        self._reads.set()
        self._reader = threading.Thread(target=self._read_log, daemon=True)
        self._reader.start()

    def _read_log(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._reads.wait()
            self.log.append(json.loads(line))

    def pause_log(self) -> None:
        """Leave the pipe of the log to fill up."""
        self._reads.clear()

    def resume_log(self) -> None:
        """Empty it again."""
        self._reads.set()

    def request(self, method: str, path: str, body: object = None, **headers: str) -> tuple[int, Any, Any]:
        """Return status, headers and parsed body of one request on a connection of its own."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            raw = None if body is None else json.dumps(body)
            connection.request(method, path, raw, {"Content-Type": "application/json"} | headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, json.loads(answer.read())
        finally:
            connection.close()

    def stop(self) -> int:
        """Send SIGTERM and return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(30)
        self._reader.join(10)
        assert not self._reader.is_alive(), "another process holds the log open"
        assert self.process.stderr is not None
        self.process.stderr.close()
        return status


@contextmanager
def running(*arguments: str, **settings: str) -> Iterator[Server]:
    server = Server(*arguments, **settings)
    try:
        yield server
    finally:
        server.stop()


def answer_to(server: Server, *parts: bytes, pause: float = 0.0) -> bytes:
    """Send raw bytes and return all that comes back until the server closes or has been silent for 1 s."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        for part in parts:
            connection.sendall(part)
            time.sleep(pause)
        received = b""
        try:
            while block := connection.recv(65_536):
                received += block
                connection.settimeout(1.0)
        except (TimeoutError, ConnectionResetError):
            pass
        return received


def everything(connection: socket.socket) -> bytes:
    """Return all that comes until the server closes the connection."""
    received = b""
    try:
        while block := connection.recv(65_536):
            received += block
    except ConnectionResetError:
        pass
    return received


JSON = "Content-Type: application/json"


def head(length: str) -> bytes:
    return f"POST /v1/price HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{length}\r\n{JSON}\r\n\r\n".encode()


def raw(path: str, body: object) -> bytes:
    text = json.dumps(body).encode()
    length = f"Content-Length: {len(text)}\r\nContent-Type: application/json\r\n"
    return f"POST {path} HTTP/1.1\r\nHost: x\r\n{length}\r\n".encode() + text


def eventually(holds: Callable[[], bool], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def children(process: int) -> list[int]:
    with open(f"/proc/{process}/task/{process}/children", encoding="ascii") as file:
        return [int(word) for word in file.read().split()]
