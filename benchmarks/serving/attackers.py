"""Hostile clients of the service, one kind at a time, for some seconds; run as a process of its own.

`python -m benchmarks.serving.attackers SHAPE PORT SECONDS CONNECTIONS` prints the number of answers by status as JSON;
the shape "everything" is each of them in turn on every connection. It speaks to this machine alone.
"""

import itertools
import json
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from benchmarks.problems.hostile_questions import SEARCH

HOST = "127.0.0.1"
JSON, LINES, ARROW = "application/json", "application/x-ndjson", "application/vnd.apache.arrow.stream"
EVERYTHING = "everything"
MOST_BYTES = 1 << 24  # that one connection sends before it begins anew
UNREAD_SECONDS = 8.0  # for which an answer is left unread where that is the attack
CLIENTS = 128  # addresses from which is asked: 127.0.1.1 to 127.0.1.128
BOOK = {"option_type": "put", "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
PRICE = BOOK | {"spot": 100}
# Pairs take the longest to read for each byte.
PAYS = PRICE | {"cash_dividends": [[k, 0.01] for k in np.linspace(1e-4, 0.99, 280).round(4).tolist()]}
Stream = Callable[[], Iterator[bytes]]


class Shape(NamedTuple):
    """What is sent, and whether the answer is read."""

    stream: Stream
    reads: bool = True


def head(path: str, *lines: str, method: str = "POST") -> bytes:
    """Return the first lines of a request."""
    return "\r\n".join([f"{method} {path} HTTP/1.1", "Host: x", *lines, "", ""]).encode()


def chunked(path: str, chunk: bytes) -> Stream:
    """Return the stream of a body of equal chunks without an end."""

    def stream() -> Iterator[bytes]:
        yield head(path, f"Content-Type: {JSON}", "Transfer-Encoding: chunked")
        block = chunk * (16_384 // len(chunk))
        while True:
            yield block

    return stream


def endless(start: bytes, part: bytes) -> Stream:
    """Return the stream of a beginning and one part over and over."""

    def stream() -> Iterator[bytes]:
        yield start
        block = part * max(1, 16_384 // len(part))
        while True:
            yield block

    return stream


def bodies(path: str, kind: str, make: Callable[[], bytes]) -> Stream:
    """Return the stream of one request, to be answered."""
    body = cache(make)

    def stream() -> Iterator[bytes]:
        yield head(path, f"Content-Type: {kind}", f"Content-Length: {len(body())}") + body()

    return stream


def columns(**cells: object) -> bytes:
    """Return a batch as one JSON object."""
    return json.dumps({**BOOK, **cells}, separators=(",", ":")).encode()


def dictionaries(rows: int, length: int) -> bytes:
    """Return an Arrow stream of many rows that share one long text."""
    codes = pa.array(np.zeros(rows, dtype=np.int8))
    columns = {
        name: pa.array(np.full(rows, 1, dtype=np.int8)) for name in ("spot", "strike", "expiry", "rate")
    }
    texts = pa.DictionaryArray.from_arrays(codes, pa.array(["x" * length]))
    return _stream_of(pa.table({**columns, "volatility": columns["rate"], "option_type": texts}))


def batches(count: int, texts: int) -> bytes:
    """Return an Arrow stream of batches of one row, with large dictionaries of empty texts."""
    one = pa.array(np.full(1, 1, dtype=np.int8))
    columns = dict.fromkeys(("spot", "strike", "expiry", "rate", "volatility"), one)
    codes, empty = pa.array(np.zeros(1, dtype=np.int32)), pa.array([""] * texts)
    of_texts = pa.DictionaryArray.from_arrays(codes, empty)
    columns |= dict.fromkeys(("option_type", "exercise", "dividend_model", "valuation_date"), of_texts)
    rows = pa.record_batch(columns)
    return _stream_of(pa.Table.from_batches([rows] * count))


def control_characters(rows: int, length: int) -> bytes:
    """Return a chain as an Arrow stream, with a long note to every quote that JSON writes at six times its length."""
    note = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), pa.array(["\1" * length]))
    cells = {"expiration": "2026-12-18", "option_type": "put", "quote_date": "2026-01-02"}
    numbers = {"strike": 100.0, "bid": 1.0, "ask": 2.0, "underlying_price": 100.0}
    return _stream_of(
        pa.table({name: [cell] * rows for name, cell in (cells | numbers).items()} | {"note": note})
    )


def _stream_of(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return sink.getvalue().to_pybytes()  # type: ignore[no-any-return]


def shapes() -> Mapping[str, Shape]:
    """Return the shapes by name."""
    get = head("/livez", method="GET")
    wide = {f"{name}": 0 for name in ("dividend_yield", "borrow_rate", "settlement_lag", "quanto_covariance")}
    declared = head("/v1/batch", f"Content-Type: {LINES}", "Content-Length: 50000000")
    unread = bodies("/v1/chain?rate=0.04", ARROW, lambda: control_characters(150, 16_000))
    sparse = {"data": [{f"k{k}": 1} for k in range(20_000)]}
    read: dict[str, Stream] = {
        "tiny chunks to nowhere": chunked("/nowhere", b"1\r\n \r\n"),
        "tiny chunks of a question": chunked("/v1/price", b"1\r\n \r\n"),
        "tiny chunks of a batch": chunked("/v1/batch", b"1\r\n \r\n"),
        "chunk extensions": chunked("/v1/price", b"1;a=b\r\n \r\n"),
        "header lines": endless(b"GET /livez HTTP/1.1\r\nHost: x\r\n", b"a:b\r\n"),
        "one long header line": endless(b"GET /livez HTTP/1.1\r\nHost: x\r\na:", b"b"),
        "a long address": endless(b"GET /", b"a"),
        "empty lines": endless(get, b"\r\n"),
        "requests without waiting": endless(get, get),
        "trailers": endless(head("/nowhere", "Transfer-Encoding: chunked") + b"1\r\n \r\n0\r\n", b"a:b\r\n"),
        "after an upgrade": endless(
            head("/livez", "Connection: Upgrade", "Upgrade: websocket", method="GET"), b"\0"
        ),
        "rubbish": endless(b"", b"\xff"),
        "spots of many rows": bodies("/v1/batch", JSON, lambda: columns(spot=[1] * 99_999)),
        "wide columns": bodies("/v1/batch", JSON, lambda: columns(spot=[1] * 99_999, **wide)),
        "empty objects": bodies("/v1/batch", JSON, lambda: b'{"spot":[' + b"{}," * 600_000 + b"{}]}"),
        "deep lists": bodies("/v1/price", JSON, lambda: b'{"rate":' + b"[" * 400_000),
        "many keys": bodies(
            "/v1/price", JSON, lambda: json.dumps({f"k{k}": 1 for k in range(60_000)}).encode()
        ),
        "lines of nothing": bodies("/v1/batch", LINES, lambda: b"{}\n" * 300_000),
        "one text for all rows": bodies("/v1/batch", ARROW, lambda: dictionaries(1_000_000, 16_000)),
        "cells of a chain": bodies("/v1/chain?rate=0", "text/csv", lambda: b"," * (1 << 22)),
        "cheap questions": bodies("/v1/price", JSON, lambda: json.dumps(PRICE).encode()),
        "dividends in a short body": bodies("/v1/price", JSON, lambda: json.dumps(PAYS).encode()),
        "expensive questions": bodies("/v1/implied-volatility", JSON, lambda: json.dumps(SEARCH).encode()),
        "lines of a declared length": endless(declared, b"1\n"),
        "records with no name in common": bodies(
            "/v1/chain?rate=0", JSON, lambda: json.dumps(sparse).encode()
        ),
        "a dictionary with every batch": bodies("/v1/batch", ARROW, lambda: batches(2_000, 300_000)),
    }
    return {name: Shape(stream) for name, stream in read.items()} | {
        "a long answer that is not read": Shape(unread, reads=False)
    }


def attack(attacks: Sequence[Shape], port: int, seconds: float, connections: int) -> Counter[str]:
    """Attack over so many connections, each begun anew with the next shape when it is answered or closed."""
    end, answers = time.monotonic() + seconds, Counter[str]()

    def one(number: int) -> None:
        for place in itertools.count(number):
            if time.monotonic() >= end:
                return
            try:
                shape = attacks[place % len(attacks)]
                answers[_exchange(shape, port, end, f"127.0.1.{1 + number % CLIENTS}")] += 1
            except OSError:
                answers["closed"] += 1

    threads = [threading.Thread(target=one, args=(number,)) for number in range(connections)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def _exchange(shape: Shape, port: int, end: float, source: str) -> str:
    """Send until there is an answer, or enough, and return its status."""
    with socket.create_connection((HOST, port), timeout=5.0, source_address=(source, 0)) as connection:
        connection.setblocking(False)
        sent, waiting, parts = 0, b"", shape.stream()
        while time.monotonic() < end:
            try:
                if received := connection.recv(65_536 if shape.reads else 16):
                    if not shape.reads:
                        time.sleep(max(0.0, min(UNREAD_SECONDS, end - time.monotonic())))
                    return received.split(b" ", 2)[1].decode("ascii", "replace")
                return "closed"
            except BlockingIOError:
                pass
            waiting = waiting or (next(parts, b"") if sent < MOST_BYTES else b"")
            if not waiting:
                time.sleep(0.001)
                continue
            try:
                count = connection.send(waiting)
            except BlockingIOError:
                time.sleep(0.001)
                continue
            sent, waiting = sent + count, waiting[count:]
    return "unanswered"


if __name__ == "__main__":
    name, where, for_seconds, count = sys.argv[1:]
    found = [*shapes().values()] if name == EVERYTHING else [shapes()[name]]
    print(json.dumps(attack(found, int(where), float(for_seconds), int(count))))
