import datetime as dt
import gzip
import json
import math
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pricing_core.chains import read_chain, vendor_maps
from pricing_core.errors import InvalidInputError

SAMPLES = Path(__file__).parents[1] / "data" / "chains"
MADE = runpy.run_path(str(SAMPLES / "make_samples.py"))
QUOTES = MADE["quotes"]()
VENDORS = sorted(vendor_maps())
LACK_SPOT = {"optionmetrics", "tradier", "yfinance"}
LACK_DATE = {"polygon", "tradier", "yfinance", "ibkr"}
LACK_VOLUME = {"thetadata", "ibkr", "optionsdx"}  # or the open interest


def sample(vendor: str) -> Path:
    return next(SAMPLES.glob(f"{vendor}.*"))


def read(vendor: str, **options: object) -> pa.Table:
    given = {}
    if vendor in LACK_SPOT:
        given["underlying_price"] = 100.0
    if vendor in LACK_DATE:
        given["quote_date"] = "2026-03-02"
    return read_chain(sample(vendor), **given, **options)


def simple(**changes: object) -> dict:
    columns = {
        "symbol": ["XYZ"] * 4,
        "underlying_price": [100.0] * 4,
        "date": ["2026-03-02"] * 4,
        "expiration": ["2026-06-19"] * 4,
        "type": ["C", "P", "call", "PUT"],
        "strike": [95.0, 95.0, 105.0, 105.0],
        "bid": [8.0, 2.5, 2.6, 7.1],
        "ask": [8.2, 2.6, 2.7, 7.3],
    }
    return columns | changes


@pytest.mark.parametrize("vendor", VENDORS)
@pytest.mark.parametrize("forced", [False, True])
def test_every_vendor_reads_to_the_same_quotes(vendor, forced):
    table = read(vendor, format=vendor if forced else "auto")
    assert table["message"].null_count == table.num_rows == len(QUOTES)
    for name in ("strike", "bid", "ask", "option_type", "expiration"):
        assert table[name].to_pylist() == [row[name] for row in QUOTES], name
    if vendor not in LACK_VOLUME:
        assert table["volume"].to_pylist() == [row["volume"] for row in QUOTES]
        assert table["open_interest"].to_pylist() == [row["open_interest"] for row in QUOTES]
    assert set(table["underlying_price"].to_pylist()) == {100.0}
    days = {day.date() if isinstance(day, dt.datetime) else day for day in table["quote_date"].to_pylist()}
    assert days == {dt.date(2026, 3, 2)}
    known = "100001" if vendor == "optionmetrics" else "XYZ" if vendor != "optionsdx" else None
    assert set(table["underlying_symbol"].to_pylist()) == {known}


@pytest.mark.parametrize("vendor", [name for name in VENDORS if name != "generic"])
def test_every_vendor_is_told_from_all_others(vendor):
    raw = read_chain.__globals__["raw_table"](sample(vendor))
    assert [name for name, map_ in vendor_maps().items() if map_.matches(raw.columns)] == [vendor]


def test_the_samples_are_what_their_script_writes(tmp_path, monkeypatch):
    monkeypatch.setitem(MADE["main"].__globals__, "HERE", tmp_path)
    MADE["main"]()
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert written == {name: (SAMPLES / name).read_bytes() for name in written}


@pytest.mark.parametrize("vendor", sorted(LACK_SPOT | LACK_DATE))
def test_a_file_that_lacks_the_spot_or_the_date_says_what_to_give(vendor):
    with pytest.raises(InvalidInputError, match="may be given beside the file"):
        read_chain(sample(vendor))


def test_other_columns_pass_through_and_names_are_understood_in_any_case():
    table = read("generic")
    assert table["desk"].to_pylist() == ["A"] * len(QUOTES)


def test_forms_of_files_and_frames_agree(tmp_path):
    text = (SAMPLES / "generic.csv").read_text()
    expected = read("generic")
    (tmp_path / "semicolons.csv").write_text("\ufeff" + text.replace(",", ";"))
    (tmp_path / "packed.csv.gz").write_bytes(gzip.compress(text.encode()))
    frame = pd.read_csv(SAMPLES / "generic.csv")
    pq.write_table(pa.Table.from_pandas(frame), tmp_path / "quotes.parquet")
    (tmp_path / "columns.json").write_text(json.dumps(frame.to_dict("list")))
    (tmp_path / "records.json").write_text(frame.to_json(orient="records"))
    sources = [
        *tmp_path.iterdir(),
        frame,
        pl.from_pandas(frame),
        frame.to_dict("list"),
        frame.to_dict("records"),
    ]
    for source in sources:
        assert read_chain(source).equals(expected), source


def test_dates_and_times_of_frames_are_read():
    moments = pd.to_datetime(["2026-03-02 15:45"] * 4)
    frame = pd.DataFrame(simple(date=moments, expiration=pd.to_datetime(["2026-06-19"] * 4)))
    table = read_chain(frame)
    assert table["quote_date"].to_pylist() == [dt.datetime(2026, 3, 2, 15, 45)] * 4
    assert table["expiration"].to_pylist() == [dt.date(2026, 6, 19)] * 4


@pytest.mark.parametrize(
    ("column", "cell", "told"),
    [
        ("strike", "95,0", "commas"),
        ("strike", "ninety", "a number"),
        ("bid", "1e999", "finite"),
        ("type", "straddle", '"call" or "put"'),
        ("expiration", "19/06/2026", "a date"),
        ("expiration", "2026-13-01", "a date"),
        ("expiration", "", "expiration is missing"),
        ("date", "2026-03-02T16:00:00Z", "without a UTC offset"),
    ],
)
def test_a_row_that_cannot_be_read_says_why_and_costs_itself_alone(column, cell, told):
    columns = simple()
    columns[column] = [cell, *map(str, columns[column][1:])]
    table = read_chain(columns)
    assert told in table["message"][0].as_py()
    assert table["message"].to_pylist()[1:] == [None] * 3
    assert table["strike"].to_pylist()[1:] == [95.0, 105.0, 105.0]


def test_a_ragged_line_is_a_row_that_cannot_be_read(tmp_path):
    path = tmp_path / "ragged.csv"
    lines = (SAMPLES / "generic.csv").read_text().splitlines()
    path.write_text("\n".join([*lines[:3], lines[3] + ",1", *lines[4:]]) + "\n")
    table = read_chain(path)
    assert table.num_rows == len(QUOTES)
    assert table["message"].to_pylist()[2] == "12 cells, where the header has 11"


def test_a_symbol_that_says_another_side_is_refused():
    symbols = ["XYZ260619C00095000", "XYZ260619C00095000", "XYZ260619C00105000", "XYZ260619P00105000"]
    table = read_chain(simple(contract_symbol=symbols))
    assert [message is None for message in table["message"].to_pylist()] == [True, False, True, True]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"strike": [95000.0, 95000.0, 105000.0, 105000.0]}, "column strike, row 1"),
        ({"underlying_price": [10000.0] * 4}, "column strike, row 1"),
        ({"bid": [800.0, 250.0, 260.0, 710.0], "ask": [820.0, 260.0, 270.0, 730.0]}, "column bid, row 1"),
        ({"bid": [8.2, 2.6, 2.7, 7.3], "ask": [8.0, 2.5, 2.6, 7.1]}, "column bid, row 1"),
    ],
)
def test_a_column_in_another_unit_is_refused_with_its_row(changes, field):
    with pytest.raises(InvalidInputError) as caught:
        read_chain(simple(**changes))
    assert caught.value.field == field


def test_exchanged_sides_are_refused():
    strikes = np.array([60.0, 70.0, 80.0, 120.0, 130.0, 140.0])
    sides = ["call"] * 3 + ["put"] * 3
    mids = np.abs(strikes - 100.0) + 0.5
    columns = {
        **{
            name: [values[0]] * 6
            for name, values in simple().items()
            if name not in ("type", "strike", "bid", "ask")
        },
        "strike": strikes,
        "bid": mids - 0.1,
        "ask": mids + 0.1,
    }
    assert read_chain({**columns, "type": sides})["message"].null_count == 6
    small = np.full(6, 0.4)
    with pytest.raises(InvalidInputError, match="below half of what exercise brings"):
        read_chain({**columns, "type": sides, "bid": small, "ask": small + 0.1})


@pytest.mark.parametrize(
    ("source", "field"),
    [
        ({"strike": [1.0], "bid": [1.0]}, "underlying_price, quote_date, expiration, option_type, ask"),
        ({"a": [1.0], "b": [1.0, 2.0]}, "quotes"),
        ([1, 2], "quotes"),
        (3, "quotes"),
        ("quotes.xlsx", "quotes"),
    ],
)
def test_what_is_no_table_of_quotes_is_refused(source, field, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("quotes.xlsx").write_bytes(b"")
    with pytest.raises(InvalidInputError) as caught:
        read_chain(source)
    assert caught.value.field == field


def test_an_unknown_format_is_refused_and_a_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(InvalidInputError, match="one of"):
        read_chain(simple(), format="bloomberg")
    with pytest.raises(OSError, match="absent"):
        read_chain(tmp_path / "absent.csv")


def test_numbers_that_are_missing_are_null():
    table = read_chain(simple(bid=[8.0, None, math.nan, 7.1]))
    assert table["bid"].to_pylist() == [8.0, None, None, 7.1]
    assert table["message"].null_count == 4
