from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.greeks_units import PER_DAY_PER_POINT
from app.main import create_app
from app.service.routes.surface import BYTES_OF_POINT
from app.settings import Settings
from pricing_core.american import Market, Option, value_surface
from tests.app.service.test_hostile_inputs import CANARY, assert_problem
from tests.problems.needs_kernel import needs_kernel

POINTS = {"spots": [80.0, 100.0, 120.0], "times": [0.0, 0.5, 1.0]}
MATRICES = ("value", "delta", "gamma", "theta", "vega", "multiplier", "error_estimate")


def test_what_a_surface_takes_is_counted_before_it_is_made(
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.service.routes.surface.value_surface", pytest.fail)
    body = {name: value for name, value in question.items() if name != "spot"}
    with TestClient(create_app(Settings(max_batch_bytes=9 * BYTES_OF_POINT - 1))) as client:
        assert_problem(client.post("/v1/surface", json=body | POINTS), 413, "body-too-large")
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]


@needs_kernel
@pytest.mark.parametrize("seed", range(3))
def test_a_surface_is_that_of_the_library(client: TestClient, question: dict[str, Any], seed: int) -> None:
    rng = np.random.default_rng(seed)
    spots, times = rng.uniform(50.0, 150.0, 5), np.sort(rng.uniform(0.0, 1.0, 3))
    body = {name: value for name, value in question.items() if name != "spot"}
    answer = client.post("/v1/surface", json=body | {"spots": spots.tolist(), "times": times.tolist()})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    market = Market(100.0, 0.05, 0.2)
    wanted = value_surface(Option("put", 100.0, 1.0), market, spots=spots, times=times, tolerance=1e-4)
    for name in MATRICES:
        assert np.array_equal(np.array(found[name], dtype=float), getattr(wanted, name), equal_nan=True), name
    assert found["exercised"] == wanted.exercised.tolist()
    assert found["perpetual_boundary"] == wanted.perpetual_boundary
    assert (found["status"], found["method"]) == ("ok", wanted.method)
    assert found["greeks_units"] == "per_year_per_unit"
    assert found["engine_version"]
    assert found["instruction_set"]


def test_greeks_come_in_the_units_asked_for_or_not_at_all(
    client: TestClient, question: dict[str, Any]
) -> None:
    def ask(**more: object) -> Any:
        return client.post("/v1/surface", json=question | POINTS | more).json()

    plain, scaled, without = ask(), ask(greeks_units="per_day_per_point"), ask(greeks="none")
    for name in ("delta", "gamma", "theta", "vega"):
        by = PER_DAY_PER_POINT.get(name, 1.0)
        for before, after in zip(plain[name], scaled[name], strict=True):
            assert after == [None if number is None else pytest.approx(by * number) for number in before]
        assert without[name] is None
    assert scaled["value"] == plain["value"]
    assert scaled["greeks_units"] == "per_day_per_point"


@pytest.mark.parametrize(
    "change",
    [
        {"spots": []},
        {"spots": None},
        {"spots": [CANARY]},
        {"spots": [-1.0]},
        {"spots": [1e-300]},
        {"spots": [100.0] * 1_001},
        {"times": [1.5]},
        {"times": [-0.5]},
        {"times": "0"},
        {"spots": [100.0] * 1_000, "times": [0.0] * 51},
        {"greeks": "extended"},
        {"greeks_units": CANARY},
        {"unknown": CANARY},
    ],
)
def test_what_is_no_surface_is_refused(
    client: TestClient, question: dict[str, Any], change: dict[str, Any]
) -> None:
    assert_problem(client.post("/v1/surface", json=question | POINTS | change), 422, "invalid-input")


def test_a_surface_that_is_not_ready_by_the_deadline_is_refused(
    question: dict[str, Any], waited_for: None
) -> None:
    hard = {"rate": -0.01, "dividend_yield": -0.02, "expiry": 30.0, "tolerance": 1e-8}
    many = {"spots": np.linspace(60.0, 140.0, 100).tolist(), "times": np.linspace(0.0, 29.0, 100).tolist()}
    with TestClient(create_app(Settings(slots=2, deadline_seconds=1e-6))) as client:
        problem = assert_problem(client.post("/v1/surface", json=question | hard | many), 503, "deadline")
    assert "fewer points are faster" in problem["detail"]
