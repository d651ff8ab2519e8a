"""Tables whose rows have curves, dividends, exercise times and dates."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pricing_core.american import (
    CashDividend,
    Greeks,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    contract_from,
    price,
)
from pricing_core.american.contracts.result_fields import GREEK_ERROR_FIELDS, price_fields
from pricing_core.batch import run_batch
from pricing_core.errors import InvalidInputError
from tests.problems.engine_with_errors import ERRORS

Read = Callable[[Path], list[dict[str, str]]]
PLAIN = {
    "option_type": "put",
    "spot": "100",
    "strike": "100",
    "expiry": "1",
    "rate": "0.05",
    "volatility": "0.2",
}
NUMBERS = {name: float(cell) for name, cell in PLAIN.items() if name != "option_type"}
DATES = {"expiry": "", "valuation_date": "2026-01-01", "expiration_date": "2027-01-01"}
CURVE = '{"times": [0.5, 1], "values": [0.1, 0.2]}'
COARSE = 1e-3


def write(path: Path, *rows: dict[str, str]) -> Path:
    """Write rows under all the columns that any of them has."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, names)
        table.writeheader()
        table.writerows(rows)
    return path


def test_every_event_of_a_csv_reaches_the_engine(tmp_path: Path, read_table: Read) -> None:
    source = write(
        tmp_path / "in.csv",
        PLAIN,
        PLAIN | {"rate": CURVE},
        PLAIN | {"dividend_yield": CURVE, "volatility": CURVE},
        PLAIN | {"exercise": "bermudan", "exercise_times": "[0.5, 0.25]"},
        PLAIN | {"exercise_start": "0.5"},
        PLAIN | {"cash_dividends": '[{"time": 0.5, "amount": 1}]', "dividend_model": "escrowed"},
        PLAIN | DATES | {"exercise": "bermudan", "exercise_times": '["2026-07-02T12:00", 0.25]'},
        PLAIN | DATES | {"exercise_start": "2026-07-02T12:00"},
        PLAIN | DATES | {"proportional_dividends": '[{"ex_date": "2026-03-15", "fraction": 0.01}]'},
    )
    summary = run_batch(source, tmp_path / "out.csv", tolerance=COARSE)
    assert (summary.priced, summary.rejected) == (9, 0)
    curve = PiecewiseConstant((0.5, 1.0), (0.1, 0.2))
    put, market = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)
    contracts = [
        (put, Market(100.0, curve, 0.2)),
        (put, Market(100.0, 0.05, curve, curve)),
        (Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5)), market),
        (Option("put", 100.0, 1.0, exercise_start=0.5), market),
        (put, Market(100.0, 0.05, 0.2, 0.0, (CashDividend(0.5, 1.0),), dividend_model="escrowed")),
        (Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5)), market),
        (Option("put", 100.0, 1.0, exercise_start=0.5), market),
        (put, Market(100.0, 0.05, 0.2, 0.0, (), (ProportionalDividend(0.2, 0.01),))),
    ]
    valuations = [price(*contract, tolerance=COARSE, greeks="none") for contract in contracts]
    output = read_table(tmp_path / "out.csv")
    assert [line["method"] for line in output] == ["premium-march", *["obstacle-march"] * 8]
    assert [line["price"] for line in output[1:]] == [repr(valuation.price) for valuation in valuations]
    assert [line["dividend_sensitivities"] != "" for line in output] == [False] * 5 + [True] + [False] * 3
    assert output[1]["rate"] == CURVE


def test_a_bad_event_rejects_its_row_alone_and_is_shown(tmp_path: Path, read_table: Read) -> None:
    dividends = '[{"time": 0.5, "amount": 1.0}, {"time": 0.5, "amount": -1.0}]'
    source = write(
        tmp_path / "in.csv",
        PLAIN | {"rate": CURVE},
        PLAIN | {"cash_dividends": dividends},
        PLAIN | {"cash_dividends": "[{]"},
        PLAIN | {"volatility": '{"times": [1], "values": [99]}'},
        PLAIN | {"exercise_times": "[0.5]"},
        PLAIN | {"dividend_model": "other"},
        PLAIN | {"exercise_start": "later"},
        PLAIN | DATES | {"expiration_date": "2026-02-30"},
        PLAIN | DATES | {"expiration_date": "2025-12-31"},
        PLAIN | DATES | {"expiration_date": ""},
        PLAIN | DATES | {"expiry": "1"},
        PLAIN | {"expiry": ""},
        PLAIN,
    )
    summary = run_batch(source, tmp_path / "out.csv", tolerance=COARSE)
    assert (summary.priced, summary.rejected) == (2, 11)
    rejects = read_table(tmp_path / "out.csv.rejects.csv")
    assert [(line["line"], line["field"], line["value"]) for line in rejects] == [
        ("3", "cash_dividends[1].amount", "-1.0"),
        ("4", "cash_dividends", "[{]"),
        ("5", "volatility.values", "99.0"),
        ("6", "exercise_times", "[0.5]"),
        ("7", "dividend_model", "other"),
        ("8", "exercise_start", "later"),
        ("9", "expiration_date", "2026-02-30"),
        ("10", "expiration_date", "2025-12-31"),
        ("11", "expiration_date", ""),
        ("12", "expiry", "1"),
        ("13", "expiry", ""),
    ]
    assert rejects[0]["reason"] == "must be a number from 0 to 1e+30"
    assert all(line["reason"].startswith("must be ") for line in rejects)


def test_a_text_inside_a_list_is_shown_as_one_and_a_missing_part_is_named(
    tmp_path: Path, read_table: Read
) -> None:
    source = write(
        tmp_path / "in.csv",
        PLAIN | {"cash_dividends": '[{"time": 0.25, "amount": "1.0"}]'},
        PLAIN | {"cash_dividends": '[{"time": 0.25}]'},
    )
    run_batch(source, tmp_path / "out.csv", tolerance=COARSE)
    rejects = read_table(tmp_path / "out.csv.rejects.csv")
    assert [(line["field"], line["value"], line["reason"]) for line in rejects] == [
        ("cash_dividends[0].amount", "'1.0'", "must be a number from 0 to 1e+30"),
        ("cash_dividends[0].amount", "missing", "must be given"),
    ]


def as_list(cell: list[float] | str | None) -> list[float] | None:
    """Return a list of a table, or its JSON in a CSV cell."""
    return json.loads(cell or "null") if isinstance(cell, str) else cell


def test_dates_price_as_their_expiry_does(tmp_path: Path, read_table: Read) -> None:
    source = write(tmp_path / "in.csv", PLAIN | DATES, PLAIN | dict.fromkeys(DATES, "") | {"expiry": "1"})
    run_batch(source, tmp_path / "out.csv", tolerance=COARSE)
    dated, plain = read_table(tmp_path / "out.csv")
    assert dated["status"] == "ok"
    assert dated["price"] == plain["price"]


def test_a_row_with_events_is_priced_as_the_library_does(tmp_path: Path, read_table: Read) -> None:
    source = write(tmp_path / "in.csv", PLAIN | {"cash_dividends": '[{"time": 0.5, "amount": 3}]'})
    run_batch(source, tmp_path / "out.csv", tolerance=COARSE)
    (line,) = read_table(tmp_path / "out.csv")
    market = Market(100.0, 0.05, 0.2, cash_dividends=(CashDividend(0.5, 3.0),))
    valuation = price(Option("put", 100.0, 1.0), market, tolerance=COARSE)
    assert line["price"] == repr(valuation.price)
    assert json.loads(line["dividend_sensitivities"]) == list(valuation.dividend_sensitivities or ())


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_has_the_greeks_that_were_asked_for(
    tmp_path: Path, read_table: Read, greeks: Greeks, ending: str
) -> None:
    events = {"rate": CURVE, "dividend_yield": "0.02", "cash_dividends": '[{"time": 0.5, "amount": 3}]'}
    source = write(tmp_path / "in.csv", PLAIN | events, PLAIN | {"spot": "-1"})
    target = tmp_path / f"out.{ending}"
    run_batch(source, target, tolerance=COARSE, greeks=greeks)
    found = read_table(target) if ending == "csv" else pq.read_table(target).to_pylist()
    names = list(read_table(source)[0])
    fields = price_fields(greeks, names)
    assert list(found[0]) == [*names, *(field.name for field in fields)]
    single = price(
        *contract_from(PLAIN | NUMBERS | events | {"dividend_yield": 0.02}), tolerance=COARSE, greeks=greeks
    )
    for field in fields:
        cell, wanted = found[0][field.name], getattr(single, field.name)
        if field.kind == "list":
            assert as_list(cell) == (wanted and list(wanted)), field.name
        elif field.kind == "number":
            assert (None if cell in (None, "") else float(cell)) == wanted, field.name
        assert (found[1][field.name] in ("", None)) == (field.name != "status")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_has_the_errors_of_its_greeks_where_they_are_asked_for(
    tmp_path: Path, read_table: Read, ending: str, engine_with_errors: None
) -> None:
    source = write(tmp_path / "in.csv", PLAIN | {"cash_dividends": '[{"time": 0.5, "amount": 3}]'})
    target = tmp_path / f"out.{ending}"
    run_batch(source, target, greeks="extended", greek_errors=True)
    (found,) = read_table(target) if ending == "csv" else pq.read_table(target).to_pylist()
    names = list(read_table(source)[0])
    fields = price_fields("extended", names, greek_errors=True)
    assert list(found) == [*names, *(field.name for field in fields)]
    assert as_list(found["dividend_sensitivities_error"]) == [2e-5]
    for field in GREEK_ERROR_FIELDS:
        if not field.per:
            cell = found[field.name]
            assert (None if cell in (None, "") else float(cell)) == ERRORS.get(field.of), field.name


def test_greeks_by_another_word_are_refused(tmp_path: Path) -> None:
    source = write(tmp_path / "in.csv", PLAIN)
    with pytest.raises(InvalidInputError, match='greeks = True: must be "none", "standard" or "extended"'):
        run_batch(source, tmp_path / "out.csv", greeks=True)  # type: ignore[arg-type]
    assert not (tmp_path / "out.csv").exists()


def test_lists_structures_and_timestamps_of_parquet_are_read(tmp_path: Path) -> None:
    moments = pa.array([1_767_225_600_000_000_000] * 3, pa.timestamp("ns"))  # the start of 2026
    days = pa.array([20_819] * 3, pa.date32())  # and that of 2027
    table = pa.table(
        {
            "option_type": ["put"] * 3,
            "spot": [100.0] * 3,
            "strike": [100.0] * 3,
            "rate": [0.05] * 3,
            "volatility": [
                {"times": [9.0], "values": [0.2]},
                {"times": [0.5, 1.0], "values": [0.1, 0.2]},
                None,
            ],
            "valuation_date": moments,
            "expiration_date": days,
            "cash_dividends": [[{"time": 0.5, "ex_date": None, "amount": 1.0}], [], None],
        }
    )
    pq.write_table(table, tmp_path / "in.parquet")
    target = tmp_path / "out.parquet"
    summary = run_batch(tmp_path / "in.parquet", target, tolerance=COARSE)
    assert (summary.priced, summary.rejected) == (2, 1)
    curve = PiecewiseConstant((0.5, 1.0), (0.1, 0.2))
    contracts = [
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.0, (CashDividend(0.5, 1.0),))),
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, curve)),
    ]
    found = pq.read_table(target)
    assert found.select(table.schema.names).equals(table)
    valuations = [price(*contract, tolerance=COARSE) for contract in contracts]
    assert found["price"].to_pylist() == [*(valuation.price for valuation in valuations), None]
    assert found["dividend_sensitivities"].to_pylist() == [
        list(valuations[0].dividend_sensitivities or ()),
        None,
        None,
    ]
    assert found["status"].to_pylist() == ["ok", "ok", "invalid_input"]


@pytest.mark.parametrize(("curves", "kind"), [(True, pa.string()), (False, pa.float64())])
def test_rates_of_a_csv_are_numbers_in_parquet_unless_some_are_curves(
    tmp_path: Path, curves: bool, kind: pa.DataType
) -> None:
    source = write(tmp_path / "in.csv", PLAIN, PLAIN | {"rate": CURVE if curves else "0.04"})
    target = tmp_path / "out.parquet"
    assert run_batch(source, target, tolerance=COARSE).priced == 2
    found = pq.read_table(target)
    assert found.schema.field("rate").type == kind
    assert found["rate"].to_pylist() == (["0.05", CURVE] if curves else [0.05, 0.04])
    assert found["spot"].to_pylist() == [100.0, 100.0]
