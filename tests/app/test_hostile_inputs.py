"""What a stranger may send, one row each: always a problem document, short, and without the input in it."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

JSON = {"content-type": "application/json"}
CANARY = "Xq7canary"


def assert_problem(answer: Any, status: int, name: str) -> dict[str, Any]:
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert len(answer.content) < 3_000
    assert CANARY not in answer.text
    problem: dict[str, Any] = answer.json()
    assert (problem["status"], problem["type"]) == (status, f"/docs#{name}")
    assert problem["request_id"] == answer.headers["x-request-id"]
    assert problem["title"]
    assert problem["detail"]
    return problem


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary"])
@pytest.mark.parametrize(
    ("body", "name"),
    [
        (b'{"spot": NaN}', "invalid-json"),
        (b'{"spot": Infinity}', "invalid-json"),
        (b'{"spot": -Infinity}', "invalid-json"),
        (b'{"spot": 100, "spot": 101}', "invalid-json"),
        (b'{"' + CANARY.encode() + b'": 1, "' + CANARY.encode() + b'": 1}', "invalid-json"),
        (b'{"option_type": "\\ud800"}', "invalid-json"),
        (b'{"\\udfff": 1}', "invalid-json"),
        (b'{"times": ["\\ud800"]}', "invalid-json"),
        (b'{"spot": ' + b"9" * 5_000 + b"}", "invalid-json"),
        (b"[" * 50_000, "invalid-json"),
        (b'{"spot":' * 7_000, "invalid-json"),
        (b"", "invalid-json"),
        (b" ", "invalid-json"),
        (b"null", "invalid-json"),
        (b"[]", "invalid-json"),
        (b'"Xq7canary"', "invalid-json"),
        (b"17", "invalid-json"),
        (b'{"spot": 100', "invalid-json"),
        (b"{'spot': 100}", "invalid-json"),
        (b'{"spot": 1_000}', "invalid-json"),
        (b'\xff\xfe{\x00"\x00', "invalid-json"),
        (b'{"spot": "\xe9"}', "invalid-json"),
        (b"\xef\xbb\xbf{}", "invalid-json"),
        (b"{}", "invalid-input"),
        (b'{"Xq7canary": 1}', "invalid-input"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_a_body_that_is_not_one_plain_json_object_is_a_422(
    client: TestClient, address: str, body: bytes, name: str
) -> None:
    assert_problem(client.post(address, content=body, headers=JSON), 422, name)


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary"])
@pytest.mark.parametrize(
    ("field", "literal"),
    [
        ("spot", "1e999"),
        ("spot", "-1"),
        ("spot", "9" * 4_000),
        ("spot", '"100"'),
        ("spot", "true"),
        ("spot", "[100]"),
        ("strike", "0"),
        ("strike", "-5"),
        ("strike", "1e-31"),
        ("strike", "1e31"),
        ("spot", "1e31"),
        ("strike", "null"),
        ("strike", "{}"),
        ("expiry", "-0.1"),
        ("expiry", "201"),
        ("rate", "2.1"),
        ("rate", '{"times": [1], "values": [0.05]}'),
        ("volatility", "-0.2"),
        ("volatility", "15.1"),
        ("volatility", "false"),
        ("dividend_yield", "-0.6"),
        ("dividend_yield", "null"),
        ("tolerance", "0"),
        ("tolerance", "0.1"),
        ("tolerance", "1e-300"),
        ("option_type", f'"{CANARY}"'),
        ("option_type", '"PUT"'),
        ("option_type", "1"),
        ("exercise", '"bermudan"'),
        ("exercise", "null"),
        ("cash_dividends", "[]"),
        ("proportional_dividends", "[]"),
        ("valuation_date", '"2026-01-01"'),
        ("expiration_date", '"2027-01-01"'),
        ("dividend_model", '"spot"'),
        ("exercise_times", "[0.5]"),
        ("exercise_start", "0.5"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_a_field_that_is_not_what_it_must_be_is_named_in_a_422(
    client: TestClient, question: dict[str, Any], address: str, field: str, literal: str
) -> None:
    others = ", ".join(
        f"{json.dumps(name)}: {json.dumps(value)}" for name, value in question.items() if name != field
    )
    body = f'{{{others}, "{field}": {literal}}}'
    problem = assert_problem(client.post(address, content=body, headers=JSON), 422, "invalid-input")
    assert [error["field"] for error in problem["errors"]] == [field]
    assert field in problem["detail"]


@pytest.mark.parametrize("field", ["option_type", "spot", "strike", "expiry", "rate", "volatility"])
def test_a_missing_field_is_named(client: TestClient, question: dict[str, Any], field: str) -> None:
    del question[field]
    problem = assert_problem(client.post("/v1/price", json=question), 422, "invalid-input")
    assert problem["errors"] == [{"field": field, "allowed": "given"}]


def test_an_unknown_key_is_refused_with_the_keys_that_are_known(
    client: TestClient, question: dict[str, Any]
) -> None:
    problem = assert_problem(
        client.post("/v1/price", json=question | {"volatilty": 0.3}), 422, "invalid-input"
    )
    assert "dividend_yield" in problem["detail"]
    assert "did you mean volatility?" in problem["detail"]


def test_many_wrong_fields_are_answered_in_short(client: TestClient) -> None:
    body = {f"{CANARY}{k}": k for k in range(2_000)}
    problem = assert_problem(client.post("/v1/price", json=body), 422, "invalid-input")
    assert len(problem["errors"]) <= 10


@pytest.mark.parametrize("times", [[], [0.5] * 1_001])
def test_a_list_of_a_wrong_length_is_told_the_right_one(
    client: TestClient, question: dict[str, Any], times: list[float]
) -> None:
    problem = assert_problem(
        client.post("/v1/boundary", json=question | {"times": times}), 422, "invalid-input"
    )
    assert problem["detail"] == "times must be a list of 1 to 1000 numbers"


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"content-type": "text/plain"},
        {"content-type": "application/x-www-form-urlencoded"},
        {"content-type": "application/jsonp"},
        {"content-type": "application/json; charset=utf-16"},
        {"content-type": "multipart/form-data; boundary=Xq7canary"},
        {"content-type": "application/json", "content-encoding": "gzip"},
    ],
    ids=str,
)
def test_another_content_type_is_a_415(
    client: TestClient, question: dict[str, Any], headers: dict[str, str]
) -> None:
    answer = client.post("/v1/price", content=json.dumps(question).encode(), headers=headers)
    assert_problem(answer, 415, "unsupported-media-type")


def test_a_body_declared_too_long_is_a_413(client: TestClient) -> None:
    body = json.dumps({"times": [0.5] * 20_000})
    assert len(body) > 65_536
    answer = client.post("/v1/boundary", content=body, headers=JSON)
    assert_problem(answer, 413, "body-too-large")
    assert answer.headers["connection"] == "close"


def test_a_body_of_undeclared_length_is_cut_off_with_a_413(client: TestClient) -> None:
    parts = (b"[" * 1_024 for _ in range(100))  # sent in chunks, without a length
    assert_problem(client.post("/v1/price", content=parts, headers=JSON), 413, "body-too-large")


@pytest.mark.parametrize(
    ("method", "address", "status", "name"),
    [
        ("GET", "/Xq7canary", 404, "not-found"),
        ("GET", "/v1/price/", 404, "not-found"),
        ("POST", "/v1/../livez/Xq7canary", 404, "not-found"),
        ("GET", "/v1/price", 405, "method-not-allowed"),
        ("DELETE", "/v1/boundary", 405, "method-not-allowed"),
        ("POST", "/livez", 405, "method-not-allowed"),
    ],
)
def test_other_addresses_and_methods_are_problems_too(
    client: TestClient, method: str, address: str, status: int, name: str
) -> None:
    answer = client.request(method, address)
    assert_problem(answer, status, name)
    assert ("allow" in answer.headers) == (status == 405)
