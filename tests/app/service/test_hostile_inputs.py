"""What a stranger may send, one row each: always a problem document, short, and without anything of theirs."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.service import request_body
from app.service.request_body import SHOWN_ERRORS
from app.service.schemas import PriceRequest
from tests.problems.needs_kernel import needs_kernel

JSON = {"content-type": "application/json"}
CANARY = "Xq7canary"
ADDRESSES = ["/v1/price", "/v1/boundary", "/v1/implied-volatility", "/v1/exercise-advice"]
DATED = {"expiry": None, "valuation_date": "2026-01-01", "expiration_date": "2027-01-01"}


def assert_problem(answer: Any, status: int, name: str) -> dict[str, Any]:
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert len(answer.content) < 5_000
    assert CANARY not in answer.text
    problem: dict[str, Any] = answer.json()
    assert (problem["status"], problem["type"]) == (status, f"/docs#{name}")
    assert problem["request_id"] == answer.headers["x-request-id"]
    assert problem["title"]
    assert problem["detail"]
    return problem


@pytest.mark.parametrize("address", ADDRESSES)
@pytest.mark.parametrize(
    ("body", "name"),
    [
        (b'{"spot": NaN}', "invalid-json"),
        (b'{"spot": Infinity}', "invalid-json"),
        (b'{"spot": -Infinity}', "invalid-json"),
        (b'{"spot": 100, "spot": 101}', "invalid-json"),
        (b'{"\\ud800": 1, "\\ud800": 1}', "invalid-json"),
        (b'{"' + b"k" * 9_000 + b'": 1, "' + b"k" * 9_000 + b'": 1}', "invalid-json"),
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
        (b'{"unknown": "Xq7canary"}', "invalid-input"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_a_body_that_is_not_one_plain_json_object_is_a_422(
    client: TestClient, address: str, body: bytes, name: str
) -> None:
    assert_problem(client.post(address, content=body, headers=JSON), 422, name)


@pytest.mark.parametrize("address", ADDRESSES)
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
        ("rate", '"0.05"'),
        ("rate", "[0.05]"),
        ("rate", "null"),
        ("volatility", "-0.2"),
        ("volatility", "15.1"),
        ("volatility", "false"),
        ("dividend_yield", "-0.6"),
        ("dividend_yield", "null"),
        ("tolerance", "0"),
        ("tolerance", "0.1"),
        ("tolerance", "1e-300"),
        ("option_type", f'"{CANARY}"'),
        ("option_type", '"PUTT"'),
        ("option_type", "1"),
        ("exercise", f'"{CANARY}"'),
        ("exercise", "null"),
        ("cash_dividends", "null"),
        ("cash_dividends", "{}"),
        ("cash_dividends", f'"{CANARY}"'),
        ("cash_dividends", "[" + ", ".join(['{"time": 1, "amount": 1}'] * 367) + "]"),
        ("proportional_dividends", "0.5"),
        ("proportional_dividends", "[" + ", ".join(["{}"] * 2_000) + "]"),
        ("dividend_model", f'"{CANARY}"'),
        ("dividend_model", "true"),
        ("exercise_times", "0.5"),
        ("exercise_times", "[0.5]"),
        ("exercise_times", "[" + ", ".join(["0.5"] * 1_001) + "]"),
        ("exercise_start", "-1"),
        ("exercise_start", "2"),
        ("exercise_start", "false"),
        ("exercise_start", '"2026-07-01"'),
        ("exercise_start", f'"{CANARY * 10}"'),
        ("valuation_date", "20260101"),
        ("valuation_date", f'"{CANARY * 10}"'),
        ("expiration_date", "true"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_a_field_that_is_not_what_it_must_be_is_named_in_a_422(
    client: TestClient, question: dict[str, Any], address: str, field: str, literal: str
) -> None:
    problem = ask_with(client, address, question, field, literal)
    assert [error["field"] for error in problem["errors"]] == [field]
    assert field in problem["detail"]


def ask_with(
    client: TestClient, address: str, question: dict[str, Any], field: str, literal: str
) -> dict[str, Any]:
    """Ask with a field as it is written; return the problem, which a 422 must hold."""
    others = ", ".join(
        f"{json.dumps(name)}: {json.dumps(value)}" for name, value in question.items() if name != field
    )
    body = f'{{{others}, "{field}": {literal}}}'
    return assert_problem(client.post(address, content=body, headers=JSON), 422, "invalid-input")


SOUND = '{"time": 0.5, "amount": 1}'


@pytest.mark.parametrize(
    ("field", "literal", "place"),
    [
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5, "amount": -1}}]', "cash_dividends[1].amount"),
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5, "amount": true}}]', "cash_dividends[1].amount"),
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5, "amount": "1"}}]', "cash_dividends[1].amount"),
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5, "amount": 1e999}}]', "cash_dividends[1].amount"),
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5, "amount": {{}}}}]', "cash_dividends[1].amount"),
        ("cash_dividends", f'[{SOUND}, {{"time": 0.5}}]', "cash_dividends[1].amount"),
        ("cash_dividends", '[{"time": -0.1, "amount": 1}]', "cash_dividends[0].time"),
        ("cash_dividends", '[{"time": 3000, "amount": 1}]', "cash_dividends[0].time"),
        ("cash_dividends", '[{"time": "0.5", "amount": 1}]', "cash_dividends[0].time"),
        ("cash_dividends", '[{"amount": 1}]', "cash_dividends[0].time"),
        ("cash_dividends", f"[{SOUND}, null]", "cash_dividends[1]"),
        ("cash_dividends", "[[0.5, 1, 2]]", "cash_dividends[0]"),
        ("cash_dividends", "[[0.5, -1]]", "cash_dividends[0].amount"),
        ("cash_dividends", '[{"ex_date": 20260101, "amount": 1}]', "cash_dividends[0].ex_date"),
        ("cash_dividends", f'[{{"ex_date": "{CANARY}", "amount": 1}}]', "cash_dividends[0].ex_date"),
        ("cash_dividends", f'[{{"time": 1, "amount": 1, "foo": "{CANARY}"}}]', "key of cash_dividends[0]"),
        ("proportional_dividends", '[{"time": 0.5, "fraction": 1.1}]', "proportional_dividends[0].fraction"),
        ("proportional_dividends", '[{"time": 0.5}]', "proportional_dividends[0].fraction"),
        ("proportional_dividends", f"[{SOUND}]", "key of proportional_dividends[0]"),
        ("rate", '{"times": [1], "values": [2.1]}', "rate.values[0]"),
        ("rate", '{"times": [1], "values": ["0.05"]}', "rate.values[0]"),
        ("rate", '{"times": [true], "values": [0.05]}', "rate.times[0]"),
        ("rate", '{"times": [-1], "values": [0.05]}', "rate.times[0]"),
        ("rate", '{"times": [1]}', "rate.values"),
        ("rate", '{"times": [], "values": []}', "rate.times"),
        ("rate", '{"times": [1], "values": [[0.05]]}', "rate.values[0]"),
        ("rate", '{"times": [2, 1], "values": [0.05, 0.06]}', "rate.times"),
        ("rate", '{"times": [1, 2], "values": [0.05]}', "rate.values"),
        ("rate", f'{{"times": [1], "values": [0], "curve": ["{CANARY}"]}}', "key of rate"),
        ("volatility", '{"times": [1], "values": [15.1]}', "volatility.values[0]"),
        ("volatility", f'{{"times": {[*range(1, 102)]}, "values": [0.2]}}', "volatility.times"),
        ("dividend_yield", '{"times": [1], "values": [null]}', "dividend_yield.values[0]"),
        ("exercise_times", "[0.5, true]", "exercise_times[1]"),
        ("exercise_times", "[0.5, 201]", "exercise_times[1]"),
        ("exercise_times", f'[0.5, "{CANARY}"]', "exercise_times"),
        ("exercise_times", '["2026-07-01"]', "exercise_times"),
    ],
    ids=lambda value: repr(value)[:50],
)
@pytest.mark.parametrize("address", ADDRESSES)
def test_a_fault_inside_a_list_or_a_curve_is_named_by_its_place(
    client: TestClient, question: dict[str, Any], address: str, field: str, literal: str, place: str
) -> None:
    problem = ask_with(client, address, question, field, literal)
    assert problem["errors"][0]["field"] == place
    assert place.removeprefix("key of ") in problem["detail"]


def test_an_unknown_key_of_a_dividend_is_told_the_ones_that_are_known(
    client: TestClient, question: dict[str, Any]
) -> None:
    literal = '[{"time": 1, "amount": 1, "amonut": 1}]'
    problem = ask_with(client, "/v1/price", question, "cash_dividends", literal)
    assert problem["detail"] == ("cash_dividends[0] has no such key: did you mean amount?")


def test_a_number_that_is_none_is_told_that_a_curve_would_do(
    client: TestClient, question: dict[str, Any]
) -> None:
    problem = ask_with(client, "/v1/price", question, "rate", '"0.05"')
    assert problem["detail"] == (
        'rate must be a number from -0.5 to 2 or {"times": [...], "values": [...]}, not a text'
    )


@pytest.mark.parametrize(
    ("field", "literal", "detail"),
    [
        ("volatility", "-0.2", "volatility must be a number from 0 to 15 or {curve}"),
        ("expiry", "201", "expiry must be a number from 0 to 200"),
        ("strike", "1e999", "strike must be a number from 1e-30 to 1e+30"),
        ("strike", '"100"', "strike must be a number from 1e-30 to 1e+30, not a text"),
        ("strike", "true", "strike must be a number from 1e-30 to 1e+30, not true or false"),
        ("strike", "1" + "0" * 400, "strike must be a number from 1e-30 to 1e+30"),
        (
            "expiry",
            '"2027-01-15"',
            "expiry must be a number from 0 to 200, not a text; it is in years, and in its place "
            "valuation_date and expiration_date may give dates",
        ),
        (
            "cash_dividends",
            '[{"time": "2026-05-01", "amount": 1}]',
            "cash_dividends[0].time must be a number from 0 to 2000, not a text; it is in years, and in its "
            "place ex_date gives a date, where there is a valuation_date",
        ),
        ("cash_dividends", "[0.5]", 'cash_dividends[0] must be {"time": ..., "amount": ...}'),
        ("cash_dividends", "{}", 'cash_dividends must be a list of {"time": ..., "amount": ...}'),
        ("greek_errors", '"yes"', "greek_errors must be true or false"),
        (
            "rate",
            '{"times": [1], "values": [2.5]}',
            "rate.values[0] must be a number from -0.5 to 2",
        ),
        (
            "cash_dividends",
            '[{"time": 1, "amount": -1}]',
            "cash_dividends[0].amount must be a number from 0 to 1e+30",
        ),
        ("exercise_times", "[]", "exercise_times = 0 times: must be 1 to 1000 times"),
        (
            "exercise_times",
            str([0.5] * 1_001),
            "exercise_times = 1001 entries: must be a list of at most 1000 entries",
        ),
    ],
    ids=lambda value: repr(value)[:40],
)
def test_a_number_out_of_range_is_told_with_the_whole_range(
    client: TestClient, question: dict[str, Any], field: str, literal: str, detail: str
) -> None:
    problem = ask_with(client, "/v1/price", question | {"exercise": "bermudan"}, field, literal)
    assert problem["detail"] == detail.replace("{curve}", '{"times": [...], "values": [...]}')


@needs_kernel
def test_every_door_takes_as_many_exercise_times(client: TestClient, question: dict[str, Any]) -> None:
    times = [0.001 * k for k in range(1, 1_001)]
    body = question | {"exercise": "bermudan", "tolerance": 1e-2}
    assert (
        client.post("/v1/boundary", json=body | {"exercise_times": times, "times": [1.0]}).status_code == 200
    )


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"expiry": None}, "expiry"),
        ({"valuation_date": "2026-01-01"}, "expiry"),
        (DATED | {"expiry": 1.0}, "expiry"),
        (DATED | {"valuation_date": None}, "valuation_date"),
        (DATED | {"expiration_date": None}, "expiration_date"),
        (DATED | {"valuation_date": CANARY}, "valuation_date"),
        (DATED | {"expiration_date": "2025-12-31"}, "expiration_date"),
        (DATED | {"expiration_date": "2027-01-01T00:00Z"}, "expiration_date"),
        ({"cash_dividends": [{"ex_date": "2026-03-01", "amount": 1.0}]}, "cash_dividends[0].ex_date"),
        (
            DATED | {"cash_dividends": [{"ex_date": "2026-03-01", "time": 0.5, "amount": 1.0}]},
            "cash_dividends[0].ex_date",
        ),
        ({"exercise": "bermudan"}, "exercise_times"),
        ({"exercise": "bermudan", "exercise_times": [2.0]}, "exercise_times[0]"),
        ({"exercise": "european", "exercise_start": 0.5}, "exercise_start"),
    ],
    ids=str,
)
@pytest.mark.parametrize("address", ADDRESSES)
def test_fields_that_do_not_go_together_are_named(
    client: TestClient, question: dict[str, Any], address: str, changes: dict[str, Any], field: str
) -> None:
    problem = assert_problem(client.post(address, json=question | changes), 422, "invalid-input")
    assert [error["field"] for error in problem["errors"]] == [field]


@pytest.mark.parametrize("field", ["option_type", "spot", "strike", "rate", "volatility"])
def test_a_missing_field_is_named(client: TestClient, question: dict[str, Any], field: str) -> None:
    del question[field]
    problem = assert_problem(client.post("/v1/price", json=question), 422, "invalid-input")
    assert problem["errors"] == [{"field": field, "allowed": "given"}]


def test_unknown_keys_are_told_first_with_the_nearest_name_and_the_keys_that_are_known(
    client: TestClient, question: dict[str, Any]
) -> None:
    body = question | {"volatilty": 0.3, "spto": 1, "foo": 1, "spot": "100"}
    problem = assert_problem(client.post("/v1/price", json=body), 422, "invalid-input")
    assert [error["field"] for error in problem["errors"]] == ["key of the body", "spot"]
    assert problem["detail"].startswith("the body has no such key: did you mean volatility or spot? ")
    assert problem["detail"].endswith("? spot must be a number from 0 to 1e+30, not a text")
    assert not any(name in problem["detail"] for name in ("volatilty", "spto", "foo"))


@pytest.mark.parametrize("key", ["Xq7", "k" * 5_000, "a\x00b<script>", "\u202e"], ids=lambda key: key[:9])
def test_an_unknown_key_is_refused_and_not_repeated(
    client: TestClient, question: dict[str, Any], key: str
) -> None:
    problem = assert_problem(client.post("/v1/price", json=question | {key: CANARY}), 422, "invalid-input")
    assert [error["field"] for error in problem["errors"]] == ["key of the body"]
    assert problem["detail"].startswith("the body has no such key: choose from option_type, ")
    assert key not in problem["detail"]


def test_of_a_thousand_unknown_keys_those_that_are_told_are_kept() -> None:
    entry = {"time": 0.5, "amount": 1.0} | {f"k{k}": 1 for k in range(1_000)}
    body = {"spot": 100.0, "cash_dividends": [entry, dict(entry)]} | {f"k{k}": 1 for k in range(1_000)}
    found = request_body.without_surplus(body, PriceRequest)
    assert {"spot", "cash_dividends"} < set(found)
    assert {"time", "amount"} <= set(entry)
    assert len(found) + sum(map(len, found["cash_dividends"])) == 2 + 2 + 2 + SHOWN_ERRORS


def test_a_contract_of_more_values_than_any_has_is_not_read(client: TestClient) -> None:
    body = b'{"spot": [' + b"{}," * 300_000 + b"{}]}"
    problem = assert_problem(client.post("/v1/price", content=body, headers=JSON), 422, "invalid-json")
    assert "more values" in problem["detail"]


def test_a_key_that_is_there_twice_is_refused_and_not_repeated(client: TestClient) -> None:
    body = b'{"spot": 100, "cash_dividends": [{"time": 1, "amount": 1, "time": 2}]}'
    problem = assert_problem(client.post("/v1/price", content=body, headers=JSON), 422, "invalid-json")
    assert problem["detail"] == "the body holds an object with a key twice"


def test_many_wrong_fields_are_answered_in_short(client: TestClient) -> None:
    body = {f"unknown{k}": k for k in range(2_000)}
    problem = assert_problem(client.post("/v1/price", json=body), 422, "invalid-input")
    assert len(problem["errors"]) <= 10


@pytest.mark.parametrize(
    ("times", "allowed"),
    [
        ([], "0 entries: must be a list that is not empty"),
        ([0.5] * 1_001, "1001 entries: must be a list of at most 1000 entries"),
    ],
)
def test_a_list_of_a_wrong_length_is_told_the_right_one(
    client: TestClient, question: dict[str, Any], times: list[float], allowed: str
) -> None:
    problem = assert_problem(
        client.post("/v1/boundary", json=question | {"times": times}), 422, "invalid-input"
    )
    assert problem["detail"] == f"times = {allowed}"


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
    body = json.dumps({"times": [0.5] * 250_000})
    assert len(body) > 1 << 20
    answer = client.post("/v1/boundary", content=body, headers=JSON)
    assert_problem(answer, 413, "body-too-large")
    assert answer.headers["connection"] == "close"


def test_long_bodies_share_one_memory_and_short_ones_need_none(
    client: TestClient, question: dict[str, Any]
) -> None:
    memory = client.app.state.memory  # type: ignore[attr-defined]
    memory.take("testclient", (3 << 24) - 70_000)  # of 48 MiB, as if by another request of this client
    long = json.dumps(question) + 80_000 * " "
    answer = client.post("/v1/price", content=long, headers=JSON)
    assert_problem(answer, 429, "client-limit")
    assert client.post("/v1/price", json=question).status_code == 200
    memory.give_back("testclient", 20_000)
    assert client.post("/v1/price", content=long, headers=JSON).status_code == 200
    memory.give_back("testclient", (3 << 24) - 90_000)
    assert not memory._held  # all of it has been given back


def test_a_body_of_undeclared_length_is_cut_off_with_a_413(client: TestClient) -> None:
    parts = (b"[" * 65_536 for _ in range(20))  # sent in chunks, without a length
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


@pytest.mark.parametrize("address", ADDRESSES)
@pytest.mark.parametrize("kind", ["numbers", "keys"])
def test_of_a_thousand_faults_ten_are_looked_into(
    client: TestClient, question: dict[str, Any], monkeypatch: pytest.MonkeyPatch, address: str, kind: str
) -> None:
    looked = []
    schema_at, unknown = request_body.schema_at, request_body.UnknownNameError
    monkeypatch.setattr(request_body, "schema_at", lambda *told: (looked.append(told), schema_at(*told))[1])
    monkeypatch.setattr(
        request_body, "UnknownNameError", lambda *told: (looked.extend(told[1]), unknown(*told))[1]
    )
    made = []
    of_model = request_body.inline_schema
    monkeypatch.setattr(request_body, "inline_schema", lambda model: (made.append(model), of_model(model))[1])
    wrong = {
        "numbers": {"cash_dividends": [{"time": -1, "amount": -1}] * 100},
        "keys": {f"k{number}": 1 for number in range(300)},
    }
    for _ in range(2):
        problem = assert_problem(client.post(address, json=question | wrong[kind]), 422, "invalid-input")
        assert 1 <= len(problem["errors"]) <= 10
    assert len(looked) == 2 * 10
    assert len(made) <= 1
