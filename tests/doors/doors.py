"""The doors of the library: every way in which a contract can be handed over to be priced."""

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
from typer.testing import CliRunner

from app.cli import app
from app.client import Client
from pricing_core.american import Market, Option, contract_from, implied_volatility_many, price, price_many
from pricing_core.american.contracts.dividends import is_pair
from pricing_core.american.contracts.json_text import cell_text, plain_json
from pricing_core.american.contracts.vocabulary import OF_MARKET, OF_OPTION
from pricing_core.batch import price_table, run_batch
from tests.app.service.server_process import Server

Contract = dict[str, Any]
TOLERANCE = 1e-4


class RefusedError(Exception):
    """A door has refused a contract; the message is what it says."""


@dataclass(frozen=True)
class Tools:
    """What some doors need: a service that runs, its client, and a folder."""

    server: Server
    client: Client
    folder: Path


@dataclass(frozen=True)
class Door:
    """One door.

    Parameters
    ----------
    words : str
        What it is, for the table of the documentation.
    price : callable
        Returns the price of a contract, or raises `InvalidInputError` or `RefusedError` with what the door says.
    has_cells : bool
        Whether a field may be there and hold nothing.
    """

    words: str
    price: Callable[[Contract, Tools], float]
    has_cells: bool = False


def arguments(contract: Contract, _: Tools) -> float:
    option = Option(**{name: value for name, value in contract.items() if name in OF_OPTION})
    market = Market(**{name: value for name, value in contract.items() if name in OF_MARKET})
    return number(price(option, market, tolerance=TOLERANCE, greeks="none").price)


def mapping(contract: Contract, _: Tools) -> float:
    return number(price(*contract_from(contract), tolerance=TOLERANCE, greeks="none").price)


def columns(contract: Contract, _: Tools) -> float:
    cells = {name: cell(value) for name, value in contract.items()}
    return of_columns(price_many(cells, tolerance=TOLERANCE, greeks="none"))


def volatilities(contract: Contract, _: Tools) -> float:
    """Return the price again from the volatility that it implies, where that is one number."""
    cells = {name: cell(value) for name, value in contract.items()}
    known = of_columns(price_many(cells, tolerance=TOLERANCE, greeks="none"))
    found = implied_volatility_many(cells, option_price=known, tolerance=TOLERANCE)
    if found["status"][0] == "invalid_input":
        raise RefusedError(found["message"][0])
    return known if found["status"][0] == "ok" else np.nan


def frame_of(kind: Callable[[Mapping[str, Any]], Any]) -> Callable[[Contract, Tools], float]:
    def price_frame(contract: Contract, _: Tools) -> float:
        found = price_many(
            kind({name: [value] for name, value in contract.items()}), tolerance=TOLERANCE, greeks="none"
        )
        return of_columns({name: [*found[name]] for name in ("price", "message")})

    return price_frame


def polars_frame(cells: Mapping[str, Any]) -> pl.DataFrame:
    """Return a frame with objects in columns that hold more than one type, of which polars would make one."""
    mixed = (list, dict, np.ndarray, np.datetime64)
    kinds = {name: pl.Object if isinstance(cell, mixed) else None for name, (cell,) in cells.items()}
    return pl.DataFrame([pl.Series(name, column, dtype=kinds[name]) for name, column in cells.items()])


def arrow(contract: Contract, _: Tools) -> float:
    found = price_table(table_of(contract), tolerance=TOLERANCE, greeks="none")
    return of_columns({name: found[name].to_pylist() for name in ("price", "message")})


def parquet(contract: Contract, tools: Tools) -> float:
    source, target = tools.folder / "in.parquet", tools.folder / "out.parquet"
    pq.write_table(table_of(contract), source)
    run_batch(source, target, tolerance=TOLERANCE, greeks="none")
    return of_columns(
        {"price": pq.read_table(target)["price"].to_pylist(), "message": rejected(tools.folder)}
    )


def csv_file(contract: Contract, tools: Tools) -> float:
    source, target = tools.folder / "in.csv", tools.folder / "out.csv"
    with source.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([contract.keys(), [cell_text(value) or "" for value in contract.values()]])
    run_batch(source, target, tolerance=TOLERANCE, greeks="none")
    with target.open(newline="", encoding="utf-8") as file:
        found = next(csv.DictReader(file))
    return of_columns({"price": [float(found["price"] or "nan")], "message": rejected(tools.folder)})


def json_object(contract: Contract, tools: Tools) -> float:
    return asked(tools, "/v1/price", {**as_json(contract), "tolerance": TOLERANCE})["price"]  # type: ignore[no-any-return]


def json_columns(contract: Contract, tools: Tools) -> float:
    body = {name: [value] for name, value in as_json(contract).items()}
    return of_columns(asked(tools, f"/v1/batch?tolerance={TOLERANCE}", body))


def client_object(contract: Contract, tools: Tools) -> float:
    option, market = contract_from(contract)
    return number(tools.client.price(option, market, tolerance=TOLERANCE).price)


def client_columns(contract: Contract, tools: Tools) -> float:
    cells = {name: cell(value) for name, value in contract.items()}
    return of_columns(tools.client.price_many(cells, tolerance=TOLERANCE))


def command(contract: Contract, _: Tools) -> float:
    words = ["price", "--json", "--greeks", "none", "--tolerance", str(TOLERANCE)]
    for name, value in contract.items():
        words += options(name, value)
    done = CliRunner().invoke(app, words)
    if done.exit_code:
        raise RefusedError(done.output)
    return number(json.loads(done.stdout)["price"])


DOORS: Mapping[str, Door] = {
    "arguments": Door("`Option(...)` and `Market(...)`", arguments),
    "mapping": Door("`contract_from({...})`", mapping, has_cells=True),
    "columns": Door("`price_many({...})`, a column or one value for each name", columns, has_cells=True),
    "volatilities": Door("`implied_volatility_many({...})`", volatilities, has_cells=True),
    "pandas": Door("`price_many(frame)` of pandas", frame_of(pd.DataFrame), has_cells=True),
    "polars": Door("`price_many(frame)` of polars", frame_of(polars_frame), has_cells=True),
    "Arrow": Door("`price_table(table)`", arrow, has_cells=True),
    "Parquet": Door("`pricing batch book.parquet ...`", parquet, has_cells=True),
    "CSV": Door("`pricing batch book.csv ...`", csv_file, has_cells=True),
    "JSON": Door("`POST /v1/price`", json_object),
    "JSON columns": Door("`POST /v1/batch`", json_columns, has_cells=True),
    "client": Door("`Client.price`", client_object),
    "client columns": Door("`Client.price_many({...})`", client_columns, has_cells=True),
    "command line": Door("`pricing price --option-type ...`", command),
}


def cell(value: Any) -> Any:
    """Return a value as a column of one row."""
    column = np.empty(1, dtype=object)
    column[0] = value
    return column


def table_of(contract: Contract) -> pa.Table:
    """Return a table of one row, with text for what Arrow has no type for."""
    return pa.table({name: arrow_cell(value) for name, value in contract.items()})


def arrow_cell(value: Any) -> pa.Array:
    if isinstance(value, np.datetime64):
        return pa.array(np.array([value]))
    if isinstance(value, Fraction):
        return pa.array([float(value)])
    if isinstance(value, list) and any(map(is_pair, value)):
        return pa.array([cell_text(value)])
    try:
        return pa.array([value.tolist() if isinstance(value, np.ndarray) else value])
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([cell_text(value)])


def as_json(contract: Contract) -> Any:
    """Return a contract as it is read from its JSON; the text of a list or a curve is that list or curve there."""
    text = json.dumps(contract, default=plain_json)
    return {name: json.loads(value) if is_json(value) else value for name, value in json.loads(text).items()}


def is_json(value: object) -> bool:
    return isinstance(value, str) and value.startswith(("[", "{"))


def options(name: str, value: Any) -> list[str]:
    """Return the options of the command line for one field."""
    flag = "--" + name.replace("_", "-")
    if name in ("cash_dividends", "proportional_dividends"):
        return [word for entry in entries(value) for word in (flag[:-1], ":".join(map(str, of_entry(entry))))]
    if name == "exercise_times":
        return [word for entry in entries(value) for word in (flag[:-1], cell_text(entry) or "")]
    text = cell_text(float(value) if isinstance(value, np.number) else value)
    return [f"{flag}={text}"]


def entries(value: Any) -> list[Any]:
    return [*(json.loads(value) if isinstance(value, str) else value)]


def of_entry(entry: Any) -> list[Any]:
    """Return a dividend's time and size."""
    plain = json.loads(json.dumps(entry, default=plain_json))
    if isinstance(plain, dict):
        when = plain.get("time", plain.get("ex_date"))
        return [when, plain.get("amount", plain.get("fraction"))]
    return [*plain]


def asked(tools: Tools, path: str, body: object) -> Any:
    status, _, answer = tools.server.request("POST", path, body)
    if status != 200:
        raise RefusedError(answer["detail"])
    return answer


def rejected(folder: Path) -> list[str]:
    """Return why the row of a batch has no price, and forget it."""
    told = [path.read_text(encoding="utf-8") for path in folder.glob("*rejects*")]
    for path in folder.iterdir():
        if path.is_file():
            path.unlink()
    return told or [""]


def of_columns(found: Mapping[str, Any]) -> float:
    """Return the price of the only row."""
    value = found["price"][0]
    if value is None or np.isnan(value):
        raise RefusedError(found["message"][0])
    return number(value)


def number(value: float | None) -> float:
    assert value is not None
    return float(value)
