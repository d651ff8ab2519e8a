import json
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.greeks_units import PER_DAY_PER_POINT
from app.service.schemas import PriceRequest
from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    Valuation,
    price,
)
from pricing_core.american.contracts.result_fields import GREEK_ERROR_FIELDS, PRICE_FIELDS, price_fields
from tests.problems.engine_with_errors import ERRORS

VOCABULARY = {field.name for field in PRICE_FIELDS}
KEYS = VOCABULARY | {"greeks_units"}
UNITS = {"greeks_units": "per_year_per_unit"}
TEXTS = ("status", "method", "engine_version", "instruction_set")


def test_the_answer_is_the_library_s_valuation_key_by_key(
    client: TestClient, question: dict[str, Any]
) -> None:
    answer = client.post("/v1/price", json=question)
    valuation = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), tolerance=1e-4)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    assert answer.json() == {name: getattr(valuation, name) for name in VOCABULARY} | UNITS


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
def without_cheap_lane(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every question be asked by the route's own call of `price`."""
    monkeypatch.setattr("app.service.work.admission.CHEAP_SECONDS", 0.0)


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch, without_cheap_lane: None) -> Any:
    """Make the engine answer with a given price and status."""
    sound = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), tolerance=1e-3)

    def install(number: float | None, status: str) -> None:
        monkeypatch.setattr(
            "app.service.routes.price.price", lambda *_, **__: with_price(sound, number, status)
        )

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


def test_greeks_that_were_not_asked_for_are_null(client: TestClient, question: dict[str, Any]) -> None:
    answer = client.post("/v1/price", json=question | {"greeks": "none"}).json()
    assert answer.keys() == KEYS
    assert {name for name in VOCABULARY if answer[name] is not None} == {f.name for f in price_fields("none")}


def test_errors_of_greeks_are_keys_where_they_are_asked_for(
    client: TestClient, question: dict[str, Any], engine_with_errors: None, without_cheap_lane: None
) -> None:
    question |= {"greeks": "extended", "cash_dividends": [{"time": 0.5, "amount": 1.0}]}
    assert client.post("/v1/price", json=question | {"greek_errors": False}).json().keys() == KEYS
    answer = client.post("/v1/price", json=question | {"greek_errors": True}).json()
    assert answer.keys() == KEYS | {"boundary_error"} | {field.name for field in GREEK_ERROR_FIELDS}
    expected = ERRORS | {"dividend_sensitivities": [2e-5]}
    assert {f.of: answer[f.name] for f in GREEK_ERROR_FIELDS if answer[f.name] is not None} == expected
    assert answer["charm"] == 0.5
    refused = client.post("/v1/price", json=question | {"greek_errors": 1})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "greek_errors")


class Asked:
    """Takes the place of a function of the library: keeps what it was asked, and gives an answer."""

    def __init__(self, answer: object) -> None:
        self.answer = answer
        self.arguments: tuple[Any, ...] = ()
        self.options: dict[str, Any] = {}

    def __call__(self, *arguments: Any, **options: Any) -> object:
        self.arguments, self.options = arguments, options
        return self.answer


EVENTS = {
    "rate": {"times": [0.5, 1.0], "values": [0.04, 0.05]},
    "volatility": {"times": [0.25, 1], "values": [0.2, 0.3]},
    "cash_dividends": [{"time": 0.5, "amount": 1.0}, {"time": 0.25, "amount": 2}],
    "proportional_dividends": [{"time": 0.75, "fraction": 0.01}],
    "dividend_model": "escrowed",
    "exercise": "bermudan",
    "exercise_times": [0.5, 0.25],
}
CONTRACT = (
    Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5)),
    Market(
        100.0,
        PiecewiseConstant((0.5, 1.0), (0.04, 0.05)),
        PiecewiseConstant((0.25, 1.0), (0.2, 0.3)),
        0.0,
        (CashDividend(0.25, 2.0), CashDividend(0.5, 1.0)),
        (ProportionalDividend(0.75, 0.01),),
        "escrowed",
    ),
)


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
def test_events_reach_the_engine_and_extended_greeks_come_back(
    client: TestClient,
    question: dict[str, Any],
    without_cheap_lane: None,
    monkeypatch: pytest.MonkeyPatch,
    greeks: str,
) -> None:
    numbers = {"vanna": 0.5, "volga": 2.0, "rate_buckets": (-1.0, -2.0), "volatility_buckets": None}
    found = SimpleNamespace(
        **dict.fromkeys(VOCABULARY, None) | {"price": 6.0, **dict.fromkeys(TEXTS, "ok")} | numbers
    )
    found.dividend_sensitivities = (0.25, 0.5)
    asked = Asked(found)
    monkeypatch.setattr("app.service.routes.price.price", asked)
    answer = client.post("/v1/price", json=question | EVENTS | {"greeks": greeks})
    assert answer.status_code == 200
    assert asked.arguments == CONTRACT
    assert asked.options["greeks"] == greeks
    body = answer.json()
    assert {name: body[name] for name in numbers} == numbers | {"rate_buckets": [-1.0, -2.0]}
    assert body["dividend_sensitivities"] == [0.25, 0.5]


def test_exercise_times_may_be_dates_where_there_are_dates(
    client: TestClient, question: dict[str, Any]
) -> None:
    del question["expiry"]
    question |= {"valuation_date": "2026-01-01", "expiration_date": "2027-01-01", "tolerance": 1e-2}
    pairs = [
        (
            {"exercise": "bermudan", "exercise_times": ["2026-03-15", 0.5]},
            {"exercise": "bermudan", "exercise_times": [0.2, 0.5]},
        ),
        ({"exercise_start": "2026-03-15"}, {"exercise_start": 0.2}),
    ]
    for dated, timed in pairs:
        answers = [client.post("/v1/price", json=question | times) for times in (dated, timed)]
        assert [answer.status_code for answer in answers] == [200, 200]
        assert answers[0].json() == answers[1].json()


def test_dates_may_take_the_place_of_the_expiry(client: TestClient, question: dict[str, Any]) -> None:
    dates = {"expiry": None, "valuation_date": "2026-01-01", "expiration_date": "2027-01-01T00:00"}
    gone = {"cash_dividends": [{"ex_date": "2025-06-01", "amount": 1.0}]}
    answer = client.post("/v1/price", json=question | dates | gone)
    assert answer.status_code == 200
    assert answer.json()["price"] == client.post("/v1/price", json=question).json()["price"]


def test_a_contract_with_events_is_valued_as_the_library_does(
    client: TestClient, question: dict[str, Any]
) -> None:
    events = {"cash_dividends": [{"time": 0.5, "amount": 3.0}], "exercise_start": 0.25, "tolerance": 1e-3}
    answer = client.post("/v1/price", json=question | events)
    option = Option("put", 100.0, 1.0, exercise_start=0.25)
    market = Market(100.0, 0.05, 0.2, cash_dividends=(CashDividend(0.5, 3.0),))
    valuation = price(option, market, tolerance=1e-3)
    assert valuation.status == "ok"
    assert answer.json() == {name: getattr(valuation, name) for name in VOCABULARY} | UNITS | {
        "dividend_sensitivities": list(valuation.dividend_sensitivities or ())
    }


def test_what_waits_together_is_priced_as_alone(client: TestClient) -> None:
    rng = np.random.default_rng(7)
    bodies = [
        {
            "option_type": str(rng.choice(["put", "call"])),
            "spot": float(rng.uniform(60.0, 150.0)),
            "strike": 100.0,
            "expiry": float(rng.uniform(0.05, 3.0)),
            "rate": float(rng.uniform(-0.02, 0.1)),
            "dividend_yield": float(rng.uniform(0.0, 0.1)),
            "volatility": float(rng.uniform(0.05, 0.8)),
            "tolerance": float(rng.choice([1e-4, 1e-6])),
            "greeks": str(rng.choice(["none", "standard"])),
        }
        for _ in range(60)
    ]
    with ThreadPoolExecutor(20) as many:
        together = list(many.map(lambda body: client.post("/v1/price", json=body).json(), bodies))
    for body, answer in zip(bodies, together, strict=True):
        option, market = PriceRequest.model_validate(body).contract()
        alone = price(option, market, tolerance=body["tolerance"], greeks=body["greeks"])
        assert answer["price"] == alone.price
        assert answer["vega"] == alone.vega
        assert answer["status"] == alone.status


def test_greeks_come_per_day_and_per_point_where_that_is_asked_for(
    client: TestClient, question: dict[str, Any]
) -> None:
    question |= {"greeks": "extended", "greek_errors": True, "rate": {"times": [0.5], "values": [0.04]}}
    plain = client.post("/v1/price", json=question).json()
    scaled = client.post("/v1/price", json=question | {"greeks_units": "per_day_per_point"}).json()
    assert scaled["greeks_units"] == "per_day_per_point"
    for field in (*PRICE_FIELDS, *GREEK_ERROR_FIELDS):
        by = PER_DAY_PER_POINT.get(field.of if field.name.endswith("_error") else field.name, 1.0)
        before, after = plain[field.name], scaled[field.name]
        if isinstance(before, list):
            assert after == [None if number is None else pytest.approx(by * number) for number in before]
        else:
            assert after == (pytest.approx(by * before) if isinstance(before, float) else before), field.name
    assert scaled["vega"] == pytest.approx(plain["vega_per_point"])
