import json
import logging
import time
from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.main import WARM_UP, create_app
from app.service.envelope import LONGEST_PATH
from app.service.errors import PAUSE_SECONDS, ClientLimitError, OverloadedError
from app.service.logs import JsonFormatter
from app.settings import Settings
from pricing_core import __version__, kernel_name
from pricing_core.errors import InvalidInputError, IterationLimitError


@pytest.mark.parametrize("address", ["/livez", "/nowhere", "/docs", "/openapi.json"])
def test_every_answer_carries_security_headers_and_a_request_id(client: TestClient, address: str) -> None:
    headers = client.get(address).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["content-security-policy"].startswith("default-src 'none'")
    assert len(headers["x-request-id"]) == 32


def test_a_plain_request_id_is_kept(client: TestClient) -> None:
    assert (
        client.get("/livez", headers={"X-Request-ID": "trade-42.a_b"}).headers["x-request-id"]
        == "trade-42.a_b"
    )


@pytest.mark.parametrize("given", ["", "two words", "x" * 65, '"quoted"', "<script>"])
def test_any_other_request_id_is_replaced(client: TestClient, given: str) -> None:
    found = client.get("/livez", headers={"X-Request-ID": given}).headers["x-request-id"]
    assert found != given
    assert len(found) == 32


def test_one_json_line_is_logged_per_request(client: TestClient, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="pricing.requests"):
        client.get("/livez", headers={"X-Request-ID": "seen"})
    lines = [
        json.loads(JsonFormatter().format(record))
        for record in caplog.records
        if record.name == "pricing.requests"
    ]
    assert len(lines) == 1
    assert (
        lines[0].items() >= {"request_id": "seen", "method": "GET", "route": "/livez", "status": 200}.items()
    )
    assert lines[0]["seconds"] >= 0.0


def test_the_line_of_a_request_repeats_no_more_than_the_beginning_of_a_path(
    client: TestClient, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, logger="pricing.requests"):
        client.get("/" + "a" * 2_000)
    (fields,) = [record.fields for record in caplog.records if record.name == "pricing.requests"]  # type: ignore[attr-defined]
    assert fields["path"] == "/" + "a" * (LONGEST_PATH - 1)


def test_a_body_with_two_ways_to_end_is_refused_whoever_parses_it(client: TestClient) -> None:
    headers = {"Transfer-Encoding": "chunked", "Content-Length": "2", "Content-Type": "application/json"}
    answer = client.post("/v1/price", content=b"{}", headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (400, "/docs#bad-request")


@pytest.fixture
def raising(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> Callable[[Exception], TestClient]:
    def install(error: Exception) -> TestClient:
        def price(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr("app.service.routes.price.price", price)
        monkeypatch.setattr("app.service.work.admission.CHEAP_SECONDS", 0.0)
        return client

    return install


def test_an_unexpected_error_is_a_500_with_an_id_and_a_traceback_in_the_log_alone(
    raising: Any, question: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    client = raising(RuntimeError("the secret of the bank"))
    answer = client.post("/v1/price", json=question)
    assert answer.status_code == 500
    assert answer.json()["type"] == "/docs#internal-error"
    assert "secret" not in answer.text
    record = next(record for record in caplog.records if record.exc_info)
    text = JsonFormatter().format(record)  # in several lines where it is long
    lines = [json.loads(line) for line in text.splitlines()]
    assert {line["request_id"] for line in lines} == {answer.json()["request_id"]}
    assert "the secret of the bank" in text


def test_bad_input_found_by_the_library_is_a_422_without_the_value(
    raising: Any, question: dict[str, Any]
) -> None:
    client = raising(InvalidInputError("times", "secret", "between now and expiry"))
    answer = client.post("/v1/price", json=question)
    assert (answer.status_code, answer.json()["detail"]) == (422, "times must be between now and expiry")
    assert "secret" not in answer.text


def test_a_question_beyond_the_method_is_a_422_of_its_own_type(
    raising: Any, question: dict[str, Any]
) -> None:
    answer = raising(IterationLimitError("residual 3 after 100 sweeps")).post("/v1/price", json=question)
    assert (answer.status_code, answer.json()["type"]) == (422, "/docs#out-of-domain")
    assert "residual" not in answer.text


@pytest.mark.parametrize(
    ("error", "status"), [(ClientLimitError("too many"), 429), (OverloadedError("too many"), 503)]
)
def test_who_is_refused_waits_a_little_so_that_asking_again_at_once_is_no_use(
    raising: Any, question: dict[str, Any], error: Exception, status: int
) -> None:
    client = raising(error)
    begun = time.monotonic()
    assert client.post("/v1/price", json=question).status_code == status
    assert time.monotonic() - begun >= PAUSE_SECONDS


def test_readiness_turns_503_while_draining_and_liveness_does_not() -> None:
    app = create_app(Settings(retry_after_seconds=7))
    with TestClient(app) as client:
        assert client.get("/readyz").json()["status"] == "ready"
        app.state.draining.set()
        answer = client.get("/readyz")
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "7")
        assert answer.json()["type"] == "/docs#not-ready"
        alive = client.get("/livez")
        assert (alive.status_code, alive.headers["connection"]) == (200, "close")


def test_the_service_answers_nothing_before_it_has_priced_something(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def failing(*contract: object, **_: object) -> Any:
        asked.append(contract)
        raise IterationLimitError("no price today")

    monkeypatch.setattr("app.main.price_option", failing)
    with pytest.raises(IterationLimitError), TestClient(create_app(Settings())):
        pass
    assert asked == [WARM_UP]


def test_readiness_and_version_name_the_kernel(client: TestClient) -> None:
    for address in ("/readyz", "/version"):
        answer = client.get(address).json()
        assert (answer["version"], answer["kernel"]) == (__version__, kernel_name())
