from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.result_values import provenance
from app.service.schemas import ImpliedVolatilityResponse
from pricing_core.american import ImpliedVolatility, Market, Option, implied_volatility


@pytest.fixture
def quote(question: dict[str, Any]) -> dict[str, Any]:
    del question["volatility"]
    return question | {"option_price": 6.09}


def test_the_answer_is_the_library_s_result_key_by_key(client: TestClient, quote: dict[str, Any]) -> None:
    answer = client.post("/v1/implied-volatility", json=quote)
    found = implied_volatility(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), 6.09, tolerance=1e-4)
    assert answer.status_code == 200
    assert found.volatility == pytest.approx(0.2, abs=1e-3)
    results = {name: getattr(found, name) for name in ImpliedVolatility.__slots__}
    assert answer.json() == results | provenance()
    assert set(ImpliedVolatilityResponse.model_fields) == {*ImpliedVolatility.__slots__, *provenance()}


def test_the_method_is_that_of_the_price_at_the_volatility(client: TestClient, quote: dict[str, Any]) -> None:
    dividend = {"cash_dividends": [{"time": 0.5, "amount": 2.0}]}
    for changes in ({}, {"exercise": "european"}, dividend):
        found = client.post("/v1/implied-volatility", json=quote | changes).json()
        terms = {name: value for name, value in (quote | changes).items() if name != "option_price"}
        price = client.post("/v1/price", json=terms | {"volatility": found["volatility"]}).json()
        assert found["method"] == price["method"]
    assert (
        client.post("/v1/implied-volatility", json=quote | {"option_price": 200.0}).json()["method"] == "none"
    )


def test_bid_and_ask_take_the_place_of_the_price(client: TestClient, quote: dict[str, Any]) -> None:
    body = client.post(
        "/v1/implied-volatility", json=quote | {"option_price": None, "bid": 6.0, "ask": 6.2}
    ).json()
    assert body["status"] == "ok"
    assert body["bid_volatility"] < body["volatility"] < body["ask_volatility"]


def test_the_volatility_is_checked_and_not_used(client: TestClient, quote: dict[str, Any]) -> None:
    without, given = (
        client.post("/v1/implied-volatility", json=body).json()
        for body in (quote, quote | {"volatility": 3.0})
    )
    assert without == given
    refused = client.post("/v1/implied-volatility", json=quote | {"volatility": -1.0})
    assert refused.status_code == 422


@pytest.mark.parametrize(("price", "status"), [(101.0, "above_upper_bound"), (0.0, "below_lower_bound")])
def test_a_price_without_a_volatility_is_answered_with_the_reason(
    client: TestClient, quote: dict[str, Any], price: float, status: str
) -> None:
    answer = client.post("/v1/implied-volatility", json=quote | {"option_price": price, "spot": 90.0})
    assert answer.status_code == 200
    assert (answer.json()["status"], answer.json()["volatility"]) == (status, None)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"option_price": None}, "option_price"),
        ({"option_price": None, "bid": 1.0}, "ask"),
        ({"bid": 1.0}, "option_price"),
        ({"option_price": None, "bid": 2.0, "ask": 1.0}, "ask"),
        ({"option_price": -1.0}, "option_price"),
        ({"option_price": "6.09"}, "option_price"),
        ({"option_price": True}, "option_price"),
        ({"option_price": None, "bid": [1.0], "ask": 2.0}, "bid"),
    ],
    ids=str,
)
def test_a_price_that_is_none_is_named(
    client: TestClient, quote: dict[str, Any], changes: dict[str, Any], field: str
) -> None:
    answer = client.post("/v1/implied-volatility", json=quote | changes)
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == [field]
