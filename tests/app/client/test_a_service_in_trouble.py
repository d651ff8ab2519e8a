"""A service that restarts, refuses and lies, and what the client makes of it."""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from typing import Any

import pytest

from app.client import AsyncClient, BrokenAnswerError, Client, ServiceRefusedError, ServiceUnavailableError
from app.client.exchange import retry_after
from pricing_core.american import Market, Option, price
from pricing_core.errors import NumericalError
from tests.app.service.server_process import running
from tests.problems.eventually import PATIENCE

OPTION, MARKET = Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2)
JSON, PROBLEM = "application/json", "application/problem+json"
Script = list[tuple[int, dict[str, str], bytes]]
Asking = Callable[[str, int], Any]


class Liar(ThreadingHTTPServer):
    """Answers each request with the next lines of a script, whatever is asked; the last ones for ever."""

    daemon_threads = True

    def __init__(self, script: Script) -> None:
        self.script, self.asked = script, 0
        super().__init__(("127.0.0.1", 0), LiarsHandler)


class LiarsHandler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Liar

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        script, asked = self.server.script, self.server.asked
        status, headers, body = script[min(asked, len(script) - 1)]
        self.server.asked += 1
        self.send_response(status)
        usual = {"Content-Length": str(len(body)), "Content-Type": JSON, "Connection": "close"}
        for name, value in (usual | headers).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture
def liar() -> Iterator[Callable[[Script], tuple[Liar, str]]]:
    started: list[Liar] = []

    def start(script: Script) -> tuple[Liar, str]:
        server = Liar(script)
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        started.append(server)
        return server, f"http://127.0.0.1:{server.server_address[1]}"

    yield start
    for server in started:
        server.shutdown()
        server.server_close()


def ask_sync(address: str, attempts: int) -> Any:
    with Client(address, attempts=attempts, timeout=PATIENCE) as client:
        return client.price(OPTION, MARKET)


def ask_async(address: str, attempts: int) -> Any:
    async def ask() -> Any:
        async with AsyncClient(address, attempts=attempts, timeout=PATIENCE) as client:
            return await client.price(OPTION, MARKET)

    return asyncio.run(ask())


BOTH = pytest.mark.parametrize("ask", [ask_sync, ask_async])


@pytest.fixture(scope="module")
def answer() -> bytes:
    """What the service says of the question."""
    question = {
        "option_type": "put",
        "spot": 100,
        "strike": 100,
        "expiry": 1,
        "rate": 0.05,
        "volatility": 0.2,
    }
    with running() as server:
        found = server.request("POST", "/v1/price", question | {"greek_errors": True})
    return json.dumps(found[2]).encode()


def when_they_pause(monkeypatch: pytest.MonkeyPatch, pause: Callable[[float], object]) -> None:
    """Have the clients do something else where they leave a service alone for some seconds."""

    async def pause_elsewhere(seconds: float) -> None:
        await asyncio.to_thread(pause, seconds)

    monkeypatch.setattr("app.client.clients.time", SimpleNamespace(sleep=pause))
    monkeypatch.setattr("app.client.clients.asyncio", SimpleNamespace(sleep=pause_elsewhere))


@BOTH
@pytest.mark.parametrize("status", [429, 503, 502])
def test_a_busy_service_is_left_alone_for_as_long_as_it_says(
    liar: Any, answer: bytes, ask: Asking, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[tuple[float, int]] = []
    when_they_pause(monkeypatch, lambda seconds: pauses.append((seconds, server.asked)))
    busy = (status, {"Retry-After": "7", "Content-Type": PROBLEM}, b'{"title": "busy"}')
    server, address = liar([busy, busy, (200, {}, answer)])
    assert ask(address, 3).price == price(OPTION, MARKET).price
    assert pauses == [(7.0, 1), (7.0, 2)]  # after the first attempt, and after the second


@BOTH
def test_a_service_that_stays_busy_is_given_up_with_its_words(liar: Any, ask: Asking) -> None:
    busy = (503, {"Retry-After": "0", "Content-Type": PROBLEM}, b'{"detail": "every thread is busy"}')
    server, address = liar([busy])
    with pytest.raises(
        ServiceUnavailableError, match="no answer in 4 attempts: status 503: every thread is busy"
    ):
        ask(address, 4)
    assert server.asked == 4


@BOTH
@pytest.mark.parametrize(
    ("headers", "body", "words"),
    [
        ({"Retry-After": "86400"}, b"", "asks for 86400 s"),
        (
            {"Content-Type": PROBLEM},
            b'{"type": "/docs#deadline", "detail": "wider is faster"}',
            "wider is faster",
        ),
    ],
)
def test_what_would_take_too_long_is_not_asked_again(
    liar: Any, ask: Asking, headers: dict[str, str], body: bytes, words: str
) -> None:
    server, address = liar([(503, headers, body)])
    with pytest.raises(ServiceUnavailableError, match=words):
        ask(address, 5)
    assert server.asked == 1


@BOTH
@pytest.mark.parametrize(
    ("status", "headers", "body", "error", "words"),
    [
        (200, {"Content-Type": "text/html"}, b"<html>", BrokenAnswerError, "is text/html"),
        (200, {"Content-Type": ""}, b"{}", BrokenAnswerError, "of no kind"),
        (200, {}, b"<html>", BrokenAnswerError, "not JSON"),
        (200, {}, b'{"price": 6.0', BrokenAnswerError, "not JSON"),
        (200, {}, b"\xff\xfe", BrokenAnswerError, "not JSON"),
        (200, {}, b"[1, 2]", BrokenAnswerError, "not a JSON object"),
        (200, {}, b'{"price": 6.0}', BrokenAnswerError, "has no european_price"),
        (200, {}, b'{"price": "6.0"}', BrokenAnswerError, "price of the answer is not a number"),
        (200, {}, b'{"price": true}', BrokenAnswerError, "price of the answer is not a number"),
        (200, {}, b'{"price": NaN}', BrokenAnswerError, "price of the answer is not a number"),
        (302, {"Location": "http://127.0.0.1:9/"}, b"", ServiceRefusedError, "status 302"),
        (404, {"Content-Type": "text/html"}, b"<html>", ServiceRefusedError, "status 404: Not Found"),
        (422, {"Content-Type": PROBLEM}, b"[]", ServiceRefusedError, "status 422"),
        (500, {"Content-Type": PROBLEM}, b"{", ServiceRefusedError, "status 500"),
        (
            422,
            {"Content-Type": PROBLEM},
            b'{"type": "/docs#out-of-domain", "detail": "far"}',
            NumericalError,
            "far",
        ),
    ],
)
def test_a_lie_is_told_and_not_asked_for_again(
    liar: Any,
    ask: Asking,
    status: int,
    headers: dict[str, str],
    body: bytes,
    error: type[Exception],
    words: str,
) -> None:
    server, address = liar([(status, headers, body)])
    with pytest.raises(error, match=words):
        ask(address, 3)
    assert server.asked == 1


@BOTH
def test_an_answer_that_is_cut_short_is_asked_for_again(liar: Any, answer: bytes, ask: Asking) -> None:
    cut = (200, {"Content-Length": str(len(answer))}, answer[: len(answer) // 2])
    _, address = liar([cut, (200, {}, answer)])
    assert ask(address, 3).price == price(OPTION, MARKET).price
    _, address = liar([cut])
    with pytest.raises(ServiceUnavailableError, match="RemoteProtocolError"):
        ask(address, 2)


@pytest.mark.parametrize("size", [0, 7, 200])
def test_an_arrow_stream_that_is_none_is_told(liar: Any, size: int) -> None:
    kind = {"Content-Type": "application/vnd.apache.arrow.stream"}
    _, address = liar([(200, kind, b"\x00" * size)])
    columns = {"option_type": "put", "spot": [100.0], "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    with Client(address, attempts=1) as client, pytest.raises(BrokenAnswerError, match=r"Arrow|rows"):
        client.price_many({**columns, "volatility": 0.2})


@BOTH
def test_a_service_that_restarts_is_found_again(ask: Asking, monkeypatch: pytest.MonkeyPatch) -> None:
    missed = threading.Event()

    def pause(seconds: float) -> None:
        missed.set()
        time.sleep(seconds)

    when_they_pause(monkeypatch, pause)
    with running() as server:
        address = f"http://127.0.0.1:{server.port}"
        before = ask(address, 1)
    found: list[Any] = []
    asking = threading.Thread(target=lambda: found.append(ask(address, 40)))
    asking.start()
    assert missed.wait(PATIENCE)
    with running("--port", str(server.port)):
        asking.join()
    assert found == [before]


@BOTH
def test_a_service_that_stays_away_is_given_up(ask: Asking) -> None:
    with running() as server:
        address = f"http://127.0.0.1:{server.port}"
    with pytest.raises(ServiceUnavailableError, match="no answer in 2 attempts: ConnectError"):
        ask(address, 2)


def test_the_time_of_another_attempt_may_be_a_date() -> None:
    seconds = retry_after(formatdate(time.time() + 100.0, usegmt=True))
    assert seconds is not None
    assert 95.0 <= seconds <= 100.0
    assert [retry_after(text) for text in ("0", "7", "", "-1", "1.5", "²")] == [
        0.0,
        7.0,
        None,
        None,
        None,
        None,
    ]
