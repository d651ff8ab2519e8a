"""`pricing batch`: the files that it writes, what it prints, and how it ends."""

import csv
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pricing_core.american.contracts.result_fields import price_fields
from tests.app.held_work import HeldWork
from tests.problems.eventually import PATIENCE, eventually
from tests.problems.nightly import nightly

HEADER = ["id", "option_type", "spot", "strike", "expiry", "rate", "volatility", "desk"]
BOOK = Path(__file__).parents[3] / "examples" / "book.csv"
Completed = Callable[..., subprocess.CompletedProcess[str]]


def pricing(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, as a shell does."""
    command = [sys.executable, "-m", "app", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def write(path: Path, *strikes: object) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(HEADER)
        rows.writerows([k, "put", 100, strike, 1, 0.05, 0.2, "A, B"] for k, strike in enumerate(strikes))
    return path


def read(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_all_priced_is_status_0_and_a_summary(tmp_path: Path) -> None:
    target = tmp_path / "out.csv"
    found = pricing(
        "batch", write(tmp_path / "in.csv", 90, 100), target, "--tolerance", "1e-3", "--threads", 2
    )
    assert (found.returncode, found.stderr) == (0, "")
    assert [line.split()[:2] for line in found.stdout.splitlines()[1:]] == [
        ["read", "2"],
        ["priced", "2"],
        ["rejected", "0"],
        ["columns", "not"],
    ]
    assert found.stdout.splitlines()[-1].split() == ["columns", "not", "read", "2", "id,", "desk"]
    assert [(row["id"], row["desk"], row["status"]) for row in read(target)] == [
        ("0", "A, B", "ok"),
        ("1", "A, B", "ok"),
    ]
    assert read(tmp_path / "out.csv.rejects.csv") == []


def test_parts_that_are_discarded_are_told_of_in_one_line(tmp_path: Path, completed: Completed) -> None:
    parts = tmp_path / "out.csv.parts"
    parts.mkdir()
    (parts / "0123456789ab-000000.arrow").touch()
    arguments = ("batch", write(tmp_path / "in.csv", 90), tmp_path / "out.csv", "--tolerance", "1e-3")
    assert completed(*arguments).stderr == (
        f"pricing: warning: finished parts of an earlier run are discarded (1 in {parts}): "
        "--resume keeps them where the input and the parameters are the same\n"
    )


def test_a_file_without_greeks_is_made_where_none_are_asked_for(tmp_path: Path, completed: Completed) -> None:
    target = tmp_path / "out.csv"
    found = completed(
        "batch", write(tmp_path / "in.csv", 90), target, "--tolerance", "1e-3", "--greeks", "none"
    )
    assert found.returncode == 0
    assert list(read(target)[0]) == [*HEADER, *(field.name for field in price_fields("none", HEADER))]


def test_a_file_has_errors_of_greeks_where_they_are_asked_for(tmp_path: Path, completed: Completed) -> None:
    target = tmp_path / "out.csv"
    found = completed(
        "batch", write(tmp_path / "in.csv", 90), target, "--tolerance", "1e-3", "--greek-errors"
    )
    assert found.returncode == 0
    expected = price_fields("standard", HEADER, greek_errors=True)
    assert list(read(target)[0]) == [*HEADER, *(field.name for field in expected)]


def test_rejected_rows_are_status_1_and_explained_in_the_stated_file(
    tmp_path: Path, completed: Completed
) -> None:
    target, rejects = tmp_path / "out.csv", tmp_path / "why.csv"
    source = write(tmp_path / "in.csv", 90, "abc", 100)
    found = completed("batch", source, target, "--rejects", rejects, "--tolerance", "1e-3")
    assert found.returncode == 1
    assert str(rejects) in found.stdout
    assert [(row["line"], row["field"], row["value"]) for row in read(rejects)] == [("3", "strike", "abc")]
    assert [row["status"] for row in read(target)] == ["ok", "invalid_input", "ok"]


def test_a_misspelt_column_shows_in_the_summary(tmp_path: Path, completed: Completed) -> None:
    source = tmp_path / "in.csv"
    source.write_text(
        'option_type,spot,strike,expiry,rate,volatility,dividends,tol,yield,[red]\nput,100,90,1,0.05,0.2,"[]",1,1,1\n'
    )
    found = completed("batch", source, tmp_path / "out.csv")
    assert found.returncode == 0
    assert found.stdout.splitlines()[-1].split() == [
        *("columns", "not", "read", "4", "dividends,", "tol,", "yield,", "[red]")
    ]


def test_quiet_says_nothing(tmp_path: Path, completed: Completed) -> None:
    found = completed("batch", write(tmp_path / "in.csv", 0), tmp_path / "out.parquet", "--quiet")
    assert (found.returncode, found.stdout, found.stderr) == (1, "", "")
    assert (tmp_path / "out.parquet").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it is empty"),
        (b"id,spot\n1,2\n", "option_type (put or call), strike (money), expiry"),
        (b"id,\xff\n", "UTF-8"),
        (b"spot,spot\n", "column spot"),
    ],
)
def test_a_file_that_is_no_table_is_status_2_one_line_and_no_output(
    tmp_path: Path, completed: Completed, content: bytes, words: str
) -> None:
    source = tmp_path / "in.csv"
    source.write_bytes(content)
    found = completed("batch", source, tmp_path / "out.csv")
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr.startswith("pricing: ")
    assert words in found.stderr
    assert len(found.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [source]


def test_a_tolerance_out_of_range_is_status_2_before_any_work(tmp_path: Path, completed: Completed) -> None:
    found = completed("batch", write(tmp_path / "in.csv", 100), tmp_path / "out.csv", "--tolerance", "1")
    assert found.returncode == 2
    assert "tolerance" in found.stderr
    assert not (tmp_path / "out.csv").exists()


def closed_pipe() -> int:
    """Return the end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def full_disk() -> int:
    """Return a file to which nothing can be written, where there is one."""
    return os.open("/dev/full", os.O_WRONLY) if os.path.exists("/dev/full") else closed_pipe()


@pytest.mark.parametrize(("strike", "status", "opened"), [(90, 0, full_disk), ("abc", 1, closed_pipe)])
def test_a_summary_that_nobody_reads_does_not_change_the_status(
    tmp_path: Path, strike: object, status: int, opened: Callable[[], int]
) -> None:
    output = opened()
    source, target = write(tmp_path / "in.csv", strike), tmp_path / "out.csv"
    command = [sys.executable, "-m", "app", "batch", str(source), str(target), "--tolerance", "1e-3"]
    found = subprocess.run(
        command, stdout=output, stderr=subprocess.PIPE, text=True, timeout=120, check=False
    )
    os.close(output)
    assert (found.returncode, found.stderr) == (status, "")
    assert len(read(target)) == 1


def test_a_path_that_cannot_be_encoded_is_shown_escaped(tmp_path: Path) -> None:
    target = tmp_path / os.fsdecode(b"out\xff.csv")
    found = pricing("batch", write(tmp_path / "in.csv", 90), target, "--tolerance", "1e-3")
    assert (found.returncode, found.stderr) == (0, "")
    assert "out\\udcff.csv" in found.stdout
    assert len(read(target)) == 1


def test_a_pipe_may_take_the_rejects(tmp_path: Path, completed: Completed) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, text=True) as cat:
        source = write(tmp_path / "in.csv", "abc")
        assert completed("batch", source, tmp_path / "out.csv", "--rejects", pipe, "--quiet").returncode == 1
        lines = cat.communicate(timeout=60)[0].splitlines()
    assert lines[1].startswith("2,strike,abc,")
    assert pipe.is_fifo()


@pytest.mark.parametrize("how", [signal.SIGTERM, *nightly([signal.SIGINT, signal.SIGHUP])])
def test_an_interruption_leaves_no_half_written_output(tmp_path: Path, how: signal.Signals) -> None:
    held, folder = HeldWork(tmp_path / "held", first_unit=0), tmp_path / "files"
    folder.mkdir()
    source = write(folder / "in.csv", *[50 + k % 100 for k in range(30_000)])
    with held.started("batch", source, folder / "out.csv") as process:
        assert eventually(lambda: held.begun > 0)
        assert len(list(folder.iterdir())) > 1  # some is written
        process.send_signal(how)
        output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output) == (130, "")
    assert errors == "pricing: interrupted; nothing was written\n"
    assert list(folder.iterdir()) == [source]


def test_the_example_book_is_priced_whole(tmp_path: Path, completed: Completed) -> None:
    found = completed("batch", BOOK, tmp_path / "out.csv", "--tolerance", "1e-3", "--quiet")
    book, priced = read(BOOK), read(tmp_path / "out.csv")
    assert found.returncode == 0
    assert [row["id"] for row in priced] == [row["id"] for row in book]
    assert {row["status"] for row in priced} == {"ok"}
    assert {row["option_type"] for row in book} == {"put", "call"}
    assert {row["exercise"] for row in book} == {"american", "european"}
    for row in priced:
        slack = 1e-3 * float(row["strike"])
        assert float(row["price"]) >= float(row["european_price"]) - slack
        if row["exercise"] == "american":
            assert float(row["price"]) >= float(row["intrinsic_value"]) - slack
