import itertools
import math
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pricing_core.american import price_many
from pricing_core.batch import explain_profit_and_loss
from pricing_core.batch.effects import EFFECTS
from pricing_core.errors import InvalidInputError

PARTS = (*EFFECTS, "residual")
PUT = {"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
YEAR_OF_DAYS = 365.0


def table(*contracts: dict[str, Any]) -> pa.Table:
    names = dict.fromkeys(itertools.chain.from_iterable(contracts))
    columns: dict[str, list[Any]] = {name: [contract.get(name) for contract in contracts] for name in names}
    return pa.table({"id": [f"c{k}" for k in range(len(contracts))]} | columns)


def explained(before: dict[str, Any], after: dict[str, Any], tolerance: float = 1e-8) -> dict[str, Any]:
    (row,) = explain_profit_and_loss(table(before), table(after), tolerance=tolerance).to_pylist()
    return row


def random_pair(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    scale = 10.0 ** rng.uniform(-6, 6)
    strike = scale * rng.uniform(0.7, 1.3)
    expiry = rng.uniform(0.02, 2.0)
    days = rng.integers(0, 10) / YEAR_OF_DAYS
    dividends = [{"time": float(t), "amount": 0.02 * scale} for t in np.sort(rng.uniform(0.0, expiry, 2))]
    curve = {"times": [0.1, 1.0], "values": rng.uniform(0.1, 0.4, 2).tolist()}
    before: dict[str, Any] = {
        "option_type": str(rng.choice(["put", "call"])),
        "exercise": str(rng.choice(["american", "european"])),
        "spot": scale,
        "strike": strike,
        "expiry": expiry,
        "rate": rng.uniform(-0.01, 0.1),
        "dividend_yield": rng.uniform(0.0, 0.05),
    }
    after = before | {
        "spot": scale * rng.uniform(0.9, 1.1),
        "expiry": max(expiry - days, 0.0),
        "rate": before["rate"] + rng.normal() * 0.002,
        "dividend_yield": before["dividend_yield"] + rng.normal() * 0.002,
    }
    kept = dividends if rng.random() < 0.5 else []
    before["cash_dividends"] = kept
    after["cash_dividends"] = [d | {"time": d["time"] - days} for d in kept if d["time"] > days]
    if kept and rng.random() < 0.3:
        after["cash_dividends"] = after["cash_dividends"][1:]
    before["volatility"] = curve
    after["volatility"] = {"times": [0.5], "values": [0.25]} if rng.random() < 0.5 else curve
    return before, after


@pytest.mark.parametrize("seed", range(3))
def test_the_parts_add_up_to_the_profit_exactly_in_any_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    befores, afters = zip(*(random_pair(rng) for _ in range(25)), strict=True)
    found = explain_profit_and_loss(table(*befores), table(*afters), tolerance=1e-4)
    prices = [
        price_many({name: [c[name] for c in side] for name in side[0]}, tolerance=1e-4)["price"]
        for side in (befores, afters)
    ]
    np.testing.assert_array_equal(found["price_before"].to_numpy(), prices[0])
    np.testing.assert_array_equal(found["price_after"].to_numpy(), prices[1])
    for row in found.to_pylist():
        assert row["status"] in ("ok", "tolerance_not_met")
        parts = [row[name] for name in PARTS]
        for _ in range(5):
            assert sum(rng.permutation(parts).tolist()) == row["profit_and_loss"]
        difference = row["price_after"] - row["price_before"]
        assert row["profit_and_loss"] == pytest.approx(
            difference, abs=1e-14 * max(map(abs, [*parts, difference]))
        )


@pytest.mark.parametrize("seed", range(4))
def test_the_residual_of_a_move_of_the_spot_is_of_third_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before = PUT | {
        "option_type": ["put", "call"][seed % 2],
        "volatility": rng.uniform(0.2, 0.4),
        "dividend_yield": rng.uniform(0.01, 0.04),
        "exercise": ["american", "european"][seed // 2],
        "strike": rng.uniform(95, 105),
    }
    moves = np.array([8.0, 4.0])
    residuals = [abs(explained(before, before | {"spot": 100.0 + move})["residual"]) for move in moves]
    gammas = [explained(before, before | {"spot": 100.0 + move})["gamma_effect"] for move in moves]
    assert residuals[0] < 0.25 * abs(gammas[0])
    # Halving the move divides the residual by eight, up to the next order.
    assert 5.5 < residuals[0] / residuals[1] < 11.0


@pytest.mark.parametrize(
    ("name", "change", "effect"),
    [
        ("volatility", 0.01, "vega_effect"),
        ("rate", 0.005, "rho_effect"),
        ("dividend_yield", 0.005, "dividend_effect"),
    ],
)
@pytest.mark.parametrize("as_curve", [False, True])
def test_the_residual_of_another_move_is_of_second_order(
    name: str, change: float, effect: str, as_curve: bool
) -> None:
    before = PUT | {"dividend_yield": 0.02, "strike": 103.0}
    if as_curve:
        before[name] = {"times": [0.3, 1.0], "values": [before[name], 1.1 * before[name]]}

    def moved(size: float) -> dict[str, Any]:
        if not as_curve:
            return before | {name: before[name] + size}
        values = [before[name]["values"][0], before[name]["values"][1] + size]
        return before | {name: {"times": [0.3, 1.0], "values": values}}

    rows = [explained(before, moved(size)) for size in (change, change / 2)]
    for row in rows:
        others = [part for part in EFFECTS if part != effect and row[part] != 0.0]
        assert others == []
        assert abs(row["residual"]) < 0.1 * abs(row[effect])
    assert 3.0 < rows[0]["residual"] / rows[1]["residual"] < 5.0


def test_a_flat_curve_is_a_number() -> None:
    before = PUT | {"expiry": 0.5}
    after = before | {"volatility": 0.23, "rate": 0.04, "expiry": 0.49}
    flat = explained(before, after)
    curves = {name: {"times": [0.1, 0.2], "values": [after[name]] * 2} for name in ("volatility", "rate")}
    curved = explained(before, after | curves)
    for name in PARTS:
        assert curved[name] == pytest.approx(flat[name], abs=1e-5)


def test_a_curve_that_only_ages_has_no_effect() -> None:
    curve = {"times": [0.1, 0.4], "values": [0.2, 0.3]}
    aged = {"times": [0.1 - 0.05, 0.4 - 0.05], "values": [0.2, 0.3]}
    row = explained(PUT | {"volatility": curve}, PUT | {"volatility": aged, "expiry": 0.95})
    assert row["vega_effect"] == pytest.approx(0.0, abs=1e-12)
    assert row["theta_effect"] < 0.0


@pytest.mark.parametrize("model", ["spot", "escrowed"])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_a_drop_that_was_expected_is_no_loss(model: str, option_type: str) -> None:
    before = PUT | {
        "option_type": option_type,
        "exercise": "european",
        "dividend_model": model,
        "cash_dividends": [{"time": 1 / YEAR_OF_DAYS, "amount": 3.0}, {"time": 0.5, "amount": 1.0}],
    }
    after = before | {
        "spot": 97.5,
        "expiry": 1.0 - 2 / YEAR_OF_DAYS,
        "cash_dividends": [{"time": 0.5 - 2 / YEAR_OF_DAYS, "amount": 1.0}],
    }
    row = explained(before, after)
    assert row["dividend_effect"] == 0.0
    assert math.copysign(1.0, row["delta_effect"]) == (1.0 if option_type == "call" else -1.0)  # up by 0.5
    assert abs(row["residual"]) < 2e-3


def test_a_fraction_that_has_passed_is_put_back() -> None:
    before = PUT | {"proportional_dividends": [{"time": 0.01, "fraction": 0.05}]}
    after = PUT | {"spot": 95.0, "expiry": 0.98, "proportional_dividends": []}
    assert explained(before, after)["delta_effect"] == pytest.approx(0.0, abs=1e-10)


def test_a_dividend_that_is_announced_or_changed_is_an_effect_of_its_own() -> None:
    before = PUT | {"cash_dividends": [{"time": 0.5, "amount": 1.0}]}
    after = PUT | {"cash_dividends": [{"time": 0.5, "amount": 1.5}, {"time": 0.8, "amount": 1.0}]}
    row = explained(before, after)
    assert row["dividend_effect"] == pytest.approx(row["profit_and_loss"], rel=1e-12)
    assert row["residual"] == pytest.approx(0.0, abs=1e-12)


def test_beyond_the_boundary_the_taylor_terms_end() -> None:
    held, exercised = PUT | {"spot": 82.0, "dividend_yield": 0.0}, PUT | {"spot": 78.0, "dividend_yield": 0.0}
    into, out = explained(held, exercised), explained(exercised, held)
    assert into["exercise_effect"] < 0.0 < out["exercise_effect"]  # gamma ends, and is regained
    for row in (into, out):
        assert row["residual"] == pytest.approx(0.0, abs=1e-10)
    assert explained(PUT, PUT | {"spot": 99.0})["exercise_effect"] == 0.0


@pytest.mark.parametrize("spot", [80.0, 100.0, 120.0])
def test_an_expired_contract_has_its_payoff_and_what_is_missing_is_of_exercise(spot: float) -> None:
    row = explained(PUT | {"expiry": 0.05}, PUT | {"expiry": 0.0, "spot": spot})
    assert row["price_after"] == max(100.0 - spot, 0.0)
    assert row["residual"] == pytest.approx(0.0, abs=1e-12)
    assert row["exercise_effect"] != 0.0


def test_dates_are_as_good_as_times() -> None:
    dated = {name: value for name, value in PUT.items() if name != "expiry"} | {
        "expiration_date": "2027-01-15"
    }
    dividend = {"cash_dividends": [{"ex_date": "2026-02-01", "amount": 2.0}]}
    row = explained(
        dated | dividend | {"valuation_date": "2026-01-15"},
        dated | dividend | {"valuation_date": "2026-02-04", "spot": 98.0},
    )
    days = 20 / YEAR_OF_DAYS
    timed = explained(
        PUT | {"cash_dividends": [{"time": 17 / YEAR_OF_DAYS, "amount": 2.0}]},
        PUT | {"expiry": 1.0 - days, "spot": 98.0, "cash_dividends": []},
    )
    for name in PARTS:
        assert row[name] == pytest.approx(timed[name], abs=1e-6)


def test_rows_that_do_not_match_are_listed_with_a_status() -> None:
    before = pa.table(
        {name: [value] * 8 for name, value in PUT.items()}
        | {"id": ["a", "b", "b", None, "d", "e", "f", "g"], "desk": list("01234567")}
    )
    changed = {
        "strike": [100.0, 100.0, 100.0, 100.0, 100.0, 110.0, 100.0, 100.0],
        "expiry": [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.5, 1.0],
        "spot": [100.0, 100.0, 100.0, 100.0, -1.0, 100.0, 100.0, 100.0],
        "id": ["z", "b", "b", " ", "d", "e", "f", "g"],
        "option_type": ["put"] * 7 + ["Call"],
    }
    after = pa.table(
        {name: [value] * 8 for name, value in PUT.items()} | changed | {"desk": list("abcdefgh")}
    )
    rows = explain_profit_and_loss(before, after, tolerance=1e-3).to_pylist()
    assert [(row["id"], row["desk"], row["status"]) for row in rows] == [
        ("a", "0", "only_before"),
        ("b", "1", "duplicate_key"),
        ("b", "2", "duplicate_key"),
        (None, "3", "missing_key"),
        ("d", "4", "invalid_input"),
        ("e", "5", "changed_contract"),
        ("f", "6", "changed_contract"),
        ("g", "7", "changed_contract"),
        ("z", "a", "only_after"),
        ("b", "b", "duplicate_key"),
        ("b", "c", "duplicate_key"),
        (" ", "d", "missing_key"),
    ]
    assert rows[4]["message"].startswith("after: spot = -1")
    assert rows[5]["message"] == "strike was 100 and is 110"
    assert "longer than before" in rows[6]["message"]
    assert rows[7]["message"] == "option_type was put and is call"
    assert all(row["profit_and_loss"] is None and row["residual"] is None for row in rows)
    assert rows[0]["price_before"] == rows[8]["price_after"] == rows[5]["price_before"]


def test_times_of_exercise_are_those_left_of_before() -> None:
    terms = {name: value for name, value in PUT.items() if name != "expiry"}
    two, changed = {"exercise": "bermudan", "exercise_times": [0.25, 0.5]}, "changed_contract"
    cases: list[tuple[dict[str, Any], dict[str, Any], str]] = [
        (two, {"exercise": "bermudan", "exercise_times": [0.25]}, "ok"),
        (two, {"exercise": "bermudan", "exercise_times": [0.5]}, changed),
        (two, two, changed),
        ({"exercise": "bermudan", "exercise_times": [0.125, 0.25]}, {"exercise": "european"}, "ok"),
        (two, {"exercise": "european"}, changed),
        ({"exercise": "bermudan", "exercise_times": [0.125]}, {"exercise": "american"}, changed),
        ({"exercise_start": 0.5}, {"exercise_start": 0.25}, "ok"),
        ({"exercise_start": 0.125}, {}, "ok"),
        ({"exercise_start": 0.5}, {}, changed),
        ({}, {"exercise_start": 0.5}, changed),
    ]
    rows: dict[str, list[dict[str, Any]]] = {"before": [], "after": []}
    for place, (old, new, _) in enumerate(cases):
        usual = {**terms, "id": place, "exercise": "american", "exercise_times": None, "exercise_start": None}
        rows["before"].append({**usual, "expiry": 1.0, **old})
        rows["after"].append({**usual, "expiry": 0.75, **new})
    before, after = (pa.Table.from_pylist(rows[side]) for side in ("before", "after"))
    found = explain_profit_and_loss(before, after, tolerance=1e-3)
    assert found["status"].to_pylist() == [status for _, _, status in cases]
    assert (
        found["message"][1].as_py()
        == "exercise_times or exercise_start are not those of before, 0.25 years later"
    )


def test_keys_of_several_columns_and_of_two_types() -> None:
    before = pa.table(
        {name: [value] * 2 for name, value in PUT.items()} | {"desk": ["x", "y"], "number": [1, 1]}
    )
    after = pa.table(
        {name: [value] * 2 for name, value in PUT.items()} | {"desk": ["y", "x"], "number": ["1", " 1"]}
    )
    found = explain_profit_and_loss(before, after, key=["desk", "number"], tolerance=1e-3)
    assert found["status"].to_pylist() == ["ok", "ok"]
    assert found["number"].to_pylist() == ["1", "1"]


def test_a_key_that_is_no_number_is_missing() -> None:
    book = pa.table({name: [value] * 2 for name, value in PUT.items()} | {"number": [2.0, float("nan")]})
    found = explain_profit_and_loss(book, book, key="number", tolerance=1e-3)
    assert found["status"].to_pylist() == ["ok", "missing_key", "missing_key"]


@pytest.mark.parametrize("key", ["account", [], ["id", "account"], "list"])
def test_what_is_no_key_is_refused(key: Any) -> None:
    book = table(PUT).append_column("list", [[[1.0]]])
    with pytest.raises(InvalidInputError, match="key"):
        explain_profit_and_loss(book, book, key=key)


def test_a_book_without_rows_has_nothing_to_explain() -> None:
    book = table(PUT)
    empty = book.slice(0, 0)
    assert explain_profit_and_loss(empty, empty).num_rows == 0
    assert explain_profit_and_loss(empty, book, tolerance=1e-3)["status"].to_pylist() == ["only_after"]
    assert explain_profit_and_loss(book, empty, tolerance=1e-3)["status"].to_pylist() == ["only_before"]
