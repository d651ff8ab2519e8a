"""The OpenAPI description against the service: its examples are answered as shown, its schema takes what is taken."""

from itertools import product
from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.problems.needs_kernel import needs_kernel

ROUTES = ["/v1/price", "/v1/batch", "/v1/boundary", "/v1/surface", "/v1/exercise-advice"]
ROUTES += ["/v1/implied-volatility"]
# Its answer is long, and is looked at in routes/test_chain.py.
CHAIN = "/v1/chain"
CONTRACTS = [route for route in ROUTES if route != "/v1/batch"]
TIMES = {"expiry": 1.0, "valuation_date": "2026-01-02", "expiration_date": "2027-01-02"}
# Which of these are given: the expiry alone, or both dates alone.
TAKEN = {("given", "", ""), ("", "given", "given")}
MACHINE = ("engine_version", "instruction_set")


def operation(client: TestClient, path: str) -> dict[str, Any]:
    found: dict[str, Any] = client.get("/openapi.json").json()["paths"][path]["post"]
    return found


def question_schema(client: TestClient, path: str) -> dict[str, Any]:
    found: dict[str, Any] = operation(client, path)["requestBody"]["content"]["application/json"]["schema"]
    return found


def assert_alike(found: Any, shown: Any, name: str = "") -> None:
    """Compare an answer with the one that is shown, which has six digits; errors may differ more between machines."""
    if isinstance(shown, dict):
        assert found.keys() == shown.keys()
        for key, value in shown.items():
            assert_alike(found[key], value, key)
    elif isinstance(shown, list):
        assert len(found) == len(shown)
        for one, other in zip(found, shown, strict=True):
            assert_alike(one, other, name)
    elif name in MACHINE:
        assert isinstance(found, str)
    elif name in ("error_estimate", "cost_error", "probability_error"):
        assert found == pytest.approx(shown, rel=0.1, abs=1e-9)
    elif isinstance(shown, float):
        assert found == pytest.approx(shown, rel=1e-5, abs=1e-8)
    else:
        assert found == shown, name


def test_every_question_has_its_example(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert {path for path, routes in paths.items() if "post" in routes} == {*ROUTES, CHAIN}


@needs_kernel
@pytest.mark.parametrize("path", ROUTES)
def test_every_example_is_answered_as_is_shown(client: TestClient, path: str) -> None:
    shown = operation(client, path)["responses"]["200"]["content"]["application/json"]["example"]
    (question,) = question_schema(client, path)["examples"]
    answer = client.post(path, json=question)
    assert answer.status_code == 200
    assert_alike(answer.json(), shown)


@pytest.mark.parametrize("path", CONTRACTS)
def test_the_schema_takes_an_expiry_or_both_dates_as_the_service_does(client: TestClient, path: str) -> None:
    schema = question_schema(client, path)
    example = schema["examples"][0] | ({} if "implied" in path else {"tolerance": 1e-2})
    bare = {name: value for name, value in example.items() if name not in TIMES}
    for kept in product(("given", "null", "absent"), repeat=len(TIMES)):
        times = {
            name: value if how == "given" else None
            for (name, value), how in zip(TIMES.items(), kept, strict=True)
            if how != "absent"
        }
        taken = tuple(how if how == "given" else "" for how in kept) in TAKEN
        assert sum(_allows(choice, times) for choice in schema["oneOf"]) == taken
        assert (client.post(path, json=bare | times).status_code == 200) == taken, times


def _allows(choice: dict[str, Any], times: dict[str, Any]) -> bool:
    """Tell whether one of the schema's choices takes these keys; it knows `required` and types alone."""
    kinds = {"null": type(None), "number": float, "string": str}
    assert set(choice) == {"required", "properties"}
    return set(choice["required"]) <= set(times) and all(
        isinstance(times[name], kinds[what["type"]])
        for name, what in choice["properties"].items()
        if name in times
    )
