from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.service.schemas import LARGEST_TIMES


def test_the_boundary_of_a_put_rises_to_the_strike(client: TestClient, question: dict[str, Any]) -> None:
    answer = client.post("/v1/boundary", json=question | {"times": [0.0, 0.5, 0.9, 1.0]})
    assert answer.status_code == 200
    body = answer.json()
    results = {"time", "time_to_expiry", "boundary", "other_boundary", "error_estimate", "method"}
    assert set(body) == results | {"engine_version", "instruction_set"}
    assert body["time"] == [0.0, 0.5, 0.9, 1.0]
    assert body["time_to_expiry"] == pytest.approx([1.0, 0.5, 0.1, 0.0])
    assert np.all(np.diff(body["boundary"]) > 0.0)
    assert body["boundary"][-1] == pytest.approx(100.0)
    assert body["other_boundary"] is None
    assert body["method"] == "premium-march"
    assert body["error_estimate"][-1] == 0.0
    assert all(0.0 < error < 0.1 for error in body["error_estimate"][:-1])


def test_the_default_times_run_from_now_to_expiry(client: TestClient, question: dict[str, Any]) -> None:
    body = client.post("/v1/boundary", json=question).json()
    assert (body["time"][0], body["time"][-1]) == (0.0, 1.0)
    assert len(body["boundary"]) == len(body["time"]) == len(body["time_to_expiry"])


def test_the_spot_may_be_left_out(client: TestClient, question: dict[str, Any]) -> None:
    without = {name: value for name, value in question.items() if name != "spot"} | {"times": [0.0]}
    with_another = question | {"times": [0.0], "spot": 120.0}
    found = [client.post("/v1/boundary", json=body).json() for body in (without, with_another)]
    assert found[0] == found[1]


def test_no_boundary_is_null(client: TestClient, question: dict[str, Any]) -> None:
    body = client.post("/v1/boundary", json=question | {"exercise": "european", "times": [0.0, 0.5]}).json()
    assert body["boundary"] == body["error_estimate"] == [None, None]
    assert body["method"] == "none"


@pytest.mark.parametrize(
    ("changes", "method"),
    [
        ({"cash_dividends": [{"time": 0.5, "amount": 2.0}]}, "obstacle-march"),
        ({"rate": 0.02, "dividend_yield": 0.05, "volatility": 0.1}, "premium-march"),
        ({"rate": -0.01, "dividend_yield": -0.04, "volatility": 0.1}, "obstacle-march"),
        (
            {
                "rate": -0.01,
                "dividend_yield": -0.04,
                "volatility": 0.1,
                "cash_dividends": [{"time": 0.5, "amount": 2.0}],
            },
            "obstacle-march",
        ),
    ],
)
def test_the_method_is_that_of_the_engine_that_found_the_boundary(
    client: TestClient, question: dict[str, Any], changes: dict[str, Any], method: str
) -> None:
    body = client.post("/v1/boundary", json=question | changes | {"times": [0.0, 0.5]}).json()
    assert method in body["method"].split(", ")


@pytest.mark.parametrize(
    ("times", "field"),
    [
        ([], "times"),
        ([0.0] * (LARGEST_TIMES + 1), "times"),
        ([0.0, -0.1], "times[1]"),
        ([0.0, "0.5"], "times[1]"),
        (0.5, "times"),
        ([0.5, 1.5], "times"),
    ],
)
def test_times_must_be_numbers_within_the_life_of_the_option(
    client: TestClient, question: dict[str, Any], times: object, field: str
) -> None:
    answer = client.post("/v1/boundary", json=question | {"times": times})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == field
