"""Advice on exercise with a local volatility, and as columns, through the command, files and HTTP."""

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pricing_core.american import LocalVolatility, Market, Option, exercise_advice, price_many
from pricing_core.american.contracts.result_fields import ADVICE_COLUMN_FIELDS
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

GIVEN = {"times": [0.0], "spots": [60.0, 100.0, 160.0], "values": [[0.3, 0.22, 0.2]]}
OPTION, MARKET = Option("put", 100.0, 0.5), Market(100.0, 0.05, LocalVolatility(**GIVEN))
TERMS = ["--option-type", "put", "--spot", 100, "--strike", 100, "--expiry", 0.5, "--rate", 0.05]
NAMES = [field.name for field in ADVICE_COLUMN_FIELDS]
ROWS = {
    "option_type": ["put", "call"],
    "spot": [100.0, 100.0],
    "strike": [100.0, 100.0],
    "expiry": [1.0, 1.0],
    "rate": [0.05, 0.05],
    "volatility": [0.2, 0.2],
}


def test_the_command_advises_with_a_local_volatility_and_draws_it(pricing: Any, tmp_path: Any) -> None:
    picture = tmp_path / "advice.png"
    status, output, errors = pricing(
        "advice", *TERMS, "--volatility", json.dumps(GIVEN), "--json", "--plot", picture
    )
    assert (status, errors) == (0, "")
    expected = exercise_advice(OPTION, MARKET)
    assert json.loads(output)["probability"] == expected.probability
    assert json.loads(output)["cost_of_waiting"] == expected.cost_of_waiting.tolist()
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_the_command_tells_of_every_day(pricing: Any) -> None:
    short = [*TERMS[:-3], 0.02, *TERMS[-2:], "--volatility", 0.2]
    status, output, _ = pricing("advice", *short, "--daily", "--json")
    assert status == 0
    days = json.loads(output)["time"]
    assert days == pytest.approx([*(np.arange(1, 8) / 365.0), 0.02])
    assert len(json.loads(output)["assignment_probability"]) == len(days)
    status, _, errors = pricing("advice", *short, "--daily", "--time", 0.01)
    assert status == 2
    assert "daily" in errors


def test_files_have_columns_of_advice(pricing: Any, tmp_path: Any) -> None:
    expected = price_many(ROWS, advice=True)
    pd.DataFrame(ROWS).to_csv(tmp_path / "in.csv", index=False)
    status, _, errors = pricing("batch", tmp_path / "in.csv", tmp_path / "out.csv", "--advice", "--quiet")
    assert status == 0, errors
    found = pd.read_csv(tmp_path / "out.csv")
    for name in NAMES:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-12)


def test_the_service_advises(client: Any, question: dict[str, Any]) -> None:
    asked = question | {"expiry": 0.5, "volatility": GIVEN, "tolerance": 1e-4, "times": [0.25, 0.5]}
    answer = client.post("/v1/exercise-advice", json=asked)
    assert answer.status_code == 200, answer.text
    expected = exercise_advice(OPTION, MARKET, [0.25, 0.5], tolerance=1e-4)
    assert answer.json()["probability"] == pytest.approx(expected.probability, rel=1e-12)
    assert answer.json()["assignment_probability"] == pytest.approx(expected.assignment_probability.tolist())


def test_a_batch_over_http_has_columns_of_advice(client: Any) -> None:
    expected = price_many(ROWS, advice=True)
    answer = client.post("/v1/batch?advice=true", json=ROWS)
    assert answer.status_code == 200, answer.text
    for name in NAMES:
        found = [np.nan if number is None else number for number in answer.json()[name]]
        np.testing.assert_allclose(found, expected[name], rtol=1e-12)
    assert not set(NAMES) & set(client.post("/v1/batch", json=ROWS).json())
    assert client.post("/v1/batch?advice=2", json=ROWS).status_code == 422
