from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.settings import Settings
from pricing_core.american import CashDividend, Market, Option, exercise_advice
from tests.app.service.test_hostile_inputs import CANARY, assert_problem
from tests.problems.needs_kernel import needs_kernel

DIVIDENDS = [{"time": 0.3, "amount": 2.0}, {"time": 0.8, "amount": 2.0}]
LISTS = ("time", "cumulative_probability", "assignment_probability", "cost_of_waiting", "cost_error")
NUMBERS = (
    *("probability", "probability_error", "expected_time", "exercised_at_expiry", "expires_worthless"),
    *("exercise_now", "exercise_boundary", "status", "method"),
)
pytestmark = needs_kernel


@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("times", [None, [0.1, 0.3, 1.0]])
def test_an_advice_is_that_of_the_library(
    client: TestClient, question: dict[str, Any], option_type: str, times: list[float] | None
) -> None:
    given = {} if times is None else {"times": times}
    body = question | {"option_type": option_type, "spot": 105.0, "cash_dividends": DIVIDENDS} | given
    answer = client.post("/v1/exercise-advice", json=body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    market = Market(105.0, 0.05, 0.2, cash_dividends=[CashDividend(**one) for one in DIVIDENDS])
    wanted = exercise_advice(Option(option_type, 100.0, 1.0), market, times, tolerance=1e-4)
    for name in NUMBERS:
        assert found[name] == getattr(wanted, name), name
    for name in LISTS:
        assert found[name] == getattr(wanted, name).tolist(), name
    assert set(found) == {*NUMBERS, *LISTS, "engine_version", "instruction_set"}


def test_what_never_happens_has_no_expected_time(client: TestClient, question: dict[str, Any]) -> None:
    body = client.post("/v1/exercise-advice", json=question | {"option_type": "call"}).json()
    assert (body["probability"], body["expected_time"], body["exercise_boundary"]) == (0.0, None, None)
    assert body["exercised_at_expiry"] + body["expires_worthless"] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"times": []}, "times"),
        ({"times": [0.5, 0.2]}, "times"),
        ({"times": [2.0]}, "times"),
        ({"times": [0.5] * 1001}, "times"),
        ({"times": [CANARY]}, "times[0]"),
        ({"volatility": 0.0}, "volatility"),
        ({"spot": None}, "spot"),
        ({"greeks": "none"}, "key of the body"),
    ],
)
def test_a_wrong_question_is_refused(
    client: TestClient, question: dict[str, Any], changes: dict[str, Any], field: str
) -> None:
    answer = client.post("/v1/exercise-advice", json=question | changes)
    assert assert_problem(answer, 422, "invalid-input")["errors"][0]["field"] == field


def test_a_deadline_ends_the_work_with_a_503(question: dict[str, Any], waited_for: None) -> None:
    times = np.linspace(0.0, 1.0, 367)[1:].tolist()
    hard = {"cash_dividends": [{"time": time, "amount": 0.05} for time in times], "option_type": "call"}
    with TestClient(create_app(Settings(slots=2, deadline_seconds=1e-6))) as client:
        answer = client.post("/v1/exercise-advice", json=question | hard)
    assert "fewer times" in assert_problem(answer, 503, "deadline")["detail"]
    assert int(answer.headers["retry-after"]) > 0
