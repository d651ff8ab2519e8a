import re
from html.parser import HTMLParser
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.service.errors import HTTP_TYPES, PROBLEM_TYPES
from app.service.schemas import PriceRequest


class Elements(HTMLParser):
    """Collects tags and the attributes that load something or are targets."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "href"):
                self.links.append(value or "")
            if name == "id":
                self.ids.add(value or "")


def test_the_page_loads_nothing_from_anywhere_and_runs_no_script(client: TestClient) -> None:
    answer = client.get("/docs")
    assert answer.headers["content-type"].startswith("text/html")
    page = Elements(answer.text)
    assert not page.tags & {"script", "link", "img", "iframe"}
    assert page.links == ["/openapi.json"]


def test_the_page_describes_every_operation_field_and_problem(client: TestClient) -> None:
    text = client.get("/docs").text
    operations = ("POST /v1/price", "POST /v1/boundary", "POST /v1/implied-volatility", "GET /readyz")
    for words in (
        *operations,
        *PriceRequest.model_fields,
        "array of objects of time, ex_date, amount or pairs at most 366",
    ):
        assert words in text
    problems = {kind.name for kind in (*PROBLEM_TYPES.values(), *HTTP_TYPES.values())}
    assert problems <= Elements(text).ids


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary", "/v1/implied-volatility"])
def test_the_described_body_has_ranges_and_its_example_is_answered(client: TestClient, address: str) -> None:
    description: dict[str, Any] = client.get("/openapi.json").json()
    operation = description["paths"][address]["post"]
    schema = operation["requestBody"]["content"]["application/json"]["schema"]
    assert schema["additionalProperties"] is False
    assert schema["properties"]["exercise_start"]["oneOf"][0]["maximum"] == 200.0
    assert schema["properties"]["rate"]["oneOf"][1]["properties"]["values"]["items"]["maximum"] == 2.0
    assert all(field.get("description") and field.get("examples") for field in schema["properties"].values())
    (example,) = schema["examples"]
    assert ("volatility" in example) == (address != "/v1/implied-volatility")
    assert client.post(address, json=example | {"tolerance": 1e-3}).status_code == 200
    alone = {"exercise_times", "valuation_date", "expiration_date", "bid", "ask"}  # these need one another
    for name, field in schema["properties"].items():
        if name not in alone and "dividends" not in name:
            changed = example | {"tolerance": 1e-3} | {name: field["examples"][0]}
            assert client.post(address, json=changed).status_code == 200, name
    assert {"200", "413", "415", "422", "503"} <= set(operation["responses"])


def test_every_reference_of_the_description_resolves(client: TestClient) -> None:
    answer = client.get("/openapi.json")
    schemas = answer.json().get("components", {}).get("schemas", {})
    references = set(re.findall(r'"\$ref": ?"([^"]+)"', answer.text))
    assert references
    assert references <= {f"#/components/schemas/{name}" for name in schemas}
