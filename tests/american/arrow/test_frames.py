import math
import time
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

from pricing_core.american import price_many
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.batch import price_table
from pricing_core.errors import InvalidInputError, UnusualColumnWarning

BOOK = {
    "desk": ["a", "b", "a", "c"],
    "option_type": ["put", "C", "P", "call"],
    "spot": [90.0, 100.0, -1.0, 110.0],
    "strike": [100.0] * 4,
    "expiry": [1.0, 0.5, 1.0, 2.0],
    "rate": [0.05] * 4,
    "dividend_yield": [None, 0.03, 0.0, 0.08],
    "volatility": [0.2, 0.3, 0.2, 0.25],
    "cash_dividends": [[{"time": 0.5, "amount": 1.0}], [], None, []],
}
ARRAYS = BOOK | {
    "option_type": ["put", "call", "put", "call"],
    "dividend_yield": [0.0, 0.03, 0.0, 0.08],
    "cash_dividends": [[{"time": 0.5, "amount": 1.0}], [], [], []],
}
WANTED = price_many({name: ARRAYS[name] for name in ARRAYS if name != "desk"}, tolerance=1e-4)


def assert_priced(found: pa.Table) -> None:
    fields = price_fields("standard", BOOK)
    assert found.schema.names == [*BOOK, *(field.name for field in fields), "message"]
    for field in fields:
        cells = found[field.name].to_pylist()
        for row, cell in enumerate(cells):
            wanted = WANTED[field.name][row]
            if field.kind == "number":
                assert cell == (None if math.isnan(wanted) else wanted)
            elif field.kind == "list":
                assert cell == ([*wanted] or None)
            elif row != 2:
                assert cell == wanted
    assert found["status"].to_pylist() == ["ok", "ok", "invalid_input", "ok"]
    assert found["message"].to_pylist() == [None, None, "spot = -1.0: must be a number from 0 to 1e+30", None]
    assert found["exercise_now"].to_pylist()[2] is None


def test_an_arrow_table_comes_back_with_the_numbers_of_price_many_and_its_own_columns() -> None:
    table = pa.table(BOOK)
    found = price_table(table, tolerance=1e-4)
    assert found.select(table.schema.names).equals(table)
    assert_priced(found)
    assert_priced(price_many(pa.concat_tables([table.slice(0, 1), table.slice(1)]), tolerance=1e-4))


def test_a_frame_of_pandas_keeps_its_index_and_its_other_columns() -> None:
    frame = pd.DataFrame(BOOK, index=pd.Index([7, 3, 9, 3], name="trade"))
    frame["anything"] = [object(), 1, "x", None]
    found = price_many(frame, tolerance=1e-4)
    assert found.index.equals(frame.index)
    pd.testing.assert_frame_equal(found[list(frame.columns)], frame)
    np.testing.assert_array_equal(found["price"], WANTED["price"])
    np.testing.assert_array_equal(found["delta"], WANTED["delta"])
    assert found["status"].tolist() == WANTED["status"].tolist()
    assert "price" not in frame.columns


def test_a_frame_of_polars_comes_back_as_one() -> None:
    frame = pl.DataFrame(BOOK)
    found = price_many(frame, tolerance=1e-4)
    assert isinstance(found, pl.DataFrame)
    assert found.select(frame.columns).equals(frame)
    assert_priced(found.to_arrow())


@pytest.mark.parametrize("make", [pa.table, pd.DataFrame, pl.DataFrame])
def test_a_table_that_cannot_be_read_is_refused_in_one_sentence(make: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"there is no column 'Spot': did you mean spot\?"):
        price_table(make({("Spot" if name == "spot" else name): cells for name, cells in BOOK.items()}))
    with pytest.raises(InvalidInputError, match=r"column message has the name of a result"):
        price_table(make(BOOK | {"message": [""] * 4}))
    with pytest.raises(InvalidInputError, match=r"column spot = .*numbers"):
        price_table(make(BOOK | {"spot": ["90"] * 4}))
    with pytest.raises(InvalidInputError, match=r"^volatility \(.*\) is missing"):
        price_table(make({name: cells for name, cells in BOOK.items() if name != "volatility"}))


def test_a_column_of_pandas_with_values_of_several_types_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"column spot = .*several types"):
        price_table(pd.DataFrame(BOOK | {"spot": [90.0, "x", [1], 2.0]}))


@pytest.mark.parametrize("make", [pa.table, pd.DataFrame, pl.DataFrame])
def test_an_empty_table_comes_back_with_the_columns_of_its_results(make: Any) -> None:
    table = pa.table(BOOK).slice(0, 0)
    frame = table if make is pa.table else table.to_pandas() if make is pd.DataFrame else pl.DataFrame(table)
    found = price_many(frame, tolerance=1e-4)
    assert len(found) == 0
    names = list(found.schema.names if make is pa.table else found.columns)
    assert names == [*BOOK, *(field.name for field in price_fields("standard", BOOK)), "message"]


@pytest.mark.parametrize(
    ("column", "cells", "words"),
    [
        ("expiry", [30.0, 60.0, 90.0, 1.0], "column expiry looks like days: its median is 45"),
        ("rate", [5.0, 4.0, 0.05, 5.0], "column rate looks like percent: its median is 4.5"),
        ("dividend_yield", [1.5, 2.0, 2.5, None], "column dividend_yield looks like percent"),
        ("volatility", [20.0, 25.0, 0.2, 30.0], "column volatility looks like percent"),
        ("strike", [10_000.0] * 4, "column strike looks like cents"),
    ],
)
def test_what_looks_like_days_percent_or_cents_is_warned_about(
    column: str, cells: list[float], words: str
) -> None:
    with pytest.warns(UnusualColumnWarning, match=words):
        price_table(pa.table(BOOK | {column: cells}), tolerance=1e-2, greeks="none")


def slow_contract() -> dict[str, Any]:
    """Return a contract that takes the march of obstacle problems a good while."""
    return {"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 30.0, "rate": -0.01,
            "dividend_yield": -0.02, "volatility": 0.1}  # fmt: skip


def test_a_row_that_takes_longer_than_its_deadline_says_so_and_the_others_are_priced() -> None:
    count = 300
    hard = np.arange(count) == 150
    rng = np.random.default_rng(1)
    slow = slow_contract()
    book = {
        "option_type": "put",
        "spot": np.where(hard, slow["spot"], rng.uniform(80, 120, count)),
        "strike": 100.0,
        "expiry": np.where(hard, slow["expiry"], rng.uniform(0.1, 2.0, count)),
        "rate": np.where(hard, slow["rate"], 0.05),
        "dividend_yield": np.where(hard, slow["dividend_yield"], 0.0),
        "volatility": np.where(hard, slow["volatility"], 0.3),
        "tolerance": np.where(hard, 1e-8, 1e-5),
    }
    everything = price_many(book, greeks="none")
    started = time.monotonic()
    found = price_many(book, greeks="none", deadline=np.where(hard, 0.0, 60.0))
    assert found["status"].tolist() == ["deadline" if k else "ok" for k in hard]
    np.testing.assert_array_equal(found["price"][~hard], everything["price"][~hard])
    assert time.monotonic() - started < 60.0
    generous = price_many(book, greeks="none", deadline=1e6)
    np.testing.assert_array_equal(generous["price"], everything["price"])


@pytest.mark.parametrize("deadline", [-1.0, math.nan, "soon", [1.0, 2.0]])
def test_a_deadline_that_is_none_is_refused(deadline: Any) -> None:
    with pytest.raises(InvalidInputError, match="deadline"):
        price_many({**{name: ARRAYS[name] for name in ARRAYS if name != "desk"}}, deadline=deadline)
