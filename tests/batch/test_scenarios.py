import datetime as dt
import json
import math
from decimal import Decimal
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pricing_core.american import price_many
from pricing_core.batch import Scenario, explain_profit_and_loss, price_table, read_scenarios, value_scenarios
from pricing_core.batch.scenario import SHIFTS
from pricing_core.errors import InvalidInputError

TOLERANCE = 1e-4
BOOK = {
    "option_type": ["put"],
    "spot": [100.0],
    "strike": [100.0],
    "expiry": [1.0],
    "rate": [0.05],
    "volatility": [0.2],
}


def random_contract(rng: np.random.Generator) -> dict[str, Any]:
    """Return a contract of any kind, its lists and curves as Python has them."""
    scale = 10.0 ** rng.uniform(-3, 3)
    contract: dict[str, Any] = {
        "option_type": str(rng.choice(["put", "call"])),
        "spot": scale * rng.uniform(0.7, 1.3),
        "strike": scale,
        "expiry": float(10.0 ** rng.uniform(-2, 0.5)),
        "rate": rng.uniform(-0.02, 0.1),
        "volatility": rng.uniform(0.1, 0.6),
        "dividend_yield": rng.uniform(0.0, 0.08),
        "exercise": str(rng.choice(["american", "european", "bermudan"], p=[0.6, 0.2, 0.2])),
        "exercise_times": [],
        "cash_dividends": [],
        "proportional_dividends": [],
    }
    times = sorted(rng.uniform(0.0, 1.2, 3) * contract["expiry"])
    if rng.random() < 0.5:
        contract["cash_dividends"] = [
            {"time": t, "amount": scale * rng.uniform(0.001, 0.03)} for t in times[:2]
        ]
    if rng.random() < 0.2:
        contract["proportional_dividends"] = [{"time": times[2], "fraction": rng.uniform(0.0, 0.04)}]
    for name in ("rate", "volatility", "dividend_yield"):
        if rng.random() < 0.3:
            contract[name] = {"times": times, "values": [contract[name], *rng.uniform(0.1, 0.3, 2).tolist()]}
    if contract["exercise"] == "bermudan":
        contract["exercise_times"] = [t for t in times if t < contract["expiry"]] or [contract["expiry"]]
    return contract


def shifted(contract: dict[str, Any], scenario: dict[str, float]) -> dict[str, Any]:
    """Return a contract under a scenario."""
    years = scenario["days_forward"] / 365.0
    new = contract | {
        "spot": contract["spot"] * (1.0 + scenario["spot_shift"]),
        "expiry": max(contract["expiry"] - years, 0.0),
    }
    shifts = {
        "rate": scenario["rate_shift"],
        "volatility": scenario["volatility_shift"],
        "dividend_yield": 0.0,
    }
    for name, shift in shifts.items():
        curve = contract[name]
        if not isinstance(curve, dict):
            new[name] = curve + shift
            continue
        pieces = [(t - years, v + shift) for t, v in zip(curve["times"], curve["values"], strict=True)]
        left = [(t, v) for t, v in pieces if t > 0.0] or [(1.0, pieces[-1][1])]
        new[name] = {"times": [t for t, _ in left], "values": [v for _, v in left]}
    for name in ("cash_dividends", "proportional_dividends"):
        new[name] = [entry | {"time": entry["time"] - years} for entry in contract[name]]
        new[name] = [entry for entry in new[name] if entry["time"] > 0.0]
    new["exercise_times"] = [t - years for t in contract["exercise_times"] if t - years > 0.0]
    if contract["exercise"] == "bermudan" and not new["exercise_times"]:
        new["exercise"] = "european"
    return new


def as_columns(contracts: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    columns = {}
    for name in contracts[0]:
        columns[name] = np.empty(len(contracts), dtype=object)
        columns[name][:] = [contract[name] for contract in contracts]
    return columns


def as_table(contracts: list[dict[str, Any]], form: str) -> pa.Table:
    """Return the contracts with their lists and curves as Arrow's, or all of it as text."""
    columns: dict[str, Any] = {name: [contract[name] for contract in contracts] for name in contracts[0]}
    for name, cells in columns.items():
        mixed = any(isinstance(cell, dict) for cell in cells)
        if form == "text" and (mixed or isinstance(cells[0], list)):
            columns[name] = [cell if isinstance(cell, str) else json.dumps(cell) for cell in cells]
        elif mixed:  # structures have no place for a number
            columns[name] = [
                cell if isinstance(cell, dict) else {"times": [1.0], "values": [cell]} for cell in cells
            ]
    return pa.table(columns)


LISTS = {
    "spot_shifts": [-0.1, 0.0, 0.07],
    "volatility_shifts": [0.0, 0.03],
    "rate_shifts": [0.01],
    "days_forward": [0, 3.5, 60],
}


@pytest.mark.parametrize(("seed", "form"), [(1, "arrow"), (2, "text"), (3, "arrow")])
def test_a_scenario_is_worth_what_the_shifted_contract_is_bit_for_bit(seed: int, form: str) -> None:
    rng = np.random.default_rng(seed)
    contracts = [random_contract(rng) for _ in range(12)]
    table = as_table(contracts, form)
    if form == "arrow":  # structures: every cell is a curve
        contracts = [
            c
            | {
                name: c[name] if isinstance(c[name], dict) else {"times": [1.0], "values": [c[name]]}
                for name in ("rate", "volatility", "dividend_yield")
                if pa.types.is_struct(table.schema.field(name).type)
            }
            for c in contracts
        ]
    found = value_scenarios(table, **LISTS, tolerance=TOLERANCE, greeks="standard")
    assert found.num_rows == 12 * 18
    rows = found.to_pylist()
    scenarios = [{name: row[name] for name in SHIFTS} for row in rows[:18]]
    assert [tuple(s.values()) for s in scenarios][:4] == [
        (-0.1, 0.0, 0.01, 0.0),
        (-0.1, 0.0, 0.01, 3.5),
        (-0.1, 0.0, 0.01, 60.0),
        (-0.1, 0.03, 0.01, 0.0),
    ]
    wanted = price_many(
        as_columns([shifted(c, s) for c in contracts for s in scenarios]), tolerance=TOLERANCE
    )
    before = price_many(as_columns(contracts), tolerance=TOLERANCE)["price"]
    assert set(found["status"].to_pylist()) <= {"ok", "tolerance_not_met"}
    for name in ("price", "delta", "vega", "error_estimate"):
        numbers = np.array(found[name].to_pylist(), dtype=float)
        np.testing.assert_array_equal(numbers, wanted[name])
    profit = wanted["price"] - np.repeat(before, 18)
    np.testing.assert_array_equal(found["profit_and_loss"].to_numpy(), profit)
    for name in table.schema.names:  # the input passes through
        assert found[name].to_pylist()[::18] == table[name].to_pylist()


def test_a_ladder_from_one_solve_meets_the_tolerance() -> None:
    rng = np.random.default_rng(4)
    contracts = [
        random_contract(rng)
        | {"exercise": "american", "exercise_times": [], "volatility": rng.uniform(0.1, 0.8)}
        for _ in range(20)
    ]
    for contract in contracts[::2]:
        contract |= {"rate": 0.04, "dividend_yield": 0.01, "cash_dividends": [], "proportional_dividends": []}
    table = as_table(contracts, "text")
    ladder = np.linspace(-0.3, 0.3, 13)
    alone, together = (
        value_scenarios(table, spot_shifts=ladder, tolerance=1e-5, share_solves=share)
        for share in (False, True)
    )
    strikes = np.repeat([contract["strike"] for contract in contracts], 13)
    difference = np.abs(alone["price"].to_numpy() - together["price"].to_numpy()) / strikes
    allowed = (alone["error_estimate"].to_numpy() + together["error_estimate"].to_numpy()) / strikes
    assert (difference <= np.maximum(allowed, 2e-5)).all()
    assert set(together["status"].to_pylist()) <= {"ok", "tolerance_not_met"}


@pytest.mark.parametrize("seed", range(3))
def test_dates_move_as_times_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    days = rng.integers(5, 400, 4)
    start = np.datetime64("2026-03-02")
    dated: dict[str, Any] = {name: BOOK[name] * 4 for name in BOOK if name != "expiry"}
    timed = dict(dated)
    ex_days = rng.integers(1, 40, 4)
    dated |= {
        "valuation_date": pa.array(np.repeat(start, 4)),
        "expiration_date": pa.array(start + days),
        "cash_dividends": [[{"ex_date": str(start + d), "amount": 2.0}] for d in ex_days.tolist()],
        "exercise_start": [str(start + int(d) // 2) for d in days],
    }
    timed |= {
        "expiry": days / 365.0,
        "cash_dividends": [[{"time": d / 365.0, "amount": 2.0}] for d in ex_days.tolist()],
        "exercise_start": days // 2 / 365.0,
    }
    forward = [0, int(ex_days[0]), 30, 401]
    tables = [
        value_scenarios(pa.table(columns), days_forward=forward, tolerance=TOLERANCE)
        for columns in (dated, timed)
    ]
    first, second = (table["price"].to_numpy() for table in tables)
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=2 * TOLERANCE)
    assert tables[0]["valuation_date"].to_pylist()[0] == start.item()
    assert (first[3::4] == 0.0).all()  # expired at the money


def test_an_ex_date_that_passes_takes_the_dividend_and_leaves_the_spot() -> None:
    dividend = [[{"time": 10 / 365, "amount": 5.0}]]
    book = BOOK | {"option_type": ["call"], "cash_dividends": dividend, "expiry": [0.5]}
    found = value_scenarios(pa.table(book), days_forward=[9, 10], spot_shifts=[0.0, -0.05], tolerance=1e-6)
    cum, gone, _, gone_and_dropped = found["price"].to_pylist()
    without = price_many({**BOOK, "option_type": "call", "expiry": 0.5 - 10 / 365}, tolerance=1e-6)["price"][
        0
    ]
    dropped = price_many(
        {**BOOK, "spot": 95.0, "option_type": "call", "expiry": 0.5 - 10 / 365}, tolerance=1e-6
    )
    assert gone == without
    assert gone_and_dropped == dropped["price"][0]
    assert abs(cum - gone_and_dropped) < abs(cum - gone)


def test_expired_contracts_are_worth_what_exercise_brings() -> None:
    book = {name: cells * 3 for name, cells in BOOK.items()} | {
        "spot": [80.0, 120.0, 100.0],
        "expiry": [0.01, 4 / 365, 1.0],
        "exercise": ["bermudan", "european", "american"],
        "exercise_times": [[0.005], None, None],
    }
    found = value_scenarios(pa.table(book), days_forward=[4], spot_shifts=[-0.5])
    assert found["price"].to_pylist()[:2] == [60.0, 40.0]
    assert found["status"].to_pylist() == ["ok"] * 3


def test_group_sums_are_those_of_the_long_table() -> None:
    rng = np.random.default_rng(8)
    contracts = [random_contract(rng) for _ in range(30)]
    table = as_table(contracts, "text")
    desks = rng.choice(["rates", "equity", None], 30).tolist()
    quantities = [None if k == 3 else float(q) for k, q in enumerate(rng.integers(-50, 50, 30))]
    table = table.append_column("desk", pa.array(desks, pa.string())).append_column("quantity", [quantities])
    table = table.append_column("contract_multiplier", [[100] * 30])
    shifts: dict[str, Any] = {"spot_shifts": [0.0, 0.1], "rate_shifts": [0.0, 0.01], "tolerance": TOLERANCE}
    long = value_scenarios(table, **shifts, greeks="standard").to_pylist()
    groups = value_scenarios(table, **shifts, greeks="standard", group_by=["desk"]).to_pylist()
    assert sum(row["contracts"] for row in groups) == 4 * 30
    assert sum(row["contracts_left_out"] for row in groups) >= 4
    for group in groups:
        members = [
            row
            for row in long
            if row["desk"] == group["desk"] and all(row[shift] == group[shift] for shift in SHIFTS)
        ]
        assert len(members) == group["contracts"]
        kept = [
            row for row in members if row["quantity"] is not None and None not in (row["price"], row["delta"])
        ]
        assert len(members) - len(kept) == group["contracts_left_out"]
        for name in ("profit_and_loss", "delta", "vega", "theta"):
            amounts = [row["quantity"] * 100 * row[name] for row in kept]
            assert group[name] == pytest.approx(math.fsum(amounts), abs=1e-12 * sum(map(abs, amounts)))
        worth = [row["quantity"] * 100 * row["price"] for row in kept]
        assert group["value"] == pytest.approx(math.fsum(worth), abs=1e-12 * sum(map(abs, worth)))
        money = [
            row["quantity"] * 100 * row["gamma"] * (float(row["spot"]) * (1 + row["spot_shift"])) ** 2
            for row in kept
        ]
        assert group["gamma_money"] == pytest.approx(math.fsum(money), abs=1e-12 * sum(map(abs, money)))


def test_amounts_beyond_the_range_of_numbers_are_left_out_without_a_warning() -> None:
    rng = np.random.default_rng(9)
    table = as_table([random_contract(rng) for _ in range(3)], "text")
    table = table.append_column("quantity", [[1.0, 1e300, 1e308]])
    table = table.append_column("contract_multiplier", [[float("inf"), 1e300, 1.0]])
    table = table.append_column("desk", [["rates"] * 3])
    found = value_scenarios(
        table, spot_shifts=[0.0], tolerance=TOLERANCE, greeks="standard", group_by=["desk"]
    )
    (group,) = found.to_pylist()
    assert group["contracts_left_out"] >= 2


def test_a_matrix_holds_the_profits_of_the_long_table() -> None:
    rng = np.random.default_rng(9)
    table = as_table([random_contract(rng) for _ in range(5)], "text")
    shifts: dict[str, Any] = {"spot_shifts": [-0.1, 0.1], "days_forward": [0, 5], "tolerance": TOLERANCE}
    long = value_scenarios(table, **shifts)["profit_and_loss"].to_numpy().reshape(5, 4)
    matrix = value_scenarios(table, **shifts, matrix=True)
    labels = matrix.schema.names[table.num_columns + 1 : -2]
    assert labels == [
        "spot_shift=-0.1",
        "spot_shift=-0.1 days_forward=5",
        "spot_shift=0.1",
        "spot_shift=0.1 days_forward=5",
    ]
    np.testing.assert_array_equal(np.column_stack([matrix[label].to_numpy() for label in labels]), long)


def test_rows_and_shifts_that_cannot_be_priced_say_why() -> None:
    book = {name: cells * 4 for name, cells in BOOK.items()} | {
        "volatility": ["0.2", "0.04", "rubbish", '{"times": [1], "values": [0.02]}'],
        "spot": [100.0, 100.0, 100.0, None],
    }
    found = value_scenarios(pa.table(book), volatility_shifts=[-0.05, 0.0], tolerance=TOLERANCE).to_pylist()
    assert [row["status"] for row in found] == ["ok", "ok", "invalid_input", "ok", *["invalid_input"] * 4]
    assert found[2]["message"].startswith("volatility = -0.01")
    assert found[2]["message"].endswith("under the shifts of the scenario")
    assert found[4]["message"] == found[5]["message"]
    assert "rubbish" in found[4]["message"]
    assert "spot" in found[6]["message"]
    assert all(row["price"] is None and row["profit_and_loss"] is None for row in found[4:])


def test_a_table_without_rows_has_no_scenarios() -> None:
    table = pa.table(BOOK).slice(0, 0)
    for form in ({}, {"matrix": True}, {"group_by": ["option_type"]}):
        found = value_scenarios(table, spot_shifts=[0.1], **form)
        assert found.num_rows == 0
        assert found.num_columns > 5


@pytest.mark.parametrize(
    "arguments",
    [
        {"spot_shifts": []},
        {"spot_shifts": [math.nan]},
        {"spot_shifts": ["0.1"]},
        {"spot_shifts": 0.1},
        {"days_forward": [-1]},
        {"days_forward": [1e9]},
        {"rate_shifts": [True]},
        {"rate_shifts": [0.1, 0.1]},
        {"spot_shifts": np.zeros(101), "rate_shifts": np.zeros(101)},
        {"scenarios": []},
        {"scenarios": [Scenario(0.1)], "spot_shifts": [0.1]},
        {"scenarios": [Scenario(0.1, name="a"), Scenario(0.2, name="a")]},
        {"matrix": True, "group_by": ["option_type"]},
        {"scenarios": [Scenario(0.1, name="price")], "matrix": True},
        {"scenarios": [Scenario(0.1, name="spot")], "matrix": True},
        {"group_by": ["desk"]},
    ],
)
def test_what_is_no_set_of_scenarios_is_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError):
        value_scenarios(pa.table(BOOK), **arguments)


def test_an_input_column_may_not_be_named_as_a_result() -> None:
    with pytest.raises(InvalidInputError, match="rate_shift"):
        value_scenarios(pa.table(BOOK | {"rate_shift": [0.0]}), spot_shifts=[0.1])


def test_scenarios_are_read_from_csv_and_json(tmp_path: Any) -> None:
    wanted = (Scenario(-0.2, 0.1, name="crash"), Scenario(days_forward=1.0, name="overnight"), Scenario(0.1))
    rows = "name,spot_shift,volatility_shift,days_forward\ncrash,-0.2,0.1,\novernight,,,1\n,0.1,,\n"
    (tmp_path / "s.csv").write_text(rows)
    entries = [
        {"name": "crash", "spot_shift": -0.2, "volatility_shift": 0.1},
        {"name": "overnight", "days_forward": 1},
        {"spot_shift": 0.1},
    ]
    (tmp_path / "s.json").write_text(json.dumps(entries))
    assert read_scenarios(str(tmp_path / "s.csv")) == wanted
    assert read_scenarios(str(tmp_path / "s.json")) == wanted
    found = value_scenarios(pa.table(BOOK), scenarios=wanted, tolerance=TOLERANCE)
    assert found["scenario"].to_pylist() == ["crash", "overnight", "spot_shift=0.1"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("s.json", "{"),
        ("s.json", "{}"),
        ("s.json", "[1]"),
        ("s.json", '[{"spot": 1}]'),
        ("s.json", '[{"spot_shift": "x"}]'),
        ("s.json", '[{"spot_shift": null}]'),
        ("s.json", "[" * 100_000),
        ("s.csv", "spot_shift\nabc\n"),
        ("s.csv", "spot_shift\n0.1,0.2\n"),
        ("s.csv", 'spot_shift\n"0.1'),
        ("s.csv", ""),
        ("s.txt", "spot_shift\n0.1\n"),
        ("s.csv", "\udcff"),
    ],
)
def test_a_file_of_anything_else_is_refused(tmp_path: Any, name: str, text: str) -> None:
    (tmp_path / name).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InvalidInputError):
        read_scenarios(str(tmp_path / name))


def test_columns_of_every_type_that_a_table_may_have() -> None:
    moment = dt.datetime(2026, 1, 15, 12, tzinfo=dt.UTC)
    dividend = pa.struct([("ex_date", pa.date32()), ("time", pa.float64()), ("amount", pa.decimal128(8, 2))])
    plain: dict[str, Any] = {
        "option_type": pa.array(["put", "C"]).dictionary_encode(),
        "spot": pa.array([100.0, 90.0], pa.float32()),
        "strike": pa.array([Decimal("100.00"), Decimal("95.50")]),
        "rate": pa.array([0, 0], pa.int64()),
        "volatility": pa.array(["0.2", " 0.3 "], pa.large_string()).dictionary_encode(),
        "exercise": pa.array(["bermudan", None]).dictionary_encode(),
        "exercise_times": pa.array([[moment + dt.timedelta(days=5), moment + dt.timedelta(days=50)], None]),
        "exercise_start": pa.array([None, moment + dt.timedelta(days=2)], pa.timestamp("ns", "UTC")),
        "valuation_date": pa.array([moment] * 2, pa.timestamp("ns", "Europe/Berlin")),
        "expiration_date": pa.array([moment + dt.timedelta(days=100)] * 2, pa.timestamp("s", "UTC")),
        "proportional_dividends": pa.nulls(2),
    }
    due = [None, [{"ex_date": None, "time": 20 / 365, "amount": Decimal("1.50")}]]
    table = pa.table(plain | {"cash_dividends": pa.array(due, pa.list_(dividend))})
    found = value_scenarios(table, days_forward=[0, 10, 60, 200], spot_shifts=[0.1], tolerance=1e-5)
    assert found["status"].to_pylist() == ["ok"] * 8
    assert found.select(table.schema.names).slice(0, 1).equals(table.slice(0, 1))
    wanted: dict[str, Any] = {
        "option_type": ["put"] * 4 + ["call"] * 4,
        "spot": [110.00000000000001] * 4 + [99.00000000000001] * 4,
        "strike": [100.0] * 4 + [95.5] * 4,
        "expiry": [days / 365 for days in (100, 90, 40, 0)] * 2,
        "rate": 0.0,
        "volatility": [0.2] * 4 + [0.3] * 4,
        "exercise": ["bermudan", "bermudan", "european", "european"] + ["american"] * 4,
        "exercise_times": [[5 / 365, 50 / 365], [40 / 365], None, None] + [None] * 4,
        "exercise_start": [0.0] * 4 + [2 / 365, 0.0, 0.0, 0.0],
        "cash_dividends": [[]] * 4
        + [[{"time": 20 / 365, "amount": 1.5}], [{"time": 10 / 365, "amount": 1.5}], [], []],
    }
    prices = price_many(as_columns_of(wanted), tolerance=1e-5)["price"]
    np.testing.assert_allclose(found["price"].to_numpy(), prices, rtol=1e-9, atol=1e-8)


def as_columns_of(columns: dict[str, Any]) -> dict[str, Any]:
    """Return columns whose lists stay lists."""
    found = dict(columns)
    for name, cells in columns.items():
        if isinstance(cells, list):
            found[name] = np.empty(len(cells), dtype=object)
            found[name][:] = cells
    return found


ODD = {
    "option_type": ["put", "C", " P ", "x", None, ""],
    "exercise": ["american", "european", "bermudan", None, "AMERICAN", "zz"],
    "rate": [
        "0.05",
        '{"times": [0.01, 1], "values": [0.01, 0.02]}',
        '{"times": [], "values": []}',
        "{",
        None,
        "1e999",
    ],
    "volatility": [
        "0.2",
        '{"times": [0.01, 0.5], "values": [0.05, 0.2]}',
        None,
        " ",
        "-1",
        "[1]",
        '{"times": 1}',
    ],
    "dividend_yield": ["0.01", None, "", '{"times": [1e-300], "values": [0.01]}'],
    "cash_dividends": [
        *(
            "[]",
            None,
            '[{"time": 0.01, "amount": 1}]',
            '[{"ex_date": "2026-02-01", "amount": 1}]',
            "[1]",
            "{}",
        ),
        *('[{"time": "x", "amount": 1}]', '[{"time": null, "amount": 1}]', '[{"time": 1e-320, "amount": 1}]'),
    ],
    "proportional_dividends": [
        "[]",
        None,
        '[{"time": 0.01, "fraction": 0.5}]',
        '[{"time": 0.3, "fraction": 2}]',
    ],
    "exercise_times": [None, "[]", "[0.01, 0.5]", '["2026-02-01"]', "[-1]", "x"],
    "exercise_start": [None, "0", "0.01", "2026-02-01", "9", "2030-01-01"],
    "dividend_model": ["spot", "escrowed", None, "q"],
    "valuation_date": [None, "2026-01-15", "2026-01-15T12:00Z", "x"],
    "expiration_date": [None, "2027-01-15", "2026-01-25", "2026-01-15", "2027-01-15T00:00Z", "9999-12-31"],
}


@pytest.mark.parametrize("seed", range(6))
def test_odd_cells_cost_their_own_rows_alone_and_never_raise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns: dict[str, Any] = {"spot": [100.0, 0.0, math.nan, -1.0] + [90.0] * 16, "strike": [100.0] * 20}
    for name, cells in ODD.items():
        if name in BOOK or rng.random() < 0.5:
            columns[name] = [
                cells[0] if rng.random() < 0.7 else cells[rng.integers(len(cells))] for _ in range(20)
            ]
    dated = [bool(start or end) for start, end in zip(
        columns.get("valuation_date", [None] * 20), columns.get("expiration_date", [None] * 20), strict=True
    )]  # fmt: skip
    columns["expiry"] = pa.array([None if has_dates else 1.0 for has_dates in dated], pa.float64())
    columns |= {name: pa.array(columns[name], pa.string()) for name in ODD if name in columns}
    table = pa.table(columns | {"id": [str(row) for row in range(20)]})
    plain = price_table(table, tolerance=1e-3, greeks="none").to_pylist()
    found = value_scenarios(
        table, spot_shifts=[0.0, 0.1], volatility_shifts=[0.0, -0.1], days_forward=[0, 8, 300], tolerance=1e-3
    ).to_pylist()
    for row, wanted in enumerate(plain):
        scenarios = found[12 * row : 12 * row + 12]
        assert scenarios[0]["price"] == wanted["price"]
        if wanted["status"] == "invalid_input":
            assert {(row["status"], row["message"]) for row in scenarios} == {
                ("invalid_input", wanted["message"])
            }
        else:
            sound = [row for row in scenarios if row["volatility_shift"] == 0.0]
            assert all(row["price"] is not None and row["profit_and_loss"] is not None for row in sound)
    explained = explain_profit_and_loss(table, table, tolerance=1e-3).to_pylist()
    assert [row["residual"] for row in explained] == [None if row["price"] is None else 0.0 for row in plain]
