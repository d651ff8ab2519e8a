"""Clients of the service and the servers that they ask, on one machine; requests are random puts, all Greeks."""

import asyncio
import contextlib
import http.client
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from benchmarks.problems.hostile_questions import SEARCH
from pricing_core.american import price_many

HOST = "127.0.0.1"
JSON, LINES, ARROW = FORMS = (
    "application/json",
    "application/x-ndjson",
    "application/vnd.apache.arrow.stream",
)
AT_ONCE = {"PRICING_DRAIN_SECONDS": "0"}  # a server need not wait for a load balancer when it ends
HOSTILE = 20
IDLE = 500
CONNECTIONS = 64  # that arrivals at a fixed rate use; fewer than the service lets one address have
SERVE = "import sys; from app.cli import main; sys.argv = ['pricing', 'serve', '--port', '0']; main()"
# The same service, but for what a price costs: neither the cost model nor the engines are asked.
NO_OP = """
import app.service.routes.price as route
from app.service.work.cheap_lane import CheapLane
from pricing_core.american import Market, Option, price
constant = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2))
async def answer(*_):
    return constant
CheapLane.price = answer
route.is_cheap = lambda *_: True
route.checked_book = lambda *_: None
route.expected_seconds = lambda *_: 0.0
"""
CONSTANT = """
import asyncio, json, sys
answer = b"HTTP/1.1 200 OK\\r\\nContent-Length: 600\\r\\n\\r\\n" + 600 * b"x"
class Constant(asyncio.Protocol):
    def connection_made(self, transport):
        self.transport = transport
    def data_received(self, data):
        self.transport.write(answer)
async def main():
    server = await asyncio.get_running_loop().create_server(Constant, "127.0.0.1", 0)
    print(json.dumps({"port": server.sockets[0].getsockname()[1]}), file=sys.stderr, flush=True)
    await server.serve_forever()
asyncio.run(main())
"""


@contextlib.contextmanager
def server(program: str) -> Iterator[int]:
    """Run a program that says its port in a JSON line on standard error, and return that."""
    with server_process(program) as (port, _):
        yield port


@contextlib.contextmanager
def server_process(program: str) -> Iterator[tuple[int, int]]:
    """Run a program as `server` does, and return its port and the number of its process; its log goes to a file."""
    with (
        tempfile.NamedTemporaryFile("r", suffix=".log") as log,
        open(log.name, "w") as written,
        subprocess.Popen(
            [sys.executable, "-c", program], stderr=written, env=os.environ | AT_ONCE
        ) as process,
    ):
        try:
            line = ""
            while not (line := line + log.readline()).endswith("\n"):  # it may be there in part
                time.sleep(0.05)
            yield json.loads(line)["port"], process.pid
        finally:
            process.terminate()
            process.wait(60)


def megabytes(process: int) -> float:
    """Return the memory of a process and its children, pages that they share counted once."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    kilobytes = 0
    for one in (str(process), *children):
        lines = Path(f"/proc/{one}/smaps_rollup").read_text().splitlines()
        kilobytes += next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return kilobytes / 1e3


class Connection(asyncio.Protocol):
    """One connection, one request at a time: as little work as will do."""

    def __init__(self) -> None:
        self._received = b""
        self._answer: asyncio.Future[int] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self.transport: asyncio.Transport = transport  # type: ignore[assignment]

    def data_received(self, data: bytes) -> None:
        """Collect one answer."""
        self._received += data
        head, end, body = self._received.partition(b"\r\n\r\n")
        if end and len(body) >= int(head.lower().partition(b"content-length: ")[2].split(b"\r\n")[0]):
            self._received = b""
            self._settle(int(head[9:12]))

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell whoever waits; 0 stands for no answer."""
        self._settle(0)

    def _settle(self, status: int) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(status)

    async def ask(self, request: bytes) -> int:
        """Send a request and return the status of its answer."""
        self._answer = asyncio.get_running_loop().create_future()
        self.transport.write(request)
        return await self._answer


@contextlib.asynccontextmanager
async def connection(port: int) -> AsyncIterator[Connection]:
    """Open a connection and close it again."""
    transport, protocol = await asyncio.get_running_loop().create_connection(Connection, HOST, port)
    try:
        yield protocol
    finally:
        transport.abort()


@dataclass
class Measured:
    """Latencies in seconds, statuses, and how long it took in all."""

    latencies: list[float] = field(default_factory=list)
    since_sent: list[float] = field(
        default_factory=list
    )  # where they count from when each was due: from its sending
    statuses: Counter[int] = field(default_factory=Counter)
    seconds: float = 0.0

    @property
    def rate(self) -> float:
        """Answers with status 200 in a second."""
        return self.statuses[200] / self.seconds

    def milliseconds(self, percentile: float) -> float:
        """Return a percentile of the latencies."""
        return 1e3 * float(np.percentile(self.latencies, percentile))


def price_requests(count: int) -> list[bytes]:
    """Return random puts, all Greeks, as HTTP."""
    rng = np.random.default_rng(29)
    bodies = [
        {
            "option_type": "put",
            "strike": 100.0,
            "spot": round(float(rng.uniform(70.0, 130.0)), 4),
            "expiry": round(float(rng.uniform(0.1, 3.0)), 4),
            "rate": round(float(rng.uniform(0.0, 0.1)), 4),
            "volatility": round(float(rng.uniform(0.1, 0.6)), 4),
        }
        for _ in range(count)
    ]
    return [as_http("/v1/price", body) for body in bodies]


def as_http(path: str, body: object) -> bytes:
    """Return a POST request."""
    raw = json.dumps(body).encode()
    head = f"POST {path} HTTP/1.1\r\nHost: {HOST}\r\nContent-Type: application/json\r\nContent-Length: {len(raw)}"
    return head.encode() + b"\r\n\r\n" + raw


async def closed_loop(port: int, clients: int, seconds: float, requests: list[bytes]) -> Measured:
    """Let each client ask again when it has its answer."""
    measured, begun = Measured(), time.perf_counter()
    end = begun + seconds

    async def client(number: int) -> None:
        async with connection(port) as asked:
            place = number * 37
            while (at := time.perf_counter()) < end:
                place = (place + 1) % len(requests)
                measured.statuses[await asked.ask(requests[place])] += 1
                measured.latencies.append(time.perf_counter() - at)

    await asyncio.gather(*map(client, range(clients)))
    measured.seconds = time.perf_counter() - begun
    return measured


async def open_loop(port: int, rate: float, seconds: float, requests: list[bytes]) -> Measured:
    """Ask at a fixed rate, on the connection that is free first; latencies count from the time that was due."""
    measured = Measured()
    free: asyncio.LifoQueue[Connection] = asyncio.LifoQueue()

    async def ask(due: float, request: bytes) -> None:
        asked = await free.get()
        if asked.transport.is_closing():  # it was idle for too long
            asked = await opened.enter_async_context(connection(port))
        sent = time.perf_counter()
        measured.statuses[await asked.ask(request)] += 1
        measured.latencies.append(time.perf_counter() - due)
        measured.since_sent.append(time.perf_counter() - sent)
        free.put_nowait(asked)

    async with contextlib.AsyncExitStack() as opened, asyncio.TaskGroup() as group:
        for _ in range(min(CONNECTIONS, int(rate))):
            free.put_nowait(await opened.enter_async_context(connection(port)))
        begun = time.perf_counter()
        for number in range(int(rate * seconds)):
            due = begun + number / rate
            if (early := due - time.perf_counter()) > 0.0:
                await asyncio.sleep(early)
            group.create_task(ask(due, requests[number % len(requests)]))
    measured.seconds = time.perf_counter() - begun
    return measured


async def beside_hostile(port: int, seconds: float, requests: list[bytes]) -> tuple[Measured, Counter[int]]:
    """Let one client ask 20 times a second beside hostile ones; return what it sees, and what they are answered."""
    statuses: Counter[int] = Counter()
    hostile = as_http("/v1/implied-volatility", SEARCH)

    async def attack() -> None:
        while True:
            with contextlib.suppress(OSError):
                async with connection(port) as asked:
                    while status := await asked.ask(hostile):
                        statuses[status] += 1

    tasks = [asyncio.create_task(attack()) for _ in range(HOSTILE)]
    await asyncio.sleep(1.0)
    measured = await open_loop(port, 20.0, seconds, requests)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return measured, statuses


async def beside_idle(port: int, seconds: float, requests: list[bytes]) -> Measured:
    """Let one client ask 20 times a second beside idle connections."""
    async with contextlib.AsyncExitStack() as idle:
        for _ in range(IDLE):
            await idle.enter_async_context(connection(port))
        return await open_loop(port, 20.0, seconds, requests)


def rows_of(form: str, count: int) -> int:
    """Return how many rows a batch has here: one JSON object may not be as long as the others."""
    return count // 5 if form == JSON else count


def flat_book(count: int) -> dict[str, Any]:
    """Return random puts in columns."""
    rng = np.random.default_rng(30)
    ranges = {"spot": (70.0, 130.0), "expiry": (0.1, 3.0), "rate": (0.0, 0.1), "volatility": (0.1, 0.6)}
    columns = {name: rng.uniform(*limits, count) for name, limits in ranges.items()}
    return {"option_type": np.full(count, "put"), "strike": np.full(count, 100.0), **columns}


def batch_body(book: dict[str, Any], form: str) -> bytes:
    """Return a table as the body of a batch."""
    table = pa.table(book)
    if form == ARROW:
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema) as stream:
            stream.write_table(table)
        return bytes(sink.getvalue())
    if form == LINES:
        return "\n".join(map(json.dumps, table.to_pylist())).encode()
    return json.dumps(table.to_pydict()).encode()


def batch_seconds(port: int, body: bytes, form: str) -> tuple[float, int]:
    """Return how long the answer to a batch takes, and how many bytes it has."""
    with contextlib.closing(http.client.HTTPConnection(HOST, port, timeout=90)) as asked:
        begun = time.perf_counter()
        asked.request("POST", "/v1/batch", body, {"Content-Type": form})
        answer = asked.getresponse()
        size = len(answer.read())
        if answer.status != 200:
            raise RuntimeError(f"a batch was answered {answer.status}")
        return time.perf_counter() - begun, size


class BatchAnswer(NamedTuple):
    """Medians for batches of one form, beside `price_many` of the same arrays in turns; megabytes."""

    form: str
    rows: int
    seconds: float
    over_price_many: float
    sent_MB: float
    received_MB: float


def batch_answers(port: int, count: int, repeats: int) -> Iterator[BatchAnswer]:
    """Ask for batches in every form."""
    for form in FORMS:
        rows = rows_of(form, count)
        book = flat_book(rows)
        body = batch_body(book, form)
        batch_seconds(port, body, form)  # to warm up
        times, ratios, size = [], [], 0
        for _ in range(repeats):
            begun = time.perf_counter()
            price_many(book)
            alone = time.perf_counter() - begun
            seconds, size = batch_seconds(port, body, form)
            times.append(seconds)
            ratios.append(seconds / alone)
        seconds, ratio = float(np.median(times)), float(np.median(ratios))
        yield BatchAnswer(form, rows, seconds, ratio, 1e-6 * len(body), 1e-6 * size)


async def beside_batches(port: int, seconds: float, requests: list[bytes], count: int) -> Measured:
    """Let one client ask 20 times a second beside another one of its address that sends batches without a pause."""
    bodies = {form: batch_body(flat_book(rows_of(form, count)), form) for form in FORMS}
    stop = False

    def send() -> None:
        while not stop:
            for form, body in bodies.items():
                batch_seconds(port, body, form)

    sending = asyncio.create_task(asyncio.to_thread(send))
    try:
        return await open_loop(port, 20.0, seconds, requests)
    finally:
        stop = True
        await sending
