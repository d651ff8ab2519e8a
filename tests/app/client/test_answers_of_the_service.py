"""The client asks a real server, and finds what the library finds."""

import asyncio
import random
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

from app.client import AsyncClient, ChainAnswer, Client, ServiceRefusedError
from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    exercise_advice,
    exercise_boundary,
    implied_volatility,
    price,
    price_many,
    value_surface,
)
from pricing_core.american.contracts.dividends import ProportionalDividend
from pricing_core.chains import fit_chain, read_chain
from pricing_core.errors import InvalidInputError
from tests.app.service.server_process import Server, running
from tests.problems.eventually import PATIENCE

CHAIN = Path(__file__).parents[2] / "data" / "chains" / "generic.csv"


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running() as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    with Client(f"http://127.0.0.1:{server.port}", timeout=PATIENCE) as client:
        yield client


def random_contract(seed: int) -> tuple[Option, Market]:
    choose = random.Random(seed)
    kinds: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({}, {}),
        ({}, {"cash_dividends": (CashDividend(0.1, 1.0), CashDividend(0.3, 2.0))}),
        ({"exercise": "bermudan", "exercise_times": (0.1, 0.2)}, {"dividend_yield": 0.04}),
        ({"exercise": "european"}, {"rate": PiecewiseConstant([0.2, 1.0], [0.01, 0.05])}),
        ({"exercise_start": 0.1}, {"proportional_dividends": (ProportionalDividend(0.2, 0.03),)}),
        ({}, {"rate": -0.01, "dividend_yield": -0.04}),
    ]
    terms, conditions = kinds[seed % len(kinds)]
    kind = choose.choice(["put", "call"])
    option = Option(kind, strike=choose.uniform(80, 120), expiry=choose.uniform(0.4, 2), **terms)
    market = {"spot": choose.uniform(80, 120), "rate": 0.04, "volatility": choose.uniform(0.15, 0.4)}
    return option, Market(**(market | conditions))


def same(one: object, other: object) -> bool:
    """Compare results field by field, diagnostics apart, which the service does not send."""
    for field in fields(one):  # type: ignore[arg-type]
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if field.name == "diagnostics":
            continue
        if isinstance(mine, np.ndarray):
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)
        else:
            assert mine == theirs, field.name
    return True


@pytest.mark.parametrize("seed", range(12))
def test_every_answer_is_what_the_library_finds(client: Client, seed: int) -> None:
    option, market = random_contract(seed)
    greeks = ("none", "standard", "extended")[seed % 3]
    found = client.price(option, market, tolerance=1e-4, greeks=greeks)  # type: ignore[arg-type]
    assert same(found, price(option, market, tolerance=1e-4, greeks=greeks))  # type: ignore[arg-type]
    boundary = client.boundary(option, market, [0.0, 0.3], tolerance=1e-4)
    assert same(boundary, exercise_boundary(option, market, [0.0, 0.3], tolerance=1e-4))
    assert found.price is not None
    implied = client.implied_volatility(option, market, found.price, tolerance=1e-4)
    assert same(implied, implied_volatility(option, market, found.price, tolerance=1e-4))
    advice = client.exercise_advice(option, market, [0.1, 0.3], tolerance=1e-4)
    expected = exercise_advice(option, market, [0.1, 0.3], tolerance=1e-4)
    assert same(replace(advice, expected_time=0.0), replace(expected, expected_time=0.0))
    assert advice.expected_time == pytest.approx(expected.expected_time, rel=1e-15, nan_ok=True)
    points = {"spots": [90.0, 110.0], "times": [0.0, 0.3], "tolerance": 1e-4}
    assert same(client.surface(option, market, **points), value_surface(option, market, **points))  # type: ignore[arg-type]


def test_both_clients_find_the_same(client: Client, server: Server) -> None:
    option, market = random_contract(1)

    async def ask() -> list[Any]:
        async with AsyncClient(f"http://127.0.0.1:{server.port}", timeout=PATIENCE) as other:
            return await asyncio.gather(
                other.price(option, market),
                other.boundary(option, market, [0.1]),
                other.exercise_advice(option, market, [0.1]),
                other.implied_volatility(option, market, bid=9.0, ask=9.5),
                other.surface(option, market, spots=[100.0], times=[0.0]),
                other.price_many({"spot": [100.0], "strike": 90.0, "expiry": 1.0, "rate": 0.0, **COMMON}),
            )

    found = asyncio.run(ask())
    mine = (
        client.price(option, market),
        client.boundary(option, market, [0.1]),
        client.exercise_advice(option, market, [0.1]),
        client.implied_volatility(option, market, bid=9.0, ask=9.5),
        client.surface(option, market, spots=[100.0], times=[0.0]),
    )
    assert all(same(one, other) for one, other in zip(mine, found[:5], strict=True))
    assert found[5]["status"].tolist() == ["ok"]


COMMON = {"option_type": "put", "volatility": 0.2}


@pytest.mark.parametrize(
    "columns",
    [
        {"spot": [90.0, 100.0, -1.0], "rate": 0.05},
        {"spot": 100.0, "rate": [0.05, {"times": [0.5, 1.0], "values": [0.02, 0.04]}]},
        {"spot": np.array([95.0, 105.0]), "rate": 0.05, "cash_dividends": [CashDividend(0.25, 1.0)]},
        {"spot": [95.0, 105.0], "rate": 0.03, "cash_dividends": [[{"time": 0.25, "amount": 1.0}], []]},
        {"spot": [95.0, 105.0], "rate": 0.03, "exercise": "bermudan", "exercise_times": [0.25, 0.5]},
        {"spot": [95.0], "rate": PiecewiseConstant([0.5], [0.02])},
    ],
)
@pytest.mark.parametrize("greeks", ["none", "extended"])
def test_many_contracts_have_the_results_of_price_many(
    client: Client, columns: dict[str, Any], greeks: Any
) -> None:
    whole = {**COMMON, "strike": 100.0, "expiry": 1.0, **columns}
    found = client.price_many(whole, tolerance=1e-4, greeks=greeks, greek_errors=True)
    expected = price_many(whole, tolerance=1e-4, greeks=greeks, greek_errors=True)
    assert set(found) == set(expected)
    for name in set(found) - {"message"}:
        assert found[name].shape == expected[name].shape
        mine, theirs = repr(found[name].tolist()), repr(expected[name].tolist())  # in which NaN is like NaN
        assert mine == theirs, name
    assert [bool(text) for text in found["message"]] == [bool(text) for text in expected["message"]]


FRAMES = {
    "arrow": pa.table,
    "pandas": lambda columns: pd.DataFrame(columns, index=["x", "y"]),
    "polars": pl.DataFrame,
}


def frame_of_two(kind: str) -> Any:
    numbers = {"spot": [90.0, 100.0], "strike": [100.0] * 2, "expiry": [1.0] * 2, "rate": [0.05] * 2}
    return FRAMES[kind]({"id": ["a", "b"], "option_type": ["put"] * 2, "volatility": [0.2] * 2, **numbers})


@pytest.mark.parametrize("kind", FRAMES)
def test_a_frame_comes_back_as_one_of_its_kind_with_the_results(client: Client, kind: str) -> None:
    frame = frame_of_two(kind)
    found, expected = client.price_many(frame, tolerance=1e-4), price_many(frame, tolerance=1e-4)
    assert type(found) is type(frame)
    if kind == "pandas":
        pd.testing.assert_frame_equal(found.drop(columns="message"), expected.drop(columns="message"))
    else:
        assert found.drop("message").equals(expected.drop(["message"]))


def test_a_frame_with_a_column_named_like_a_result_is_refused_before_it_is_sent() -> None:
    table = frame_of_two("arrow").append_column("price", pa.array([1.0, 2.0]))
    with Client("http://127.0.0.1:9") as nobody, pytest.raises(InvalidInputError, match="column price"):
        nobody.price_many(table)


def test_what_the_service_refuses_is_raised_as_the_library_raises_it(client: Client) -> None:
    option, market = Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2)
    with pytest.raises(InvalidInputError, match=r"tolerance = 1: must be a number from 1e-08 to 0\.01"):
        client.price(option, market, tolerance=1)
    with pytest.raises(InvalidInputError, match="times"):
        client.boundary(option, market, [2.0])
    with pytest.raises(InvalidInputError, match="lengths 2, 3"):
        client.price_many({"spot": [1.0, 2.0], "strike": [1.0, 2.0, 3.0]})
    with pytest.raises(InvalidInputError, match="expiry"):
        client.price_many({**COMMON, "spot": [1.0], "strike": 1.0, "rate": 0.0})


def test_a_service_that_wants_a_key_refuses_to_answer_without(tmp_path: Any) -> None:
    (tmp_path / "keys").write_text(f"desk {'0' * 64}\n")
    with running(PRICING_API_KEYS_FILE=str(tmp_path / "keys")) as server:
        address = f"http://127.0.0.1:{server.port}"
        for key in (None, "wrong"):
            with Client(address, key) as client, pytest.raises(ServiceRefusedError) as raised:
                client.price(Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2))
            assert raised.value.status == 401


def test_a_chain_is_fitted_as_the_library_fits_it(client: Client, server: Server) -> None:
    quotes, dividends = read_chain(CHAIN), [{"time": 0.1, "amount": 0.5}]
    expected = fit_chain(quotes, 0.04, cash_dividends=dividends)

    async def ask() -> ChainAnswer:
        async with AsyncClient(f"http://127.0.0.1:{server.port}", timeout=PATIENCE) as other:
            return await other.chain(CHAIN, 0.04, cash_dividends=dividends)

    for found in (client.chain(quotes, 0.04, cash_dividends=dividends), asyncio.run(ask())):
        assert found.quotes["status"].to_pylist() == expected.quotes["status"].to_pylist()
        assert found.carry["forward"].to_pylist() == pytest.approx(expected.carry["forward"].to_pylist())
        assert found.dividends["amount"].to_pylist() == [0.5]
        assert found.local_volatility is not None
        np.testing.assert_allclose(found.local_volatility.values, expected.local_volatility.values, rtol=1e-6)
        assert (dict(found.flags), dict(found.unfitted)) == (dict(expected.flags), expected.unfitted)
    with pytest.raises(InvalidInputError, match="rate"):
        client.chain(quotes, 5.0)
