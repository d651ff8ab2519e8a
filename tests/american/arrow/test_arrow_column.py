import datetime as dt
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pricing_core.american import contract_from
from pricing_core.american.arrow.arrow_column import ArrowColumn
from pricing_core.american.arrow.price_batch import contract_columns
from pricing_core.american.book.reading import ReadBook, read_book, read_columns
from pricing_core.american.book.segments import Segments
from pricing_core.american.contracts.fields import COLUMN_FIELDS, input_field
from pricing_core.american.pricing_settings import PricingSettings

NUMBERS = {"spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
TEXTS = {"option_type": "put", **{name: str(number) for name, number in NUMBERS.items()}}
CURVE = {"times": [0.5, 1.0], "values": [0.1, 0.2]}


def read(batch: pa.RecordBatch, tolerance: float = 1e-6) -> ReadBook:
    return read_columns(contract_columns(batch, PricingSettings(tolerance)), batch.num_rows)


def read_row(**cells: object) -> ReadBook:
    """Return what is read of one row whose cells are texts unless they are given."""
    return read(pa.RecordBatch.from_pylist([TEXTS | cells]))


def assert_same(found: ReadBook, wanted: ReadBook) -> None:
    """Compare row by row, as parts of a table may be read in another order."""
    order, other = np.argsort(found.rows), np.argsort(wanted.rows)
    np.testing.assert_array_equal(found.rows[order], wanted.rows[other])
    np.testing.assert_array_equal(found.tolerance[order], wanted.tolerance[other])
    mine, its = found.book.take(order), wanted.book.take(other)
    for name in ("is_put", "strike", "spot", "escrowed", "first"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(its, name))
    for name in Segments.__slots__:
        np.testing.assert_array_equal(getattr(mine.segments, name), getattr(its.segments, name))
    assert found.faults.keys() == wanted.faults.keys()


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        ({"exercise": "", "dividend_yield": None, "tolerance": " "}, {}),
        ({"exercise": "European", "dividend_yield": "0.02"}, {"exercise": "european", "dividend_yield": 0.02}),
        ({"tolerance": "1e-4"}, {"tolerance": 1e-4}),
        ({"option_type": " C\t"}, {"option_type": "call"}),
        ({"option_type": "PUT"}, {}),
        ({"rate": " 0.05 "}, {}),
        ({"rate": ' {"times": [1], "values": [0.05]} '}, {}),
        ({"volatility": CURVE}, {"volatility": CURVE}),
        ({"exercise": "bermudan", "exercise_times": " [0.5] "}, {"exercise": "bermudan", "exercise_times": [0.5]}),
        ({"exercise_start": "0.5"}, {"exercise_start": 0.5}),
        ({"exercise_start": math.nan, "dividend_yield": math.nan}, {}),
        ({"cash_dividends": []}, {}),
        ({"cash_dividends": "  "}, {}),
        ({"cash_dividends": [{"time": 0.5, "amount": 1.0}]}, {"cash_dividends": [{"time": 0.5, "amount": 1.0}]}),
        ({"cash_dividends": '[{"time": 0.5, "amount": 1.0}]'}, {"cash_dividends": [{"time": 0.5, "amount": 1.0}]}),
        ({"dividend_model": " spot "}, {}),
        ({"expiry": "", "valuation_date": " 2026-01-01 ", "expiration_date": dt.date(2027, 1, 1)}, {}),
        ({"expiry": None, "valuation_date": dt.datetime(2026, 1, 1), "expiration_date": "2027-01-01"}, {}),
    ],
    ids=repr,
)  # fmt: skip
def test_a_cell_means_what_it_means_to_price_many(cells: dict[str, object], expected: dict[str, Any]) -> None:
    row = {"option_type": "put"} | NUMBERS | expected
    wanted = read_book({name: [cell] for name, cell in row.items()}, 1e-6)
    assert wanted.faults == {}
    assert_same(read_row(**cells), wanted)


@pytest.mark.parametrize(
    ("cells", "field", "value", "allowed"),
    [
        *(({name: ""}, name, "", "given ") for name in ("option_type", *NUMBERS)),
        ({"spot": math.nan}, "spot", "", "given (money)"),
        *(({"tolerance": text}, "tolerance", float(text), "a number from 1e-08 to") for text in ("0", "1e-9", "0.1")),
        *(
            ({name: text}, name, text, "a number such as 0.05 or 5e-2")
            for name in ("rate", "exercise_start", "strike")
            for text in ("1_0", "[0.5]", "x", "nan", "inf", "0x10", "１", "1,5", "TRUE")
        ),
        ({"spot": "1e999"}, "spot", "1e999", "a finite number"),
        ({"strike": "-5"}, "strike", -5.0, "a number from 1e-30 to 1e+30"),
        ({"option_type": "Straddle"}, "option_type", "Straddle", '"put" or "call"'),
        ({"exercise": "x" * 99}, "exercise", "x" * 99, '"american", "european" or "bermudan"'),
        ({"expiry": "", "valuation_date": "", "expiration_date": ""}, "expiry", "missing", "given"),
        ({"rate": '{"times": [1]}'}, "rate", None, ""),
        ({"cash_dividends": [{"time": 0.5, "amount": None}]}, "cash_dividends[0].amount", None, ""),
    ],
    ids=repr,
)  # fmt: skip
def test_a_bad_cell_is_a_fault_of_its_field(
    cells: dict[str, object], field: str, value: object, allowed: str
) -> None:
    fault = read_row(**cells).faults[0]
    assert fault.field == field
    assert fault.allowed.startswith(allowed)
    if value is not None:
        assert fault.value == value


def random_cells(name: str, count: int, rng: np.random.Generator) -> list[object]:
    """Return cells as files have them, now and then an odd one."""
    usual: Mapping[str, Any] = {
        "option_type": ("put", "call", "P", "c"),
        "exercise": ("american", "european", "American", None),
        "dividend_model": ("spot", None, "escrowed"),
    }
    odd = ("", None, "x", "-1", "1e400", " 0.3", "nan", "{", "[]")
    cells: list[object] = []
    for _ in range(count):
        if name in usual:
            cells.append(str(rng.choice([x or "" for x in usual[name]])))
        elif name == "cash_dividends":
            times = np.sort(rng.uniform(-0.1, 1.5, rng.integers(0, 4))).tolist()
            cells.append(json.dumps([{"time": time, "amount": float(rng.uniform(0, 5))} for time in times]))
        else:
            cells.append(repr(float(NUMBERS.get(name, 0.01) * rng.uniform(0.5, 1.5))))
        if rng.random() < 0.05:
            cells[-1] = odd[rng.integers(len(odd))]
    return cells


@pytest.mark.parametrize("seed", range(6))
def test_every_row_is_read_as_by_itself(seed: int) -> None:
    rng, count = np.random.default_rng(seed), 200
    names = ["option_type", *NUMBERS, "exercise", "dividend_yield", "cash_dividends", "dividend_model"]
    batch = pa.RecordBatch.from_pydict(
        {name: pa.array(random_cells(name, count, rng), pa.string()) for name in names}
    )
    found = read(batch)
    columns = contract_columns(batch, PricingSettings())
    contracts = {row: place for place, row in enumerate(found.rows.tolist())}
    assert sorted([*contracts, *found.faults]) == list(range(count))
    assert len(contracts) > count / 2
    for row in range(count):
        alone = read(batch.slice(row, 1))
        assert [str(fault) for fault in alone.faults.values()] == [
            str(fault) for at, fault in found.faults.items() if at == row
        ]
        if row in contracts:
            option, market = contract_from(
                {name: column.cell(row) for name, column in columns.items() if name != "tolerance"}
            )
            at = contracts[row]
            book = found.book
            assert (bool(book.is_put[at]), book.strike[at], book.spot[at]) == (
                option.is_put,
                option.strike,
                market.spot,
            )
            assert book.segments.end[book.first[at + 1] - 1] == option.expiry
            due = [
                d.amount for d in market.cash_dividends if 0.0 < d.time <= option.expiry and d.amount > 1e-5
            ]
            paid = book.segments.due[book.first[at] : book.first[at + 1]]
            assert math.fsum(paid) == pytest.approx(math.fsum(due), rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_lists_of_structures_are_their_json_text(seed: int) -> None:
    rng, count = np.random.default_rng(seed), 100
    lists = []
    for _ in range(count):
        entries = [
            {"time": float(rng.uniform(0, 1.2)), "amount": float(rng.choice([0.0, 1.0, 2.5, -1.0, 1.0, 2.5]))}
            for _ in range(rng.integers(0, 5))
        ]
        lists.append(sorted(entries, key=lambda entry: entry["time"]))
    base = {name: [number] * count for name, number in NUMBERS.items()} | {"option_type": ["put"] * count}
    texts = read(pa.RecordBatch.from_pydict(base | {"cash_dividends": [json.dumps(x) for x in lists]}))
    entry = pa.struct([("time", pa.float64()), ("ex_date", pa.date32()), ("amount", pa.float32())])
    kinds = [pa.list_(entry), pa.large_list(entry)]
    for kind in kinds:
        array = pa.array(lists, kind)
        assert_same(read(pa.RecordBatch.from_pydict(base | {"cash_dividends": array})), texts)
    cut = pa.array([[], *lists], kinds[0])[1:]  # an array that does not begin at the start of its buffers
    assert_same(read(pa.RecordBatch.from_pydict(base | {"cash_dividends": cut})), texts)


def test_the_types_of_numbers_do_not_matter() -> None:
    spots = [90, 100, None, 110]
    arrays = [pa.array(spots, kind) for kind in (pa.int32(), pa.float32(), pa.decimal128(9, 2), pa.float64())]
    arrays += [
        pa.array([None if x is None else str(x) for x in spots], kind)
        for kind in (pa.string(), pa.large_string())
    ]
    arrays.append(arrays[-2].dictionary_encode())
    for array in arrays:
        column = ArrowColumn(input_field("spot"), array, None, False)
        np.testing.assert_array_equal(column.numbers(), [90.0, 100.0, math.nan, 110.0])


def test_nanoseconds_of_a_timestamp_are_dropped() -> None:
    moment = pa.array([1_767_225_600_000_000_001], pa.timestamp("ns", "Europe/Berlin"))
    column = ArrowColumn(input_field("valuation_date"), moment)
    assert column.cell(0) == dt.datetime(2026, 1, 1, tzinfo=dt.UTC)


@pytest.mark.parametrize(
    "dates",
    [
        pa.array([20_454, 10**7], pa.date32()),
        pa.array([1_767_225_600, 10**12], pa.timestamp("s")),
        pa.array([1_767_225_600_000, -(10**17)], pa.timestamp("ms", "Asia/Tokyo")),
    ],
    ids=lambda dates: str(dates.type),
)
def test_a_date_that_python_does_not_have_costs_its_row_alone(dates: pa.Array) -> None:
    columns = {name: pa.array([cell, cell]) for name, cell in TEXTS.items() if name != "expiry"}
    found = read(pa.RecordBatch.from_pydict({**columns, "valuation_date": dates, "expiration_date": dates}))
    assert found.rows.tolist() == [0]
    assert found.faults[1].field == "valuation_date"


def test_no_cell_of_a_flat_table_or_of_its_dividends_becomes_an_object(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a cell was read by itself")

    monkeypatch.setattr(ArrowColumn, "cell", refuse)
    count = 50
    lists = [[{"time": 0.25, "amount": 1.0}, {"time": 0.75, "amount": 1.0}]] * count
    base = {name: [number] * count for name, number in NUMBERS.items()} | {
        "option_type": ["put", "C"] * (count // 2)
    }
    found = read(pa.RecordBatch.from_pydict(base | {"cash_dividends": lists, "id": ["x"] * count}))
    assert found.rows.size == count
    assert {field.name for field in COLUMN_FIELDS} >= set(base)
