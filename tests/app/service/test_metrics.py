import json
import os
import subprocess
import sys
from typing import Any

import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from app.main import create_app
from app.service.metrics import FOLDER, shared_folder
from app.settings import Settings


def metrics_of(text: str) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def value(found: dict[Any, float], name: str, **labels: str) -> float:
    return found[name, frozenset(labels.items())]


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch, unhurried: None):
    monkeypatch.setattr("app.service.metrics.LEAST_SECONDS", 0.0)
    with TestClient(create_app(Settings(slots=2))) as client:
        yield client


def test_every_request_is_counted_by_the_template_of_its_route(
    client: TestClient, question: dict[str, Any]
) -> None:
    for _ in range(3):
        assert client.post("/v1/price", json=question).status_code == 200
    client.post("/v1/price", json=question | {"tolerance": 1e-8, "greeks": "extended"})
    client.post("/v1/price", json=question | {"volatility": -1})
    client.post("/v1/price", content=b"x")
    client.head("/livez")
    for number in range(5):
        client.get(f"/nowhere/{number}")
    answer = client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    found = metrics_of(answer.text)
    assert value(found, "pricing_requests_total", route="/v1/price", status="200") == 4
    assert value(found, "pricing_requests_total", route="/v1/price", status="422") == 1
    assert value(found, "pricing_requests_total", route="/livez", status="200") == 1
    assert value(found, "pricing_requests_total", route="none", status="404") == 5
    assert value(found, "pricing_request_seconds_count", route="/v1/price") == 6
    assert value(found, "pricing_contracts_total", route="/v1/price", status="ok") == 4
    assert value(found, "pricing_refusals_total", reason="invalid-input") == 1
    assert value(found, "pricing_refusals_total", reason="unsupported-media-type") == 1
    assert value(found, "pricing_refusals_total", reason="not-found") == 5
    assert value(found, "pricing_queue_seconds_count") == 1
    assert value(found, "pricing_requests_in_flight") == 1  # the one that asks
    assert value(found, "pricing_expensive_questions") == 0
    assert not [key for key in found if "nowhere" in str(key)]


def test_every_row_of_a_batch_is_counted_by_its_status(client: TestClient, question: dict[str, Any]) -> None:
    rows = [question, question | {"volatility": -1}, question, "no row"]
    body = "".join(json.dumps(row) + "\n" for row in rows)
    answer = client.post("/v1/batch", content=body, headers={"Content-Type": "application/x-ndjson"})
    assert answer.status_code == 200
    found = metrics_of(client.get("/metrics").text)
    assert value(found, "pricing_contracts_total", route="/v1/batch", status="ok") == 2
    assert value(found, "pricing_contracts_total", route="/v1/batch", status="invalid_input") == 2


def test_a_deadline_is_counted(monkeypatch: pytest.MonkeyPatch, question: dict[str, Any]) -> None:
    dividends = [{"time": 0.5, "amount": 1.0}]
    two_boundaries = {"rate": -0.01, "dividend_yield": -0.03, "cash_dividends": dividends}
    hard = question | two_boundaries | {"tolerance": 1e-8}
    with TestClient(create_app(Settings(deadline_seconds=1e-6))) as client:
        assert client.post("/v1/price", json=hard).status_code == 503
        found = metrics_of(client.get("/metrics").text)
    assert value(found, "pricing_deadlines_total") == 1
    assert value(found, "pricing_refusals_total", reason="deadline") == 1


def test_asking_often_does_not_render_often(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.service.metrics.LEAST_SECONDS", 60.0)
    first = client.get("/metrics").text
    assert client.get("/metrics").text == first


def test_processes_share_a_folder_that_is_gone_afterwards() -> None:
    program = """
import sys
from app.service.metrics import Metrics, forget_process, share_as
from app.service.request_record import RequestRecord
share_as(int(sys.argv[1]))
metrics = Metrics()
metrics.in_flight.inc()
for _ in range(int(sys.argv[2])):
    metrics.request_ended("/v1/price", 200, 0.01, RequestRecord("a"))
if sys.argv[3:]:
    forget_process(1)
    print(metrics.text().decode())
"""

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        return done.stdout

    assert FOLDER not in os.environ
    with shared_folder():
        folder = os.environ[FOLDER]
        run("0", "2")
        run("1", "3")
        run("1", "4")  # takes the number of one that has ended
        found = metrics_of(run("2", "0", "tell"))
    assert value(found, "pricing_requests_total", route="/v1/price", status="200") == 9
    assert value(found, "pricing_request_seconds_count", route="/v1/price") == 9
    assert value(found, "pricing_requests_in_flight") == 2  # of 0 and 2: 1 has died
    assert not os.path.exists(folder)
    assert FOLDER not in os.environ
