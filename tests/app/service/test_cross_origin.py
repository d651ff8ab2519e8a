import logging
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.settings import Settings, settings_from_environment
from pricing_core.errors import InvalidInputError

PAGE = "https://desk.example"
ASKS = {
    "Access-Control-Request-Method": "POST",
    "Access-Control-Request-Headers": "content-type,authorization",
}


def test_no_page_of_another_origin_may_ask_unless_that_is_set(
    client: TestClient, question: dict[str, Any]
) -> None:
    for answer in (
        client.options("/v1/price", headers={"Origin": PAGE} | ASKS),
        client.post("/v1/price", json=question, headers={"Origin": PAGE}),
    ):
        assert not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize(("origins", "told"), [(f"http://other.example:81, {PAGE}", PAGE), ("*", "*")])
def test_pages_of_named_origins_may_ask(question: dict[str, Any], origins: str, told: str) -> None:
    with TestClient(create_app(Settings(cors_origins=origins))) as client:
        first = client.options("/v1/price", headers={"Origin": PAGE} | ASKS)
        answer = client.post("/v1/price", json=question, headers={"Origin": PAGE})
        refused = client.post("/v1/price", json={}, headers={"Origin": PAGE})
    assert (first.status_code, answer.status_code, refused.status_code) == (200, 200, 422)
    assert "POST" in first.headers["access-control-allow-methods"]
    for one in (first, answer, refused):
        assert one.headers["access-control-allow-origin"] == told
        assert "access-control-allow-credentials" not in one.headers
        assert one.headers["x-content-type-options"] == "nosniff"
    assert "Retry-After" in answer.headers["access-control-expose-headers"]


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://elsewhere.example"} | ASKS,
        {"Origin": PAGE + ".elsewhere.example"} | ASKS,
        {"Origin": PAGE, "Access-Control-Request-Method": "DELETE"},
        {"Origin": PAGE, "Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "cookie"},
    ],
)
def test_others_are_refused_with_a_problem(headers: dict[str, str], caplog: pytest.LogCaptureFixture) -> None:
    with TestClient(create_app(Settings(cors_origins=PAGE))) as client, caplog.at_level(logging.INFO):
        answer = client.options("/v1/price", headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (400, "/docs#bad-request")
    assert "access-control-allow-origin" not in answer.headers or headers["Origin"] == PAGE
    assert not [record for record in caplog.records if record.exc_info]


@pytest.mark.parametrize(
    "origins", ["desk.example", "https://desk.example/page", "ftp://x", "https://", "https://a,b"]
)
def test_what_is_no_origin_is_refused(monkeypatch: pytest.MonkeyPatch, origins: str) -> None:
    monkeypatch.setenv("PRICING_CORS_ORIGINS", origins)
    with pytest.raises(InvalidInputError, match=r"PRICING_CORS_ORIGINS.*must be origins such as"):
        settings_from_environment()


@pytest.mark.parametrize("names", ["proxy.example", "*", "10.0.0.0/33", "10.0.0.1;10.0.0.2"])
def test_what_is_no_address_is_no_proxy(monkeypatch: pytest.MonkeyPatch, names: str) -> None:
    monkeypatch.setenv("PRICING_TRUSTED_PROXIES", names)
    with pytest.raises(InvalidInputError, match=r"PRICING_TRUSTED_PROXIES.*must be addresses or networks"):
        settings_from_environment()
