"""`pricing scenarios` and `pricing explain`: the files that they write, what they print, and how they end."""

import csv
import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pricing_core.batch import scenario_files, scenarios, value_scenarios
from pricing_core.batch.scenario import read_scenarios, scenarios_of
from pricing_core.errors import InvalidInputError

HEADER = ["id", "option_type", "spot", "strike", "expiry", "rate", "volatility", "desk"]
Completed = Callable[..., subprocess.CompletedProcess[str]]


def pricing(*arguments: object, text: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, as a shell does."""
    command = [sys.executable, "-m", "app", *map(str, arguments)]
    return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)


def write(path: Path, *spots: object, volatility: object = 0.2, expiry: float = 1.0) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(HEADER)
        rows.writerows([k, "put", s, 100, expiry, 0.05, volatility, "A, B"] for k, s in enumerate(spots))
    return path


def read(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def as_floats(table: pa.Table) -> pa.Table:
    """Return the table with its numbers as numbers."""
    numbers = [name for name in HEADER if name not in ("id", "option_type", "desk")]
    return pa.table(
        {n: table[n].cast(pa.float64()) if n in numbers else table[n] for n in table.schema.names}
    )


def test_a_file_has_the_rows_of_the_function(tmp_path: Path, completed: Completed) -> None:
    source, target = write(tmp_path / "in.csv", 90, 100), tmp_path / "out.csv"
    found = completed(
        "scenarios", source, target, "--spot-shifts", "-0.1,0", "--days-forward", "5", "--tolerance", "1e-3"
    )
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout == f"2 contracts under 2 scenarios: 4 rows in {target}\ncolumns not read: id, desk\n"
    book = as_floats(pa.Table.from_pylist(read(source.read_text())))
    wanted = value_scenarios(book, spot_shifts=[-0.1, 0.0], days_forward=[5], tolerance=1e-3).to_pylist()
    rows = read(target.read_text())
    assert [float(row["profit_and_loss"]) for row in rows] == [row["profit_and_loss"] for row in wanted]
    assert [row["desk"] for row in rows] == ["A, B"] * 4
    assert list(rows[0])[:12] == [*HEADER, "spot_shift", "volatility_shift", "rate_shift", "days_forward"]


def test_named_scenarios_as_a_matrix_in_parquet(tmp_path: Path, completed: Completed) -> None:
    names = tmp_path / "named.json"
    names.write_text(
        json.dumps([{"name": "crash", "spot_shift": -0.3}, {"name": "calm", "volatility_shift": -0.05}])
    )
    target = tmp_path / "out.parquet"
    found = completed(
        "scenarios",
        write(tmp_path / "in.csv", 90),
        target,
        "--scenarios",
        names,
        "--matrix",
        "--tolerance",
        "1e-3",
    )
    assert (found.returncode, found.stderr) == (0, "")
    table = pq.read_table(target)
    assert table.schema.names == [*HEADER, "price", "crash", "calm", "status", "message"]
    assert table.schema.field("spot").type == pa.float64()
    assert table["crash"][0].as_py() > 0.0 > table["calm"][0].as_py()


def test_groups_through_pipes_and_a_contract_without_a_value(tmp_path: Path) -> None:
    source = write(tmp_path / "in.csv", 90, "abc", 100)
    found = pricing(
        "scenarios", "-", "-", "--input-format", "csv", "--output-format", "csv", "--group-by", "desk,strike",
        "--rate-shifts", "0.01", "--tolerance", "1e-3", text=source.read_text(),
    )  # fmt: skip
    assert (found.returncode, found.stderr) == (1, "")
    (row,) = read(found.stdout)
    assert (row["desk"], row["strike"], row["contracts"], row["contracts_left_out"]) == (
        "A, B",
        "100",
        "3",
        "1",
    )
    assert float(row["delta_money"]) < 0.0


def test_a_shift_out_of_range_is_status_1_and_a_row_says_why(tmp_path: Path, completed: Completed) -> None:
    target = tmp_path / "out.csv"
    source = write(tmp_path / "in.csv", 90, 100)
    found = completed("scenarios", source, target, "--volatility-shifts", "-0.3,0", "--tolerance", "1e-3")
    assert found.returncode == 1
    assert found.stdout.splitlines()[1] == "2 contracts without a profit or loss in some scenario"
    rows = read(target.read_text())
    assert [row["status"] for row in rows] == ["invalid_input", "ok"] * 2
    assert "volatility = -0.09" in rows[0]["message"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((), "scenarios"),
        (("--spot-shifts", "0.1", "--scenarios", "missing.csv"), "scenarios"),
        (("--spot-shifts", "0.1,x"), "spot-shifts"),
        (("--days-forward", "-1"), "days_forward"),
        (("--spot-shifts", "0.1", "--group-by", "account"), "account"),
        (("--spot-shifts", "0.1", "--greeks", "all"), "greeks"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(
    tmp_path: Path, completed: Completed, arguments: tuple[str, ...], word: str
) -> None:
    target = tmp_path / "out.csv"
    found = completed("scenarios", write(tmp_path / "in.csv", 90), target, *arguments)
    assert found.returncode == 2
    assert word in found.stderr
    assert len(found.stderr.splitlines()) == 1
    assert not target.exists()


def test_an_output_that_is_an_input_or_of_no_kind_is_refused(tmp_path: Path, completed: Completed) -> None:
    source = write(tmp_path / "in.csv", 90)
    before = source.read_bytes()
    for target in (source, tmp_path / "out.txt", tmp_path / "missing" / "out.csv"):
        assert completed("scenarios", source, target, "--spot-shifts", "0.1").returncode == 2
    assert completed("explain", source, source, source).returncode == 2
    assert source.read_bytes() == before


def test_explained_files_and_their_status(tmp_path: Path, completed: Completed) -> None:
    before, after = write(tmp_path / "a.csv", 100, 90, 80), write(tmp_path / "b.csv", 101, 90, expiry=0.99)
    target = tmp_path / "out.csv"
    found = completed("explain", before, after, target, "--tolerance", "1e-3")
    assert (found.returncode, found.stderr) == (1, "")
    assert found.stdout.splitlines()[1] == "1 of them without a profit or loss: their status says why"
    rows = read(target.read_text())
    assert [row["status"] for row in rows] == ["ok", "ok", "only_before"]
    assert float(rows[1]["delta_effect"]) == 0.0 > float(rows[1]["theta_effect"])
    assert rows[2]["residual"] == ""
    assert (
        completed("explain", before, before, target, "--key", "id,desk", "--tolerance", "1e-3").returncode
        == 0
    )
    refused = completed("explain", before, after, target, "--key", "account")
    assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1)


def test_many_contracts_are_worked_on_some_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = write(tmp_path / "in.csv", *(80 + k for k in range(40)))
    lists: dict[str, Any] = {"spot_shifts": [-0.1, 0.1]}
    targets = [tmp_path / "whole.csv", tmp_path / "parts.csv"]
    for target, size in zip(targets, (65_536, 10), strict=True):
        monkeypatch.setattr(scenarios, "ROWS_AT_A_TIME", size)
        summary = scenario_files.run_scenarios(source, target, scenarios_of(**lists), tolerance=1e-3)
        assert (summary.contracts, summary.rows, summary.incomplete) == (40, 80, 0)
    assert targets[0].read_bytes() == targets[1].read_bytes()


def test_a_folder_of_parquet_files_is_one_table(tmp_path: Path) -> None:
    book = as_floats(pa.Table.from_pylist(read(write(tmp_path / "in.csv", 90, 100).read_text())))
    for desk in ("x", "y"):
        folder = tmp_path / "book" / f"region={desk}"
        folder.mkdir(parents=True)
        pq.write_table(book, folder / "part.parquet")
    target = tmp_path / "out.parquet"
    scenario_files.run_scenarios(tmp_path / "book", target, scenarios_of([0.1]), tolerance=1e-3)
    found = pq.read_table(target)
    assert found["region"].to_pylist() == ["x", "x", "y", "y"]
    assert found["price"].to_pylist()[:2] == found["price"].to_pylist()[2:]


def test_a_run_that_fails_leaves_nothing(tmp_path: Path, completed: Completed) -> None:
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    target.write_text("before")
    source.write_text(write(source, 90).read_text() + '1,"put\n2,put\n3,put\n')
    found = completed("scenarios", source, target, "--spot-shifts", "0.1")
    assert found.returncode == 2
    assert target.read_text() == "before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.csv", "out.csv"]


@pytest.mark.parametrize("command", ["batch", "scenarios", "explain"])
def test_columns_in_other_units_are_warned_of_in_one_line_each(
    tmp_path: Path, completed: Completed, command: str
) -> None:
    source = write(tmp_path / "in.csv", 90, 100, volatility=20, expiry=30)
    options = {"batch": (), "scenarios": ("--spot-shifts", "0"), "explain": ()}[command]
    inputs = [source, source] if command == "explain" else [source]
    found = completed(command, *inputs, tmp_path / "out.csv", *options, "--tolerance", "1e-3")
    warned = ["column expiry looks like days", "column volatility looks like percent"]
    lines = [line for line in found.stderr.splitlines() if line.startswith("pricing: warning: ")]
    assert [line.removeprefix("pricing: warning: ").split(":")[0] for line in lines] == warned
    assert (tmp_path / "out.csv").exists()


def test_warnings_are_json_where_progress_is(tmp_path: Path, completed: Completed) -> None:
    source = write(tmp_path / "in.csv", 90, volatility=20)
    found = completed("batch", source, tmp_path / "out.csv", "--log-json", "--tolerance", "1e-3")
    first, *_, last = (json.loads(line) for line in found.stderr.splitlines())
    assert (first["event"], last["event"]) == ("warning", "end")
    assert first["message"].startswith("column volatility looks like percent: its median is 20;")


def test_failures_are_json_where_progress_is(tmp_path: Path, completed: Completed) -> None:
    source, missing = write(tmp_path / "in.csv", 90), tmp_path / "none.csv"
    for name, option, message in (
        (source, "-1", "tolerance = -1"),
        (missing, "1e-3", f"{missing}: No such file"),
    ):
        found = completed("batch", name, tmp_path / "out.csv", "--log-json", "--tolerance", option)
        told = json.loads(found.stderr)
        assert (found.returncode, found.stdout, told["event"]) == (2, "", "error")
        assert told["message"].startswith(message)


def test_contracts_left_out_of_sums_are_told_and_change_the_status(
    tmp_path: Path, completed: Completed
) -> None:
    source = tmp_path / "in.csv"
    rows = [[*HEADER, "quantity", "qty"]]
    rows += [[k, "put", 100, 100, 1.0, 0.05, 0.2, "a", size, 7] for k, size in enumerate(("3", "", "zz"))]
    with source.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    found = completed(
        "scenarios",
        source,
        tmp_path / "o.csv",
        "--spot-shifts",
        "0",
        "--group-by",
        "desk",
        "--tolerance",
        "1e-3",
    )
    assert (found.returncode, found.stderr) == (1, "")
    assert found.stdout.splitlines()[1:] == [
        "2 contracts without a price, or what the sums need, in some scenario",
        "columns not read: id, qty",
    ]
    (row,) = read((tmp_path / "o.csv").read_text())
    assert (row["contracts"], row["contracts_left_out"]) == ("3", "2")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,spot_shift,spot_shift\na,1,2\n", "columns of different names"),
        ("name,spot_shift\na\n", "a row of 2 cells, as the header"),
        ("name,spot_shift\na,1,2\n", "a row of 2 cells, as the header"),
        ("", "a CSV file with a header"),
    ],
)
def test_files_of_scenarios_that_are_no_tables_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InvalidInputError, match=words):
        read_scenarios(str(tmp_path / "s.csv"))
    (tmp_path / "s.json").write_text('[{"name": null, "spot_shift": 0.1}]')
    with pytest.raises(InvalidInputError, match="a text"):
        read_scenarios(str(tmp_path / "s.json"))
