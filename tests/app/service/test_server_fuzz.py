"""Extreme and broken bodies to all routes of a real server: honest answers within the deadline, never a 500."""

import http.client
import json
import threading
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.app.service.extreme_bodies import Body, bodies, value_bounds
from tests.app.service.server_process import (
    Server,
    running,
)
from tests.problems.eventually import PATIENCE
from tests.problems.needs_kernel import needs_kernel

DEADLINE = 0.5
CLIENTS = 2  # as many as the server has threads, so that nobody waits for one
STATUSES = {200, 400, 408, 413, 415, 422, 503}
ROUNDING = 1e-12
MOST_MEMORY = 600e6  # bytes of the process; chosen
pytestmark = needs_kernel


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    settings = {"PRICING_DEADLINE_SECONDS": str(DEADLINE), "PRICING_BATCH_DEADLINE_SECONDS": str(DEADLINE)}
    with running(**settings, PRICING_CLIENT_QUEUE="64") as server:
        yield server


def ask(port: int, body: Body) -> tuple[int, str, Any]:
    """Return status, media type and the answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    try:
        connection.request("POST", body.path, body.raw, {"Content-Type": body.media_type})
        answer = connection.getresponse()
        raw, media_type = answer.read(), answer.headers["Content-Type"]
        lines = raw.splitlines() if media_type.endswith("ndjson") else [raw]
        found = [json.loads(line, parse_constant=pytest.fail) for line in lines]
        return answer.status, media_type, found if media_type.endswith("ndjson") else found[0]
    finally:
        connection.close()


def check_price(question: dict[str, Any], found: dict[str, Any]) -> None:
    least, most = value_bounds(question)
    rounding = ROUNDING * max(question["spot"], question["strike"])
    assert found["status"] in ("ok", "tolerance_not_met", "deadline")
    assert least - rounding <= found["price"] <= most * (1.0 + ROUNDING) + rounding
    assert found["error_estimate"] >= 0.0
    if found["status"] == "ok":
        assert found["error_estimate"] <= question["tolerance"] * question["strike"]


def check_boundary(question: dict[str, Any], found: dict[str, Any]) -> None:
    if question.get("dividend_model") == "escrowed" and question["option_type"] == "call":
        return  # where the escrow exceeds the strike every spot is exercised
    sign = 1.0 if question["option_type"] == "put" else -1.0
    for spot in found["boundary"]:
        assert spot is None or sign * (spot - question["strike"]) <= 1e-9 * question["strike"]


def check_search(question: dict[str, Any], found: dict[str, Any]) -> None:
    assert found["status"] in (
        "ok",
        "below_lower_bound",
        "above_upper_bound",
        "not_identifiable",
        "no_convergence",
    )
    if found["status"] == "ok":
        assert 0.0 <= found["volatility"] <= 15.0
        allowed = found["error_estimate"] + question["tolerance"] * question["strike"]
        assert abs(found["price"] - question["option_price"]) <= allowed * (1.0 + 1e-9)


def check_surface(question: dict[str, Any], found: dict[str, Any]) -> None:
    assert found["status"] in ("ok", "tolerance_not_met")
    for spot, value in zip(question["spots"], found["value"][0], strict=True):
        if value is not None and question["times"][0] == 0.0:
            check_price_alone(question | {"spot": spot}, value)


def check_price_alone(question: dict[str, Any], value: float) -> None:
    least, most = value_bounds(question)
    rounding = ROUNDING * max(question["spot"], question["strike"])
    assert least - rounding <= value <= most * (1.0 + ROUNDING) + rounding


def check_advice(question: dict[str, Any], found: dict[str, Any]) -> None:
    assert found["status"] in ("ok", "tolerance_not_met")
    error = found["probability_error"]
    parts = [found[name] for name in ("probability", "exercised_at_expiry", "expires_worthless")]
    assert error >= 0.0
    assert abs(sum(parts) - 1.0) <= error + 1e-9
    assert all(-error <= part <= 1.0 + error for part in parts)
    for name in ("cumulative_probability", "assignment_probability"):
        column = found[name]
        assert all(later >= earlier - error - 1e-12 for earlier, later in pairwise(column))
        assert all(-error <= chance <= 1.0 + error for chance in column)
    for cost, cost_error in zip(found["cost_of_waiting"], found["cost_error"], strict=True):
        assert cost >= -cost_error
    if found["expected_time"] is not None:
        assert (
            -1e-9
            <= found["expected_time"]
            <= question["expiry"] * (1.0 + error / found["probability"]) + 1e-9
        )


def check_rows(question: list[dict[str, Any]], found: Any) -> None:
    rows = found
    if isinstance(found, dict):
        columns = {name: column for name, column in found.items() if isinstance(column, list)}
        rows = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    assert len(rows) == len(question)
    for asked, row in zip(question, rows, strict=True):
        if row["price"] is not None:
            check_price(asked, row)
        else:
            assert row["status"] in ("invalid_input", "out_of_domain", "deadline")


CHECKS = {
    "/v1/price": check_price,
    "/v1/boundary": check_boundary,
    "/v1/implied-volatility": check_search,
    "/v1/surface": check_surface,
    "/v1/exercise-advice": check_advice,
    "/v1/batch": check_rows,
}


def check(body: Body, status: int, media_type: str, found: Any) -> None:
    """Hold an answer against what was asked."""
    assert status in STATUSES
    if status == 200:
        if body.question is not None:
            CHECKS[body.path](body.question, found)
        return
    assert media_type == "application/problem+json"
    assert found["status"] == status
    assert status != 503 or found["type"] == "/docs#deadline"
    assert len(json.dumps(found)) < 4_096


def answers(server: Server, asked: list[Body]) -> list[tuple[Body, int, str, Any]]:
    """Let several clients ask everything, in the order of `asked`."""
    found: list[tuple[Body, int, str, Any] | None] = [None] * len(asked)
    places = iter(range(len(asked)))

    def client() -> None:
        for place in places:
            found[place] = (asked[place], *ask(server.port, asked[place]))

    clients = [threading.Thread(target=client) for _ in range(CLIENTS)]
    for thread in clients:
        thread.start()
    for thread in clients:
        thread.join()
    return [one for one in found if one is not None]


def peak_memory(server: Server) -> float:
    """Return the most bytes that the process has had in memory."""
    status = Path(f"/proc/{server.process.pid}/status").read_text(encoding="ascii")
    return 1024.0 * int(status.partition("VmHWM:")[2].split()[0])


@pytest.mark.parametrize("count", [120, pytest.param(2_500, marks=pytest.mark.nightly)])
def test_extreme_bodies_are_answered_honestly_within_the_deadline(server: Server, count: int) -> None:
    asked = bodies(count, seed=count)
    found = answers(server, asked)
    assert len(found) == count
    statuses = Counter[int]()
    for body, status, media_type, answer in found:
        statuses[status] += 1
        shown = f"{body.path} {body.raw[:2_000]!r}: {status} {str(answer)[:600]}"
        try:
            check(body, status, media_type, answer)
        except AssertionError as fault:
            raise AssertionError(f"{fault}\n{shown}") from None
    assert peak_memory(server) < MOST_MEMORY
    assert server.request("GET", "/readyz")[0] == 200
    assert statuses[200] > 0.3 * count, statuses
    assert statuses[422] > 0.1 * count, statuses


@pytest.mark.parametrize("dates", [1, 365])
def test_what_is_promised_but_slow_is_never_called_out_of_the_domain(server: Server, dates: int) -> None:
    """A Bermudan put over 200 years under a yield of -50 %: what is known at the deadline, or that nothing is."""
    times = [200.0 * (k + 1) / (dates + 1) for k in range(dates)]
    question = {
        **{"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 200.0, "exercise": "bermudan"},
        **{
            "rate": 0.05,
            "dividend_yield": -0.5,
            "volatility": 0.3,
            "tolerance": 1e-6,
            "exercise_times": times,
        },
    }
    body = Body("/v1/price", json.dumps(question).encode(), question)
    status, media_type, found = ask(server.port, body)
    assert status in (200, 503), found
    check(body, status, media_type, found)
