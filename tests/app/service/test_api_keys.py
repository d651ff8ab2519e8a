import hashlib
import json
import logging
import re
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.service import api_keys
from app.service.api_keys import LONGEST_KEY, ApiKey, KeyLimits, new_key, read_keys
from app.service.logs import JsonFormatter
from app.service.work.lanes import ExpensiveLane
from app.settings import Settings
from pricing_core.errors import InvalidInputError

KEY, OTHER = "pk_first", "pk_second"
EXPENSIVE = {"tolerance": 1e-8, "greeks": "extended"}


def line(name: str, key: str, limits: str = "") -> str:
    return f"{name} {hashlib.sha256(key.encode()).hexdigest()} {limits}".strip()


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    path = tmp_path / "keys"
    path.write_text(
        f"# who may ask\n{line('desk', KEY)}\n\n{line('risk', OTHER, 'client_queue=2')}  # and how much\n"
    )
    return path


@pytest.fixture
def client(keys: Path, unhurried: None):
    with TestClient(create_app(Settings(slots=2, api_keys_file=str(keys)))) as client:
        yield client


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


def test_a_new_key_is_let_in_by_its_line_and_is_not_in_it(tmp_path: Path, question: dict[str, Any]) -> None:
    key, written = new_key("desk-1")
    path = tmp_path / "keys"
    path.write_text(written)
    assert key not in written
    assert len({new_key("a")[0] for _ in range(100)}) == 100
    with TestClient(create_app(Settings(api_keys_file=str(path)))) as client:
        assert client.post("/v1/price", json=question, headers=bearer(key)).status_code == 200


def test_of_a_long_key_no_more_is_hashed_than_the_longest_has(
    client: TestClient, question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    hashed = []
    digest = api_keys._digest
    monkeypatch.setattr(api_keys, "_digest", lambda key: (hashed.append(len(key)), digest(key))[1])
    assert client.post("/v1/price", json=question, headers=bearer("k" * 10_000)).status_code == 401
    assert hashed == [LONGEST_KEY]


def test_the_command_prints_a_key_and_its_line(pricing: Any) -> None:
    status, output, _ = pricing("key", "desk-1")
    key, written = output.splitlines()
    assert (status, written) == (0, line("desk-1", key))
    status, output, errors = pricing("key", "two words")
    assert (status, output) == (2, "")
    assert errors.count("\n") == 1


def test_keys_are_read_with_their_limits(keys: Path) -> None:
    found = read_keys(str(keys))
    assert [(key.name, key.limits) for key in found] == [
        ("desk", KeyLimits()),
        ("risk", KeyLimits(client_queue=2)),
    ]
    assert found[0] == ApiKey("desk", hashlib.sha256(KEY.encode()).digest(), KeyLimits())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no key: must be a file with at least one key"),
        ("# nobody\n", "no key: must be a file with at least one key"),
        ("desk", "line 1 = ...: must be NAME and SHA256-HEX, as pricing key prints them"),
        (f"\ndesk {KEY}", "line 2 = ...: must be NAME and SHA256-HEX, as pricing key prints them"),
        (line("a/b", KEY), "line 1 = ...: must be NAME and SHA256-HEX, as pricing key prints them"),
        (line("desk", KEY, "speed=3"), "line 1 = a limit: must be client_queue or seconds_per_minute"),
        (line("desk", KEY, "client_queue=0"), "line 1 = a limit: must be client_queue or seconds_per_minute"),
        (
            line("desk", KEY, "client_queue=1.5"),
            "line 1 = a limit: must be client_queue or seconds_per_minute",
        ),
        (
            line("desk", KEY, "seconds_per_minute=nan"),
            "line 1 = a limit: must be client_queue or seconds_per_minute",
        ),
        (
            line("desk", KEY, "seconds_per_minute=inf"),
            "line 1 = a limit: must be client_queue or seconds_per_minute",
        ),
        (
            f"{line('d', KEY)}\n{line('d', OTHER, 'client_queue=1')}",
            "d: must be given the same limits in each of its lines",
        ),
    ],
)
def test_a_file_that_is_wrong_is_refused_without_repeating_what_may_be_a_key(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "keys"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=re.escape(words)) as caught:
        read_keys(str(path))
    assert KEY not in str(caught.value)


def test_every_route_of_the_first_version_wants_a_key_and_the_others_do_not(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    for path, operations in paths.items():
        for method, operation in operations.items():
            answer = client.request(method, path, json={})
            if path.startswith("/v1/"):
                assert answer.status_code == 401, path
                assert operation["security"] == [{"key": []}]
                assert "401" in operation["responses"]
            else:
                assert answer.status_code == 200, path
                assert "security" not in operation
    assert {"/livez", "/readyz", "/version", "/metrics", "/v1/price"} <= set(paths)


@pytest.mark.parametrize(
    ("headers", "challenge"),
    [
        ([], 'Bearer realm="pricing"'),
        ([("Authorization", "Basic cGs6cGs=")], 'Bearer realm="pricing"'),
        ([("Authorization", KEY)], 'Bearer realm="pricing"'),
        ([("Authorization", f"Bearer {KEY}"), ("Authorization", f"Bearer {KEY}")], 'Bearer realm="pricing"'),
        ([("Authorization", "Bearer")], 'Bearer realm="pricing", error="invalid_token"'),
        ([("Authorization", "Bearer unknown")], 'Bearer realm="pricing", error="invalid_token"'),
        ([("Authorization", f"Bearer {KEY}x")], 'Bearer realm="pricing", error="invalid_token"'),
        ([("Authorization", f"Bearer {KEY[:-1]}")], 'Bearer realm="pricing", error="invalid_token"'),
        ([("Authorization", f"Bearer {'x' * 5_000}")], 'Bearer realm="pricing", error="invalid_token"'),
        ([("Authorization", b"Bearer \xff\xfe")], 'Bearer realm="pricing", error="invalid_token"'),
        (
            [("Authorization", f"Bearer {hashlib.sha256(KEY.encode()).hexdigest()}")],
            'Bearer realm="pricing", error="invalid_token"',
        ),
    ],
)
def test_without_a_known_key_the_answer_is_401_before_the_body_is_looked_at(
    client: TestClient, headers: Any, challenge: str
) -> None:
    answer = client.post("/v1/price", content=b"no JSON", headers=headers)
    assert (answer.status_code, answer.headers["www-authenticate"]) == (401, challenge)
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == "/docs#unauthorized"
    assert KEY not in answer.text


@pytest.mark.parametrize("scheme", ["Bearer", "bearer", "BEARER"])
def test_a_known_key_is_let_in_and_its_owner_is_in_the_log_and_the_key_is_not(
    client: TestClient, question: dict[str, Any], scheme: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, logger="pricing.requests"):
        answer = client.post("/v1/price", json=question, headers={"Authorization": f"{scheme} {OTHER}"})
    assert answer.status_code == 200
    (line,) = [JsonFormatter().format(one) for one in caplog.records if one.name == "pricing.requests"]
    assert json.loads(line)["client"] == "risk"
    assert OTHER not in line


def test_the_limits_are_those_of_the_key(keys: Path, question: dict[str, Any], monkeypatch) -> None:
    seen = []

    def enter(self, client, seconds, *, most, seconds_per_minute):
        seen.append((client, most, seconds_per_minute))
        return real(self, client, seconds, most=most, seconds_per_minute=seconds_per_minute)

    real = ExpensiveLane.enter
    monkeypatch.setattr(ExpensiveLane, "enter", enter)
    with TestClient(create_app(Settings(slots=2, api_keys_file=str(keys)))) as client:
        for key in (KEY, OTHER):
            assert client.post("/v1/price", json=question | EXPENSIVE, headers=bearer(key)).status_code == 200
    assert seen == [("desk", None, None), ("risk", 2, None)]


def test_a_key_that_has_used_up_its_minute_is_refused_expensive_questions_alone(
    tmp_path: Path, question: dict[str, Any], unhurried: None
) -> None:
    path = tmp_path / "keys"
    path.write_text(f"{line('desk', KEY, 'seconds_per_minute=1e-6')}\n{line('risk', OTHER)}")
    cheap, expensive = question | {"exercise": "european"}, question | EXPENSIVE
    with TestClient(create_app(Settings(slots=2, api_keys_file=str(path)))) as client:
        assert client.post("/v1/price", json=expensive, headers=bearer(KEY)).status_code == 200
        refused = client.post("/v1/price", json=expensive, headers=bearer(KEY))
        assert (refused.status_code, refused.json()["type"]) == (429, "/docs#client-limit")
        assert int(refused.headers["retry-after"]) >= 1
        assert client.post("/v1/price", json=cheap, headers=bearer(KEY)).status_code == 200
        assert client.post("/v1/price", json=expensive, headers=bearer(OTHER)).status_code == 200
