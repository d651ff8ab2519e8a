"""`pricing chain`: what it writes, what it prints, and how it ends."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pricing_core.american import LocalVolatility
from pricing_core.chains import fit_chain, read_chain

SAMPLES = Path(__file__).parents[2] / "data" / "chains"
PNG = b"\x89PNG"
TABLES = ("quotes", "carry", "pairs", "dividends", "surface", "local_volatility")
PICTURES = ("smiles", "total_variance", "forward", "boundaries", "residuals")
Completed = Callable[..., subprocess.CompletedProcess[str]]


def pricing(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, as a shell does."""
    command = [sys.executable, "-m", "app", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)


def test_a_folder_has_the_tables_of_the_fit_and_a_report(tmp_path: Path, completed: Completed) -> None:
    (tmp_path / "dividends.csv").write_text("ex_date,amount\n2026-06-01,0.5\n")
    (tmp_path / "rates.csv").write_text("days,rate\n30,0.03\n365,0.04\n")
    out = tmp_path / "out"
    files = ("--rates", tmp_path / "rates.csv", "--dividends", tmp_path / "dividends.csv")
    found = completed("chain", SAMPLES / "generic.csv", out, *files)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.startswith("12 quotes of 2 expirations, 12 with a volatility\n")
    rates = {"times": [30 / 365, 1.0], "values": [0.03, (0.04 - 0.03 * 30 / 365) / (1 - 30 / 365)]}
    fit = fit_chain(
        read_chain(SAMPLES / "generic.csv"), rates, cash_dividends=[{"ex_date": "2026-06-01", "amount": 0.5}]
    )
    assert fit.carry["forward"].to_pylist() == pytest.approx(
        pq.read_table(out / "carry.parquet")["forward"].to_pylist()
    )
    for name in TABLES:
        with (out / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        table = pq.read_table(out / f"{name}.parquet")
        assert len(rows) == table.num_rows > 0
        assert list(rows[0]) == table.schema.names
    local = LocalVolatility(**json.loads((out / "local_volatility.json").read_text()))
    assert local.at(0.1, 100.0) == pytest.approx(0.25, abs=0.01)
    report = (out / "report.html").read_text()
    for name in PICTURES:
        assert (out / f"{name}.png").read_bytes().startswith(PNG)
        assert f'src="{name}.png"' in report


def test_a_row_that_cannot_be_read_is_told_and_ends_with_1(tmp_path: Path, completed: Completed) -> None:
    text = (SAMPLES / "generic.csv").read_text().replace("100.0,2026-03-02", "oops,2026-03-02", 1)
    (tmp_path / "quotes.csv").write_text(text)
    found = completed("chain", tmp_path / "quotes.csv", tmp_path / "out", "--rate", "0.04")
    assert found.returncode == 1
    assert "flagged unreadable: 1\nrow 1: underlying_price = 'oops': must be a number" in found.stdout


def test_a_file_of_which_all_has_expired_ends_with_1(tmp_path: Path) -> None:
    options = ("--rate", "0.04", "--valuation-date", "2036-01-02")
    found = pricing("chain", SAMPLES / "generic.csv", tmp_path / "out", *options)
    assert (found.returncode, found.stderr) == (1, "")
    assert "flagged expired: 12\n" in found.stdout
    assert found.stdout.endswith("surface: no pair of call and put tells the carry\n")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ((), "rate is missing: give --rate or --rates"),
        (("--rate", "0.04", "--rates", "rates.csv"), "rate = given twice"),
        (("--rate", "0.04", "--format", "bloomberg"), "format = 'bloomberg': must be one of"),
        (
            ("--rate", "0.04", "--format", "orats"),
            "underlying_price, quote_date, expiration, bid and ask are missing",
        ),
        (("--rate", "0.04", "--dividends", "absent.csv"), "absent.csv: No such file"),
        (("--rate", "0.04", "--valuation-date", "soon"), "must be a date"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_ends_with_2(
    tmp_path: Path, completed: Completed, options: tuple[str, ...], told: str
) -> None:
    found = completed("chain", SAMPLES / "generic.csv", tmp_path / "out", *options)
    assert found.returncode == 2
    assert told in found.stderr
    assert found.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
