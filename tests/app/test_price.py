import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.schemas import PriceResponse
from pricing_core.american import Market, Option, Valuation, price

VOCABULARY = {
    "price",
    "european_price",
    "early_exercise_premium",
    "intrinsic_value",
    "delta",
    "gamma",
    "theta",
    "theta_per_day",
    "vega",
    "vega_per_point",
    "rho",
    "rho_per_point",
    "dividend_rho",
    "exercise_now",
    "exercise_boundary",
    "error_estimate",
    "status",
    "method",
    "engine_version",
}


def test_the_answer_is_the_library_s_valuation_key_by_key(
    client: TestClient, question: dict[str, Any]
) -> None:
    answer = client.post("/v1/price", json=question)
    valuation = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), tolerance=1e-4)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    assert answer.json() == {name: getattr(valuation, name) for name in VOCABULARY}


def test_the_american_put_is_worth_what_the_literature_says(
    client: TestClient, question: dict[str, Any]
) -> None:
    answer = client.post("/v1/price", json=question).json()
    assert answer["price"] == pytest.approx(6.0904, abs=1e-2)  # binomial and finite-difference consensus
    assert answer["european_price"] == pytest.approx(5.573526, abs=1e-6)  # Black and Scholes
    assert answer["status"] == "ok"


def test_a_european_option_has_no_premium_and_a_null_boundary(
    client: TestClient, question: dict[str, Any]
) -> None:
    answer = client.post("/v1/price", json=question | {"exercise": "european"}).json()
    assert answer["price"] == pytest.approx(5.573526, abs=1e-2)
    assert answer["exercise_boundary"] is None
    assert answer["exercise_now"] is False


def test_integers_are_numbers(client: TestClient, question: dict[str, Any]) -> None:
    answer = client.post("/v1/price", json=question | {"spot": 100, "strike": 100, "expiry": 1})
    assert answer.json() == client.post("/v1/price", json=question).json()


@pytest.mark.parametrize("charset", ["", "; charset=utf-8", '; charset="UTF-8"'])
def test_json_in_utf_8_is_the_media_type(client: TestClient, question: dict[str, Any], charset: str) -> None:
    headers = {"content-type": f"application/json{charset}"}
    assert client.post("/v1/price", content=json.dumps(question), headers=headers).status_code == 200


def with_price(valuation: Valuation, number: float | None, status: str) -> Any:
    """Return something with the attributes of a valuation, another price and status."""

    class Changed:
        def __getattr__(self, name: str) -> Any:
            return {"price": number, "status": status}.get(name, getattr(valuation, name))

    return Changed()


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Make the engine answer with a given price and status."""
    sound = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), tolerance=1e-3)

    def install(number: float | None, status: str) -> None:
        monkeypatch.setattr("app.routes.price.price", lambda *_, **__: with_price(sound, number, status))

    return install


def test_a_deadline_with_an_estimate_is_answered_with_it(
    client: TestClient, question: dict[str, Any], answers: Any
) -> None:
    answers(6.1, "deadline")
    answer = client.post("/v1/price", json=question)
    assert (answer.status_code, answer.json()["price"], answer.json()["status"]) == (200, 6.1, "deadline")


def test_a_deadline_without_an_estimate_is_a_503_to_be_retried(
    client: TestClient, question: dict[str, Any], answers: Any
) -> None:
    answers(None, "deadline")
    answer = client.post("/v1/price", json=question)
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert answer.json()["type"] == "/docs#deadline"


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_result_that_is_not_finite_is_a_500_with_an_id_and_never_null(
    client: TestClient, question: dict[str, Any], answers: Any, number: float
) -> None:
    answers(number, "ok")
    answer = client.post("/v1/price", json=question, headers={"X-Request-ID": "lookup-17"})
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["request_id"] == "lookup-17"


def test_the_response_model_holds_the_vocabulary_and_nothing_else() -> None:
    assert set(PriceResponse.model_fields) == VOCABULARY
