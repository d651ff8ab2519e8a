"""A local volatility through every door: columns, frames, files, the command, HTTP and the client."""

import json
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

from app.client.questions import contract_question, contracts_table
from pricing_core.american import (
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
    implied_volatility,
    price,
    price_many,
    value_surface,
)
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.batch import price_table, value_scenarios

TOLERANCE = 1e-4
SURFACE = LocalVolatility.from_function(
    lambda time, spots: 0.2 * (spots / 100.0) ** -0.5 + 0.03 * time,
    [0.0, 0.5, 1.0],
    np.geomspace(50, 200, 12),
)
CURVE = {"times": [0.5, 1.0], "values": [0.2, 0.3]}
GIVEN = {name: getattr(SURFACE, name).tolist() for name in ("times", "spots", "values")}
TEXT = json.dumps(GIVEN)
OPTIONS = [Option("put", 100.0, 1.0), Option("call", 105.0, 1.0)]
MARKET = Market(100.0, 0.05, SURFACE)
COLUMNS = {
    "option_type": ["put", "call"],
    "spot": [100.0, 100.0],
    "strike": [100.0, 105.0],
    "expiry": [1.0, 1.0],
    "rate": [0.05, 0.05],
}


def expected(name: str = "price") -> list[Any]:
    return [getattr(price(option, MARKET, tolerance=TOLERANCE), name) for option in OPTIONS]


@pytest.mark.parametrize("cell", [SURFACE, GIVEN, TEXT])
def test_a_column_may_hold_it_in_every_form(cell: Any) -> None:
    for column in (cell, [cell, cell]):
        table = price_many({**COLUMNS, "volatility": column}, tolerance=TOLERANCE)
        assert table["price"].tolist() == expected()
        assert table["delta_sticky_moneyness"].tolist() == expected("delta_sticky_moneyness")


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 1, 0, 2], [1, 0, 3, 2]])
def test_rows_stay_in_order_beside_numbers_and_curves(order: list[int]) -> None:
    cells = [SURFACE, 0.2, CURVE, GIVEN]
    table = price_many(
        {"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05}
        | {"volatility": [cells[place] for place in order]},
        tolerance=TOLERANCE,
    )
    alone = [price(OPTIONS[0], Market(100.0, 0.05, cells[place]), tolerance=TOLERANCE) for place in order]
    assert table["price"].tolist() == [one.price for one in alone]
    sticky = [None if np.isnan(one) else one for one in table["delta_sticky_moneyness"].tolist()]
    assert sticky == [one.delta_sticky_moneyness for one in alone]


def test_frames_hold_it() -> None:
    for cell in (GIVEN, TEXT):
        columns = {**COLUMNS, "volatility": [cell, cell]}
        for frame in (pd.DataFrame(columns), pl.DataFrame(columns), pa.table(columns)):
            assert list(price_many(frame, tolerance=TOLERANCE)["price"].to_numpy()) == expected()
    surfaces = pd.DataFrame({**COLUMNS, "volatility": [SURFACE, SURFACE]})
    assert price_many(surfaces, tolerance=TOLERANCE)["price"].tolist() == expected()
    assert price_table(pa.table({**COLUMNS, "volatility": [TEXT, TEXT]}), tolerance=TOLERANCE)[
        "price"
    ].to_pylist() == pytest.approx(expected())


def test_what_is_wrong_with_a_row_is_named() -> None:
    ragged = {"times": [0.0], "spots": [90.0, 110.0], "values": [[0.2]]}
    table = price_many({**COLUMNS, "volatility": [ragged, 0.2]}, tolerance=TOLERANCE)
    assert table["status"].tolist() == ["invalid_input", "ok"]
    assert "volatility.values[0]" in table["message"][0]


def test_the_command_reads_it(pricing: Any, tmp_path: Any) -> None:
    terms = ["--option-type", "put", "--spot", 100, "--strike", 100, "--expiry", 1, "--rate", 0.05]
    terms += ["--tolerance", TOLERANCE, "--json"]
    status, output, errors = pricing("price", *terms, "--volatility", TEXT)
    assert (status, errors) == (0, "")
    assert json.loads(output)["price"] == expected()[0]
    assert json.loads(output)["delta_sticky_moneyness"] == expected("delta_sticky_moneyness")[0]
    status, _, errors = pricing(
        "price", *terms, "--volatility", '{"times": [0], "spots": [2, 1], "values": [[0.1, 0.1]]}'
    )
    assert status == 2
    assert "volatility.spots" in errors
    status, output, _ = pricing("boundary", *terms, "--volatility", TEXT)
    assert status == 0
    assert json.loads(output)["boundary"][0] == pytest.approx(80.0, abs=4.0)


def test_files_hold_it(pricing: Any, tmp_path: Any) -> None:
    table = pd.DataFrame({**COLUMNS, "volatility": [TEXT, TEXT]})
    table.to_csv(tmp_path / "in.csv", index=False)
    table.to_parquet(tmp_path / "in.parquet", index=False)
    for ending in ("csv", "parquet"):
        source, target = tmp_path / f"in.{ending}", tmp_path / f"out.{ending}"
        status, _, errors = pricing("batch", source, target, "--tolerance", TOLERANCE, "--quiet")
        assert status == 0, errors
        found = pd.read_csv(target) if ending == "csv" else pd.read_parquet(target)
        assert found["price"].tolist() == pytest.approx(expected())


def test_the_service_answers(client: Any, question: dict[str, Any]) -> None:
    asked = question | {"volatility": GIVEN}
    answer = client.post("/v1/price", json=asked)
    assert answer.status_code == 200, answer.text
    assert answer.json()["price"] == expected()[0]
    assert answer.json()["delta_sticky_moneyness"] == expected("delta_sticky_moneyness")[0]
    boundary = client.post("/v1/boundary", json=asked | {"times": [0.0, 0.5]})
    alone = exercise_boundary(OPTIONS[0], MARKET, times=[0.0, 0.5], tolerance=TOLERANCE)
    assert boundary.json()["boundary"] == pytest.approx(alone.boundary.tolist())
    surface = client.post("/v1/surface", json=asked | {"times": [0.0, 0.5], "spots": [90.0, 110.0]})
    values = value_surface(OPTIONS[0], MARKET, spots=[90.0, 110.0], times=[0.0, 0.5], tolerance=TOLERANCE)
    np.testing.assert_allclose(surface.json()["value"], values.value, rtol=1e-9)
    batch = client.post("/v1/batch", json=[{**asked, "strike": strike} for strike in (90.0, 100.0)])
    if batch.status_code == 200:
        assert batch.json()["results"][1]["price"] == expected()[0]
    implied = client.post("/v1/implied-volatility", json=asked | {"option_price": 6.0})
    flat = implied_volatility(OPTIONS[0], Market(100.0, 0.05, 0.2), 6.0, tolerance=TOLERANCE)
    assert implied.json()["volatility"] == pytest.approx(flat.volatility, abs=1e-6)


def test_the_service_takes_the_largest_one(client: Any, question: dict[str, Any]) -> None:
    rng = np.random.default_rng(4)
    largest = {
        "times": np.linspace(0.0, 2.0, 100).tolist(),
        "spots": np.linspace(20.0, 300.0, 100).tolist(),
        "values": rng.uniform(0.19, 0.21, (100, 100)).tolist(),
    }
    asked = question | {"volatility": largest, "tolerance": 1e-2, "greeks": "none"}
    assert len(json.dumps(asked)) > 100_000
    answer = client.post("/v1/price", json=asked)
    assert answer.status_code == 200, answer.text
    assert 5.0 < answer.json()["price"] < 7.0
    row = json.dumps({name: value for name, value in asked.items() if name != "greeks"})
    headers = {"Content-Type": "application/x-ndjson"}
    batch = client.post("/v1/batch?greeks=none", content=f"{row}\n{row}\n", headers=headers)
    assert [json.loads(line)["price"] for line in batch.text.splitlines()] == [answer.json()["price"]] * 2


@pytest.mark.parametrize(
    "changes",
    [
        {"values": [[0.2]]},
        {"values": [[0.2, -0.1]]},
        {"spots": [2.0, 1.0]},
        {"times": [0.0, 1.0]},
        {"spots": [0.0, 1.0]},
        {"values": [[16.0, 0.2]]},
        {"more": 1.0},
        {"spots": [float(k + 1) for k in range(101)], "values": [[0.2] * 101]},
    ],
)
def test_the_service_refuses_what_is_no_surface(
    client: Any, question: dict[str, Any], changes: dict[str, Any]
) -> None:
    volatility = {"times": [0.0], "spots": [90.0, 110.0], "values": [[0.2, 0.2]]} | changes
    answer = client.post("/v1/price", json=question | {"volatility": volatility})
    assert answer.status_code == 422
    assert "volatility" in answer.text


def test_the_client_asks_with_it() -> None:
    asked = json.loads(contract_question("v1/price", OPTIONS[0], MARKET).body)
    assert asked["volatility"] == GIVEN
    table = contracts_table({**COLUMNS, "volatility": [SURFACE, 0.2]})
    assert json.loads(table["volatility"][0].as_py()) == GIVEN


def test_scenarios_shift_it_and_let_time_pass() -> None:
    table = pa.table({**COLUMNS, "volatility": [GIVEN, GIVEN]})
    found = value_scenarios(
        table,
        spot_shifts=[-0.1, 0.0],
        volatility_shifts=[0.0, 0.05],
        days_forward=[0, 30],
        tolerance=TOLERANCE,
    ).to_pylist()
    for row in found[:8]:
        market = Market(100.0 * (1.0 + row["spot_shift"]), 0.05, SURFACE)
        option, market = seen_later(OPTIONS[0], market, row["days_forward"] / 365.0)
        assert isinstance(market.volatility, LocalVolatility)
        market = Market(market.spot, 0.05, market.volatility.shifted(row["volatility_shift"]))
        assert row["price"] == pytest.approx(price(option, market, tolerance=TOLERANCE).price, abs=1e-9)


def test_the_volatility_of_the_market_does_not_change_what_is_implied() -> None:
    markets = [
        Market(100.0, 0.05, volatility)
        for volatility in (0.2, SURFACE, PiecewiseConstant([1.0, 2.0], [0.1, 0.3]))
    ]
    assert len({implied_volatility(OPTIONS[0], market, 6.0).volatility for market in markets}) == 1
