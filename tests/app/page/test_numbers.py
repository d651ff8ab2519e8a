"""What stands on the page is what the service answers."""

import csv
import json
import random
from pathlib import Path
from typing import Any

import pytest

from app.service.schemas import ImpliedVolatilityRequest, PriceRequest
from pricing_core.american.contracts.result_fields import PRICE_FIELDS
from tests.app.page.page import DIVIDENDS, PUT, Page
from tests.app.service.server_process import Server
from tests.problems.nightly import nightly


def random_question(seed: int) -> dict[str, Any]:
    """Return a contract of one of the kinds that the form knows; every kind comes up."""
    choose = random.Random(seed)
    question: dict[str, Any] = {
        "option_type": choose.choice(["put", "call"]),
        "spot": round(choose.uniform(70, 130), 2),
        "strike": 100,
        "expiry": round(choose.uniform(0.1, 3), 3),
        "rate": round(choose.uniform(-0.01, 0.08), 4),
        "volatility": round(choose.uniform(0.1, 0.5), 3),
        "tolerance": 1e-4,
    }
    kinds: list[dict[str, Any]] = [
        {"dividend_yield": 0.03},
        {"cash_dividends": [{"time": 0.05, "amount": 1.5}]},
        {"proportional_dividends": [{"time": 0.05, "fraction": 0.02}], "greeks": "extended"},
        {"rate": {"times": [0.05, 1], "values": [0.02, 0.05]}, "exercise": "european"},
        {"exercise": "bermudan", "exercise_times": [0.02, 0.08]},
        {"greeks_units": "per_day_per_point", "exercise_start": 0.05},
        {"cash_dividends": [{"time": 0.05, "amount": 2}], "dividend_model": "escrowed"},
        {"expiry": None, "valuation_date": "2026-01-02", "expiration_date": "2026-12-18"},
        {"underlying": "future", "settlement_lag": 2},
        {"borrow_rate": 0.01, "foreign_rate": 0.02, "quanto_covariance": 0.01},
    ]
    question |= kinds[seed % len(kinds)]
    return {name: value for name, value in question.items() if value is not None}


@pytest.mark.parametrize("seed", [*range(6), *nightly(range(6, 10))])
def test_the_numbers_are_those_of_the_service(page: Page, page_server: Server, seed: int) -> None:
    question = random_question(seed)
    page.open(question)
    status, _, answer = page_server.request("POST", "/v1/price", question | {"greek_errors": True})
    assert status == 200
    assert page.price() == answer["price"]
    drawn = page.at("#price").text.replace("−", "-")
    decimals = len(drawn.partition(".")[2])
    assert abs(float(drawn) - answer["price"]) <= 0.5 * 10.0**-decimals + 1e-12
    digits = len(drawn.replace(".", "").lstrip("0"))
    assert digits == 8 or 10.0**-decimals <= 10.0 * answer["error_estimate"]
    units = {field.name: field.unit for field in PRICE_FIELDS}
    for row in page.all("#numbers tbody tr"):
        name = row.find_element("css selector", "data").get_dom_attribute("data-name") or ""
        field, _, index = name.partition(".")
        value = answer[field][int(index)] if index else answer[field]
        assert page.number(name) == value
        if question.get("greeks_units") is None:
            assert row.find_element("css selector", "td.unit").text == units[field]
    shown = {name for name in ("european_price", "delta", "vega", "rho") if page.number(name) is not None}
    assert len(shown) == 4


def test_every_input_of_the_vocabulary_has_a_field(page: Page) -> None:
    page.open(PUT)
    fields = {one.get_dom_attribute("data-field") for one in page.all("[data-field]")}
    assert fields - {"mode", "time"} == {*PriceRequest.model_fields, *ImpliedVolatilityRequest.model_fields}


def test_an_implied_volatility_is_that_of_the_service(page: Page, page_server: Server) -> None:
    question = {name: value for name, value in PUT.items() if name != "volatility"} | {"option_price": 8.0}
    page.open(question | {"mode": "volatility"})
    found = page_server.request("POST", "/v1/implied-volatility", question)[2]
    assert page.price() == found["volatility"]
    assert not page.at('[data-field="volatility"]').is_displayed()
    page.type("option_price", "101")  # more than exercise ever brings
    page.eventually(lambda: "no such volatility" in page.at("#charts-old").text, "a reason")
    page.type("option_price", "")
    page.eventually(lambda: page.at("#form-error").text + page.error_at("option_price") != "", "an error")


def test_a_link_leads_to_the_same_contract(page: Page) -> None:
    question = {
        **PUT,
        "cash_dividends": DIVIDENDS,
        "rate": {"times": [0.5, 1], "values": [0.03, 0.05]},
        "tolerance": 1e-3,
        "greeks": "extended",
    }
    page.open(question)
    first = page.script("return location.hash")
    price = page.price()
    page.browser.get("about:blank")
    page.browser.get(page.address + first)
    page.settled()
    assert page.script("return location.hash") == first
    assert page.price() == price
    assert len(page.all('[data-field="cash_dividends"] .row')) == 4


def test_the_numbers_and_the_charts_can_be_downloaded(page: Page, tmp_path: Path) -> None:
    page.browser.execute_cdp_cmd(
        "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)}
    )
    page.open(PUT | {"cash_dividends": DIVIDENDS})
    page.click("#download-json")
    page.click("#download-csv")
    page.click("#boundary-chart summary")
    page.click("#boundary-chart details button")
    names = ("option.json", "option.csv", "boundary-chart.csv")
    page.eventually(lambda: all((tmp_path / name).exists() for name in names), "three files")
    assert json.loads((tmp_path / "option.json").read_text())["price"]["price"] == page.price()
    with (tmp_path / "option.csv").open(newline="") as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    assert float(rows["price"]["value"]) == page.price()
    assert rows["vega"]["unit"] == "money per 1.00 of volatility"
    with (tmp_path / "boundary-chart.csv").open(newline="") as file:
        assert len(list(csv.reader(file))) > 50
