import datetime as dt
import math
import os
import tracemalloc
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pricing_core.american import price_many
from pricing_core.american.arrow.schema import result_schema
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch import BatchSummary, Progress, run_batch
from pricing_core.batch.parquet_reader import LARGEST_BLOCK
from pricing_core.batch.plan import plan_of
from pricing_core.errors import InvalidInputError

Row = Callable[..., list[str]]
Write = Callable[..., Path]
Read = Callable[[Path], list[dict[str, str]]]
COARSE = 1e-3
UNREAD = ("id",)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "out.csv"


def many_contracts(count: int, row: Row) -> list[list[str]]:
    """Return contracts that differ in every number."""
    return [
        row(
            id=f"c{k}",
            option_type=("put", "call")[k % 2],
            spot=str(80 + k % 41),
            strike=str(100 + k % 7),
            expiry=str(round(0.1 + (k % 13) / 8, 4)),
            volatility=str(0.1 + (k % 5) / 20),
        )
        for k in range(count)
    ]


def test_a_thousand_contracts_with_three_bad_rows_give_997_prices_and_three_explanations(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    rows = many_contracts(1_000, row)
    rows[16] = row(id="c16", strike="abc")
    rows[500] = row(id="c500", volatility="-0.2")
    rows[999] = row(id="c999", option_type="straddle")
    source = write_table(rows)
    summary = run_batch(source, target, tolerance=COARSE, block_size=10_000)
    assert summary == BatchSummary(
        rows=1_000, priced=997, rejected=3, below_tolerance=summary.below_tolerance, unread=UNREAD
    )
    output = read_table(target)
    assert [line["id"] for line in output] == [f"c{k}" for k in range(1_000)]
    assert [k for k, line in enumerate(output) if line["price"] == ""] == [16, 500, 999]
    assert {output[k]["status"] for k in (16, 500, 999)} == {"invalid_input"}
    assert read_table(target.with_name("out.csv.rejects.csv")) == [
        {"line": "18", "field": "strike", "value": "abc", "reason": "must be a number such as 0.05 or 5e-2"},
        {"line": "502", "field": "volatility", "value": "-0.2", "reason": "must be a number from 0 to 15"},
        {"line": "1001", "field": "option_type", "value": "straddle", "reason": 'must be "put" or "call"'},
    ]


def test_a_price_does_not_depend_on_the_rows_around_it(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    rows = many_contracts(12, row)
    run_batch(write_table(rows), target, tolerance=COARSE, block_size=150, threads=2)
    together = read_table(target)
    for index in (0, 4, 5, 11):
        run_batch(write_table([rows[index]]), target, tolerance=COARSE)
        assert read_table(target) == [together[index]]


def test_the_numbers_are_those_of_price_many_to_the_last_digit(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    run_batch(write_table([row()]), target, tolerance=COARSE)
    columns = {"option_type": ["put"], "spot": [100.0], "strike": [100.0], "expiry": [1.0], "rate": [0.05]}
    expected = price_many(columns | {"volatility": [0.2]}, tolerance=COARSE)
    (line,) = read_table(target)
    for name in (field.name for field in price_fields("standard", columns) if field.kind == "number"):
        found = math.nan if line[name] == "" else float(line[name])
        np.testing.assert_equal(found, expected[name][0])
    assert line["exercise_now"] == "false"


def test_each_row_may_state_its_tolerance(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    header = ["id", "option_type", "spot", "strike", "expiry", "rate", "volatility", "tolerance"]
    source = write_table([[*row(), "1e-2"], [*row(), "1e-6"], [*row(), ""], [*row(), "1"]], header)
    run_batch(source, target, tolerance=1e-6)
    coarse, fine, default, wrong = read_table(target)
    assert float(coarse["price"]) != float(fine["price"])
    assert float(coarse["error_estimate"]) > float(fine["error_estimate"])
    assert (fine["price"], fine["error_estimate"]) == (default["price"], default["error_estimate"])
    assert wrong["status"] == "invalid_input"


@pytest.mark.parametrize("cell", ["", "abc", "nan", "inf", "1e999", "1,5", "1_000", "\uff11", "TRUE", "-1"])
@pytest.mark.parametrize("field", ["strike", "volatility", "expiry", "spot"])
def test_a_bad_cell_rejects_its_row_alone_and_is_shown(
    write_table: Write, read_table: Read, row: Row, target: Path, field: str, cell: str
) -> None:
    summary = run_batch(write_table([row(), row(**{field: cell})]), target, tolerance=COARSE)
    assert (summary.priced, summary.rejected) == (1, 1)
    (reject,) = read_table(target.with_name("out.csv.rejects.csv"))
    assert (reject["line"], reject["field"], reject["value"]) == ("3", field, cell)
    assert reject["reason"].startswith("must be ")


def test_a_long_value_is_cut_at_40_characters(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    run_batch(write_table([row(strike="9" * 500 + "x")]), target)
    (reject,) = read_table(target.with_name("out.csv.rejects.csv"))
    assert reject["value"] == "9" * 37 + "..."


def test_a_malformed_line_keeps_its_place_and_its_first_cells(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    summary = run_batch(
        write_table([row(id="first"), ["second", "put"], row(id="third")]), target, tolerance=COARSE
    )
    assert (summary.priced, summary.rejected) == (2, 1)
    output = read_table(target)
    assert [(line["id"], line["status"]) for line in output] == [
        ("first", "ok"),
        ("second", "invalid_input"),
        ("third", "ok"),
    ]
    (reject,) = read_table(target.with_name("out.csv.rejects.csv"))
    assert (reject["line"], reject["field"], reject["value"]) == ("3", "", "second,put")


def test_unknown_columns_pass_through_unchanged(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    notes = ["  padded ", 'with "quotes", commas', "two\nlines", "007", "1e5", "\u00e9t\u00e9"]
    notes += ["a\rreturn", "\r", "at the end\r", "both\r\n", "nul\0", "x" * 200_000]
    header = ["id", "option_type", "spot", "strike", "expiry", "rate", "volatility", "note"]
    source = write_table([[*row(), note] for note in notes], header)
    run_batch(source, target, tolerance=COARSE)
    output = read_table(target)
    assert [line["note"] for line in output] == notes
    assert list(output[0]) == [*header, *result_schema(header).names]


def test_rows_end_in_a_line_feed_alone(write_table: Write, row: Row, target: Path) -> None:
    run_batch(write_table([row(id="a\rb"), row(strike="a\rb")]), target, tolerance=COARSE)
    for path in (target, target.with_name("out.csv.rejects.csv")):
        content = path.read_bytes()
        assert b'"a\rb"' in content
        assert b"\r\n" not in content
        assert content.endswith(b"\n")


def test_one_long_cell_neither_costs_the_others_memory_nor_their_prices(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    rows = [row(expiry="0") for _ in range(1_000)]
    rows[3] = row(option_type="p" * 200_000)
    rows[4] = row(option_type="put\0")
    source = write_table(rows)
    tracemalloc.start()
    summary = run_batch(source, target)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (summary.priced, summary.rejected) == (998, 2)
    assert peak < 100e6  # bytes; the long cell's width in every row would be 800e6
    rejects = read_table(target.with_name("out.csv.rejects.csv"))
    assert [(line["line"], line["field"], line["value"]) for line in rejects] == [
        ("5", "option_type", "p" * 37 + "..."),
        ("6", "option_type", "put\0"),
    ]


def test_a_malformed_line_is_shown_even_beside_a_column_without_a_name(
    write_table: Write, read_table: Read, row: Row, target: Path
) -> None:
    header = ["", "option_type", "spot", "strike", "expiry", "rate", "volatility"]
    run_batch(write_table([["7", "put", "100"], row()], header), target, tolerance=COARSE)
    (reject,) = read_table(target.with_name("out.csv.rejects.csv"))
    assert (reject["field"], reject["value"]) == ("", "7,put,100")


def test_a_header_alone_gives_a_header_alone(write_table: Write, read_table: Read, target: Path) -> None:
    assert run_batch(write_table([]), target) == BatchSummary(unread=UNREAD)
    assert read_table(target) == []
    assert target.read_text().startswith("id,option_type,")
    parquet = target.with_suffix(".parquet")
    run_batch(write_table([]), parquet)
    assert pq.read_table(parquet).num_rows == 0


def test_csv_to_parquet_has_numbers_as_numbers_and_missing_ones_as_nan(
    write_table: Write, row: Row, target: Path
) -> None:
    parquet = target.with_suffix(".parquet")
    run_batch(write_table([row(), row(strike="abc")]), parquet, tolerance=COARSE)
    table = pq.read_table(parquet)
    assert table.schema.field("strike").type == pa.float64()
    assert table.schema.field("id").type == pa.string()
    assert table["strike"].to_pylist() == [100.0, None]
    assert np.isnan(table["price"].to_numpy()).tolist() == [False, True]
    assert table["exercise_now"].to_pylist() == [False, None]


@pytest.fixture
def sound_columns() -> dict[str, Any]:
    """The required columns of one sound row."""
    numbers = {"spot": [100.0], "strike": [100.0], "expiry": [1.0], "rate": [0.05], "volatility": [0.2]}
    return {"option_type": ["put"], **numbers}


@pytest.fixture
def parquet_source(tmp_path: Path) -> Path:
    """A Parquet table with types of its own, in small row groups, one row in error."""
    path = tmp_path / "in.parquet"
    table = pa.table(
        {
            "id": pa.array([1, 2, 3, 4], pa.int32()),
            "option_type": pa.array(["put", "call", "put", "put"]).dictionary_encode(),
            "spot": pa.array([90, 100, 110, 100], pa.int64()),
            "strike": [100.0, 100.0, math.nan, 100.0],
            "expiry": pa.array([1.0, 1.0, 1.0, None], pa.float32()),
            "rate": [0.05] * 4,
            "volatility": [0.2] * 4,
            "day": pa.array([0, 1, 2, None], pa.date32()),
        }
    )
    pq.write_table(table, path, row_group_size=2)
    return path


def test_parquet_to_parquet_keeps_the_types_of_the_input(
    parquet_source: Path, target: Path, read_table: Read
) -> None:
    parquet = target.with_suffix(".parquet")
    summary = run_batch(parquet_source, parquet, tolerance=COARSE, block_size=3)
    before, after = pq.read_table(parquet_source), pq.read_table(parquet)
    assert (summary.priced, summary.rejected) == (2, 2)
    assert after.schema == pa.schema([*before.schema, *result_schema(before.schema.names)])
    assert after["day"].to_pylist() == before["day"].to_pylist()
    rejects = read_table(target.with_name("out.parquet.rejects.csv"))
    assert [(reject["line"], reject["field"], reject["value"]) for reject in rejects] == [
        ("3", "strike", ""),
        ("4", "expiry", ""),
    ]


def test_parquet_to_csv_gives_the_same_prices(parquet_source: Path, target: Path, read_table: Read) -> None:
    parquet = target.with_suffix(".parquet")
    run_batch(parquet_source, parquet, tolerance=COARSE)
    run_batch(parquet_source, target, tolerance=COARSE)
    output = read_table(target)
    prices = [float(line["price"] or "nan") for line in output]
    np.testing.assert_array_equal(prices, pq.read_table(parquet)["price"].to_numpy())
    assert [line["strike"] for line in output] == ["100", "100", "", "100"]


@pytest.mark.parametrize(
    "column",
    [
        pa.array([["x"]]),
        pa.array([{"a": 1}]),
        pa.array([b"x"]),
        pa.array([b"x"], pa.large_binary()),
        pa.array([b"x"], pa.binary(1)),
        pa.array([b"x"]).dictionary_encode(),
    ],
    ids=lambda column: str(column.type)[:20],
)
def test_a_column_that_csv_cannot_hold_is_refused_before_any_work(
    sound_columns: dict[str, Any], tmp_path: Path, target: Path, column: pa.Array
) -> None:
    source = tmp_path / "in.parquet"
    pq.write_table(pa.table({**sound_columns, "note": column}), source)
    with pytest.raises(InvalidInputError, match=r"column note .* a CSV cell cannot hold it"):
        run_batch(source, target)
    assert list(tmp_path.iterdir()) == [source]
    assert run_batch(source, target.with_suffix(".parquet"), tolerance=COARSE).priced == 1


@pytest.mark.parametrize(
    "cell",
    [dt.date(2026, 1, 2), dt.datetime(2026, 1, 2, tzinfo=dt.UTC), Decimal("1.50"), True, dt.timedelta(1)],
    ids=str,
)
def test_times_and_decimals_pass_into_csv(
    sound_columns: dict[str, Any], tmp_path: Path, target: Path, read_table: Read, cell: object
) -> None:
    source = tmp_path / "in.parquet"
    pq.write_table(pa.table({**sound_columns, "note": [cell]}), source)
    run_batch(source, target, tolerance=COARSE)
    assert read_table(target)[0]["note"]


def test_another_spelling_of_a_parquet_column_is_refused(
    sound_columns: dict[str, Any], tmp_path: Path, target: Path
) -> None:
    source = tmp_path / "in.parquet"
    pq.write_table(pa.table({**sound_columns, "dividend_yield ": [0.5]}), source)
    with pytest.raises(
        InvalidInputError, match=r"there is no column 'dividend_yield ': did you mean dividend_yield\?"
    ):
        run_batch(source, target)


def test_nan_in_parquet_is_a_missing_cell(
    sound_columns: dict[str, Any], tmp_path: Path, target: Path, read_table: Read
) -> None:
    source = tmp_path / "in.parquet"
    missing = {"dividend_yield": [math.nan], "exercise_start": pa.array([math.nan], pa.float32())}
    pq.write_table(pa.table(sound_columns | missing), source)
    assert run_batch(source, target, tolerance=COARSE).priced == 1
    assert {read_table(target)[0][name] for name in missing} == {""}


def test_a_parquet_column_of_the_wrong_type_refuses_the_file(tmp_path: Path, target: Path) -> None:
    source = tmp_path / "in.parquet"
    names = ("option_type", "spot", "strike", "expiry", "rate", "volatility")
    pq.write_table(pa.table({name: ["100"] for name in names}), source)
    with pytest.raises(InvalidInputError, match="column spot = 'string': must be a column of numbers"):
        run_batch(source, target)


def test_a_damaged_parquet_file_leaves_nothing(parquet_source: Path, target: Path) -> None:
    sound = parquet_source.read_bytes()
    damaged = [
        b"",
        b"no parquet",
        sound[:4] + b"\xff" * 36 + sound[40:],  # its first page
        sound[:-40] + b"\xff" * 30 + sound[-10:],  # its footer
        sound.replace(b"volatility", b"vol\xfftility"),
    ]
    for content in damaged:
        parquet_source.write_bytes(content)
        with pytest.raises(InvalidInputError, match=r"^input = 'in\.parquet': must be an undamaged Parquet"):
            run_batch(parquet_source, target)
        assert list(target.parent.iterdir()) == [parquet_source]


def test_parquet_text_that_is_not_utf_8_is_damage_too(
    sound_columns: dict[str, Any], tmp_path: Path, target: Path
) -> None:
    source = tmp_path / "in.parquet"
    bad = pa.array([b"\xff"]).view(pa.string())
    pq.write_table(pa.table({**sound_columns, "note": bad}), source)
    with pytest.raises(InvalidInputError, match=r"'in\.parquet': must be an undamaged Parquet"):
        run_batch(source, target)


def test_a_column_with_the_name_of_a_result_is_refused_where_there_is_such_a_result(
    write_table: Write, row: Row, target: Path
) -> None:
    header = ["delta", "option_type", "spot", "strike", "expiry", "rate", "volatility"]
    source = write_table([row()], header)
    with pytest.raises(InvalidInputError, match=r"^column delta has the name of a result"):
        run_batch(source, target)
    assert list(target.parent.iterdir()) == [source]
    assert run_batch(source, target, tolerance=COARSE, greeks="none").priced == 1
    source = write_table([row()], ["delta_error", *header[1:]])
    assert run_batch(source, target, tolerance=COARSE).priced == 1
    with pytest.raises(InvalidInputError, match=r"^column delta_error has the name of a resu"):
        run_batch(source, target, greek_errors=True)


@pytest.mark.parametrize("name", ["in.csv", "in.parquet"])
def test_an_input_that_is_no_regular_file_is_refused_at_once(tmp_path: Path, target: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InvalidInputError, match=r"in\.\w+': must be a regular file"):
        run_batch(tmp_path / name, target)


def test_progress_is_told_of_every_unit(write_table: Write, row: Row, target: Path) -> None:
    told: list[Progress] = []
    source = write_table([row(strike="bad")] * 5)
    summary = run_batch(source, target, block_size=50, threads=1, progress=told.append)
    assert sorted((progress.unit, progress.unit_summary.rejected) for progress in told) == [
        (0, 2),
        (1, 2),
        (2, 1),
    ]
    assert [progress.summary.rows for progress in told] == sorted(progress.summary.rows for progress in told)
    assert (told[-1].summary, told[-1].fraction) == (summary, 1.0)


@pytest.mark.parametrize(
    ("source", "target"), [("in.txt", "out.csv"), ("in.csv", "out.xlsx"), ("in", "out.csv")]
)
def test_another_ending_is_refused(
    write_table: Write, row: Row, tmp_path: Path, source: str, target: str
) -> None:
    write_table([row()], name=source)
    with pytest.raises(InvalidInputError, match=r"\.csv, \.csv\.gz, \.csv\.zst or \.parquet"):
        run_batch(tmp_path / source, tmp_path / target)


def test_no_file_may_play_two_parts(write_table: Write, row: Row, target: Path) -> None:
    source = write_table([row()])
    for output, rejects in [(source, None), (target, source), (target, target)]:
        with pytest.raises(InvalidInputError, match="another file than"):
            run_batch(source, output, rejects=rejects)
    assert source.read_text().startswith("id,")


def test_the_whole_file_is_never_held(tmp_path: Path, sound_columns: dict[str, Any]) -> None:
    rows = 1 << 20
    table = pa.table({name: pa.repeat(cells[0], rows) for name, cells in sound_columns.items()})
    pq.write_table(table, tmp_path / "in.parquet", row_group_size=rows)
    plan = plan_of(f"{tmp_path}/in.parquet", f"{tmp_path}/out.parquet", PricingSettings())
    sizes = [len(unit.block.read().lines) for _, unit in plan.units()]
    assert sizes == [LARGEST_BLOCK] * (rows // LARGEST_BLOCK)


@pytest.mark.parametrize(
    "column",
    [
        pa.array([[("a", "p")], []], pa.map_(pa.string(), pa.string())),
        pa.array([["a", "b"]] * 2, pa.list_(pa.string(), 2)),
        pa.array([["a"], None], pa.large_list(pa.string())),
        pa.array([[["a"]], []], pa.list_(pa.list_(pa.string()))),
        pa.array([{"x": "a"}, {"x": None}]),
        pa.array(["a", "b"]).dictionary_encode(),
        pa.array(["a", None], pa.large_string()),
        pa.array([b"a", None]),
    ],
    ids=lambda column: str(column.type),
)
def test_text_of_every_kind_passes_from_parquet_to_parquet(
    tmp_path: Path, sound_columns: dict[str, Any], column: pa.Array
) -> None:
    columns = {name: cells[:1] * 2 for name, cells in sound_columns.items()}
    pq.write_table(pa.table({**columns, "note": column}), tmp_path / "in.parquet")
    run_batch(tmp_path / "in.parquet", tmp_path / "out.parquet", tolerance=COARSE)
    found = pq.read_table(tmp_path / "out.parquet")["note"]
    assert found.type == column.type
    assert found.to_pylist() == column.to_pylist()
