"""The command in a process of its own and in this one: what every subcommand prints, and how it fails."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from app.cli import app
from pricing_core import __version__, kernel_name
from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    exercise_advice,
    exercise_boundary,
    implied_volatility,
    price,
)
from pricing_core.american.contracts.result_fields import (
    GREEK_ERROR_FIELDS,
    IMPLIED_VOLATILITY_FIELDS,
    PRICE_FIELDS,
    price_fields,
)
from tests.problems.engine_with_errors import ERRORS

NAMES = [field.name for field in PRICE_FIELDS]
PLAIN = [field.name for field in price_fields("standard", [])]
IMPLIED = [field.name for field in IMPLIED_VOLATILITY_FIELDS]
EXTENDED = [name for name in NAMES if name not in PLAIN]
PUT = ["--option-type", "put", "--spot", "100", "--strike", "100", "--expiry", "1", "--rate", "0.05"]
PUT += ["--volatility", "0.2", "--tolerance", "1e-3"]
UNDATED = [
    "--option-type",
    "put",
    "--spot",
    "100",
    "--strike",
    "100",
    "--rate",
    "0.05",
    "--volatility",
    "0.2",
]
PNG = b"\x89PNG\r\n\x1a\n"


def run(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, as a shell does."""
    command = [sys.executable, "-m", "app", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, **options)


def test_version_names_the_distribution_and_the_kernel() -> None:
    found = run("--version")
    assert (found.returncode, found.stdout) == (0, f"pricing {__version__} (kernel: {kernel_name()})\n")


def test_price_prints_every_result_with_its_unit() -> None:
    found = run("price", *PUT)
    assert (found.returncode, found.stderr) == (0, "")
    first_words = [line.split()[0] for line in found.stdout.splitlines()]
    assert first_words == ["result", *PLAIN]
    assert "money per 0.01 of volatility" in found.stdout


def test_price_as_json_is_the_library_s_valuation(pricing: Any) -> None:
    status, output, errors = pricing(
        "price", *PUT, "--dividend-yield", "0.02", "--exercise", "american", "--json"
    )
    valuation = price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.02), tolerance=1e-3)
    assert (status, errors) == (0, "")
    assert json.loads(output) == {name: getattr(valuation, name) for name in NAMES}
    assert all(json.loads(output)[name] is None for name in EXTENDED)


def test_the_default_tolerance_is_the_library_s(pricing: Any) -> None:
    without = [word for word in PUT if word not in ("--tolerance", "1e-3")]
    found = json.loads(pricing("price", *without, "--json")[1])
    assert found["price"] == price(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)).price


def test_a_missing_number_is_null_in_json_and_a_dash_in_the_table(pricing: Any) -> None:
    european = [*PUT, "--exercise", "european"]
    assert json.loads(pricing("price", *european, "--json")[1])["exercise_boundary"] is None
    line = next(
        line for line in pricing("price", *european)[1].splitlines() if line.startswith("exercise_boundary")
    )
    assert line.split()[1] == "-"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "command"),
        (["nonsense"], "nonsense"),
        (["price"], "--option-type"),
        (["price", *PUT, "--volatility", "-0.2"], "volatility = -0.2: must be a number from 0 to 15"),
        (["price", *PUT, "--spot", "nan"], "spot"),
        (["price", *PUT, "--spot", "inf"], "spot"),
        (["price", *PUT, "--strike", "0"], "strike"),
        (["price", *PUT, "--expiry", "-1"], "expiry"),
        (["price", *PUT, "--strike", "abc"], "--strike"),
        (["price", *PUT, "--strike", "1_0"], "'1_0' must be a number such as 0.05 or 5e-2"),
        (["boundary", *PUT, "--time", "0_5"], "'0_5' must be a number such as 0.05 or 5e-2"),
        (["boundary", *PUT, "--tolerance", "\uff11"], "--tolerance"),
        (["price", *PUT, "--option-type", "straddle"], 'must be "put" or "call"'),
        (["price", *PUT, "--exercise", "bermudan"], "exercise"),
        (["price", *PUT, "--greeks", "all"], 'greeks = \'all\': must be "none", "standard" or "extended"'),
        (["batch", "in.csv", "out.csv", "--greeks", "no"], 'must be "none", "standard" or "extended"'),
        (["price", *PUT, "--tolerance", "1"], "tolerance"),
        (["price", *PUT, "--cash-dividend", "0.25"], "'0.25' must be TIME:AMOUNT or TIME:FRACTION"),
        (
            ["price", *PUT, "--cash-dividend", "x:1"],
            "'x:1': the time 'x' must be a number of years, or an ISO",
        ),
        (
            ["price", *PUT, "--cash-dividend", "0.25:"],
            "'0.25:': behind the time, '' must be a number such as",
        ),
        (["price", *PUT, "--cash-dividend", "0.25:one"], "'one' must be a number such as 0.05 or 5e-2"),
        (
            ["price", *PUT, "--cash-dividend", "0.25:1", "--cash-dividend", "1:-1"],
            "cash_dividends[1].amount = -1.0",
        ),
        (["price", *PUT, "--cash-dividend", "2026-03-01:1"], "cash_dividends[0].ex_date = '2026-03-01'"),
        (["boundary", *PUT, "--proportional-dividend", "0.5:2"], "proportional_dividends[0].fraction = 2.0"),
        (["price", *PUT, "--dividend-model", "other"], "dividend_model = 'other': must be"),
        (["price", *PUT, "--exercise-time", "0.5"], "exercise_times = [0.5]: must be empty unless"),
        (["price", *PUT, "--exercise-start", "2"], "exercise_start = 2.0: must be at most the expiry, 1"),
        (["price", *PUT, "--rate", '{"times": [1]'], "rate = '{\"times\": [1]': must be a number or"),
        (["price", *PUT, "--volatility", '{"times": [1], "values": [-1]}'], "volatility.values = -1.0"),
        (
            ["price", *PUT, "--valuation-date", "2026-01-01"],
            "expiry = 1.0: must be left out where dates are given",
        ),
        (["price", *UNDATED], "expiry is missing: give it, or valuation_date and expiration_date"),
        (["price", *UNDATED, "--valuation-date", "2026-01-01"], "expiration_date is missing"),
        (
            ["implied-volatility", *PUT],
            "option_price is missing: give option_price alone, or both bid and ask",
        ),
        (["implied-volatility", *PUT, "--bid", "1_0"], "'1_0' must be a number"),
        (["price", *PUT, "--option-type", "put\nor\ncall"], "option_type"),
        (["boundary", *PUT, "--plot", "boundary.svg"], ".png"),
        (["boundary", *PUT, "--time", "2"], "times"),
        (["boundary", *PUT, "--csv", "both.png", "--plot", "./both.png"], "another file"),
        (["boundary", *PUT, "--plot", "nowhere/boundary.png"], "nowhere"),
        (["boundary", *PUT, "--csv", "/nowhere/at/all.csv"], "/nowhere/at"),
        (["batch"], "INPUT"),
        (["batch", "/nowhere/in.csv", "out.csv"], "/nowhere/in.csv"),
        (["batch", "in.csv", "out.csv", "--threads", "0"], "--threads"),
        (["serve", "--port", "70000"], "--port"),
        (["serve", "--host", "256.0.0.1", "--port", "0"], "--host = '256.0.0.1': must be an address"),
        (["serve", "--host", "192.0.2.1", "--port", "0"], "host 192.0.2.1, port 0: Cannot assign"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(
    pricing: Any, arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status, output, errors = pricing(*arguments)
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 1
    assert errors.startswith("pricing: ")
    assert words in errors
    assert list(tmp_path.iterdir()) == []


def test_a_bad_setting_is_one_line_and_status_2(pricing: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRICING_SLOTS", "none")
    status, _, errors = pricing("serve", "--port", "0")
    assert status == 2
    assert len(errors.splitlines()) == 1
    assert errors == "pricing: PRICING_SLOTS = 'none': must be a valid integer\n"


@pytest.mark.parametrize("files", [["--plot", "boundary.svg"], ["--csv", "/nowhere/at/all.csv"]])
def test_the_files_of_a_boundary_are_checked_before_it_is_found(
    pricing: Any, monkeypatch: pytest.MonkeyPatch, files: list[str]
) -> None:
    def exercise_boundary(*_: object, **__: object) -> None:
        pytest.fail("computed for nothing")

    monkeypatch.setattr("pricing_core.american.exercise_boundary", exercise_boundary)
    assert pricing("boundary", *PUT, *files)[0] == 2


@pytest.mark.parametrize(
    "arguments",
    [
        ["price", *PUT],
        ["price", *PUT, "--json"],
        ["boundary", *PUT, "--exercise", "european"],
        ["boundary", *PUT, "--exercise", "european", "--json"],
    ],
)
def test_a_closed_pipe_ends_a_command_quietly_as_the_signal_would(arguments: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "app", *arguments]
    with os.fdopen(writing, "wb") as output:
        found = subprocess.run(
            command, stdout=output, stderr=subprocess.PIPE, text=True, timeout=120, check=False
        )
    assert (found.returncode, found.stderr) == (141, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_an_answer_that_cannot_be_written_is_one_line_and_status_2() -> None:
    command = [sys.executable, "-m", "app", "price", *PUT]
    with open("/dev/full", "wb") as output:
        found = subprocess.run(
            command, stdout=output, stderr=subprocess.PIPE, text=True, timeout=120, check=False
        )
    assert (found.returncode, found.stderr) == (2, "pricing: standard output: No space left on device\n")


def test_a_defect_is_one_line_too(pricing: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def price(*_: object, **__: object) -> None:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("pricing_core.american.price", price)
    status, _, errors = pricing("price", *PUT)
    assert (status, len(errors.splitlines())) == (2, 1)


def test_help_is_quick_because_numerical_libraries_wait() -> None:
    heavy = ("numpy", "scipy", "pyarrow", "fastapi")
    code = f"import app.cli, sys; print([name for name in {heavy} if name in sys.modules])"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert found.stdout == "[]\n"


def test_boundary_in_its_three_forms_agrees_with_the_library(tmp_path: Path) -> None:
    picture, table = tmp_path / "boundary.png", tmp_path / "boundary.csv"
    arguments = ["boundary", *PUT, "--time", "0", "--time", "0.5"]
    found = CliRunner().invoke(app, [*arguments, "--csv", str(table), "--plot", str(picture), "--json"])
    expected = exercise_boundary(
        Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), [0.0, 0.5], tolerance=1e-3
    )
    assert found.exit_code == 0
    body = json.loads(found.stdout)
    assert body["boundary"] == expected.boundary.tolist()
    assert (body["time"], body["other_boundary"]) == ([0.0, 0.5], None)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["boundary"]) for row in rows] == expected.boundary.tolist()
    assert [row["other_boundary"] for row in rows] == ["", ""]
    assert body["error_estimate"] == expected.error_estimate.tolist()
    assert [float(row["error_estimate"]) for row in rows] == expected.error_estimate.tolist()
    assert picture.read_bytes().startswith(PNG)


def test_advice_in_its_three_forms_agrees_with_the_library(pricing: Any, tmp_path: Path) -> None:
    expected = exercise_advice(
        Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), [0.5, 1.0], tolerance=1e-3
    )
    arguments = ["advice", *PUT, "--time", "0.5", "--time", "1"]
    status, output, _ = pricing(*arguments)
    assert status == 0
    assert [line.split()[1] for line in output.splitlines()[1:3]] == [
        "no",
        f"{expected.exercise_boundary:.10g}",
    ]
    assert [float(line.split()[1]) for line in output.splitlines()[-2:]] == pytest.approx(
        expected.cumulative_probability, rel=1e-9
    )
    picture = tmp_path / "advice.png"
    status, output, _ = pricing(*arguments, "--json", "--plot", str(picture))
    assert status == 0
    assert json.loads(output)["cost_of_waiting"] == expected.cost_of_waiting.tolist()
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    "more",
    [
        ["--exercise", "european"],
        ["--cash-dividend", "0.5:2"],
        ["--exercise", "bermudan", "--exercise-time", "0.5"],
    ],
)
def test_every_advice_is_drawn(pricing: Any, tmp_path: Path, more: list[str]) -> None:
    picture = tmp_path / "advice.png"
    assert pricing("advice", *PUT, *more, "--plot", str(picture))[:2] == (0, "")
    assert picture.read_bytes().startswith(PNG)


def test_advice_without_early_exercise_has_no_expected_time(pricing: Any) -> None:
    body = json.loads(pricing("advice", *PUT, "--exercise", "european", "--json")[1])
    assert (body["probability"], body["expected_time"], body["exercise_boundary"]) == (0.0, None, None)


def test_boundary_prints_a_table_with_units_where_no_form_is_asked_for(pricing: Any) -> None:
    status, output, _ = pricing("boundary", *PUT, "--exercise", "european", "--time", "0.25")
    lines = output.splitlines()
    assert status == 0
    assert "boundary (money)" in lines[0]
    assert "error_estimate (money)" in lines[0]
    assert lines[1].split() == ["0.25", "0.75", "-", "-"]


def test_a_boundary_that_is_nowhere_is_not_drawn(pricing: Any, tmp_path: Path) -> None:
    picture, table = tmp_path / "boundary.png", tmp_path / "boundary.csv"
    files = ["--plot", str(picture), "--csv", str(table)]
    status, output, errors = pricing("boundary", *PUT, "--exercise", "european", *files)
    assert (status, output, len(errors.splitlines())) == (2, "", 1)
    assert "there is no exercise boundary to draw" in errors
    assert (picture.exists(), table.exists()) == (False, True)


EVENTS = ["--cash-dividend", "0.5:1.5", "--cash-dividend", "0.25:2", "--proportional-dividend", "0.75:0.01"]
EVENTS += ["--dividend-model", "escrowed", "--exercise", "bermudan", "--exercise-time", "0.5"]
EVENTS += ["--exercise-time", "0.25", "--volatility", '{"times": [0.5, 1], "values": [0.2, 0.3]}']
CONTRACT = (
    Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5)),
    Market(
        100.0,
        0.05,
        PiecewiseConstant((0.5, 1.0), (0.2, 0.3)),
        0.0,
        (CashDividend(0.25, 2.0), CashDividend(0.5, 1.5)),
        (ProportionalDividend(0.75, 0.01),),
        "escrowed",
    ),
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Keep what the engine is asked, and let it answer with extended Greeks."""
    questions: list[Any] = []
    extended = {
        "vanna": 0.5,
        "volga": 2.0,
        "volatility_buckets": (1.0, 2.5),
        "dividend_sensitivities": (0.25, 0.5),
    }

    def answer(*arguments: object, **options: object) -> object:
        questions.append((*arguments, options))
        return SimpleNamespace(**dict.fromkeys(NAMES) | dict.fromkeys(PLAIN, 1.0) | extended)

    monkeypatch.setattr("pricing_core.american.price", answer)
    return questions


def test_events_reach_the_engine(pricing: Any, asked: list[Any]) -> None:
    status, _, errors = pricing("price", *PUT, *EVENTS)
    assert (status, errors) == (0, "")
    assert asked == [(*CONTRACT, {"tolerance": 1e-3, "greeks": "standard"})]


def test_dates_and_ex_dates_are_read(pricing: Any, asked: list[Any]) -> None:
    dates = ["--valuation-date", "2026-01-01T00:00Z", "--expiration-date", "2027-01-01T00:00Z"]
    pricing(
        "price", *UNDATED, *dates, "--cash-dividend", "2026-03-15T02:00+02:00:1.5", "--exercise-start", "0.5"
    )
    (option, market, _), *_ = asked
    assert option == Option("put", 100.0, 1.0, exercise_start=0.5)
    assert market == Market(100.0, 0.05, 0.2, cash_dividends=(CashDividend(0.2, 1.5),))


def test_exercise_times_may_be_dates_where_there_are_dates(pricing: Any, asked: list[Any]) -> None:
    dates = ["--valuation-date", "2026-01-01", "--expiration-date", "2027-01-01"]
    times = ["--exercise", "bermudan", "--exercise-time", "2026-03-15", "--exercise-time", "0.5"]
    assert pricing("price", *UNDATED, *dates, *times)[0] == 0
    assert pricing("price", *UNDATED, *dates, "--exercise-start", "2026-03-15")[0] == 0
    assert [option for option, *_ in asked] == [
        Option("put", 100.0, 1.0, "bermudan", (0.2, 0.5)),
        Option("put", 100.0, 1.0, exercise_start=0.2),
    ]


def test_extended_greeks_are_printed_where_they_are_there(pricing: Any, asked: list[Any]) -> None:
    lines = pricing("price", *PUT, "--greeks", "extended")[1].splitlines()
    assert asked[0][-1]["greeks"] == "extended"
    shown = {line.split()[0]: line for line in lines[len(PLAIN) + 1 :]}
    assert list(shown) == ["dividend_sensitivities", "vanna", "volga", "volatility_buckets"]
    assert "1, 2.5" in shown["volatility_buckets"]
    body = json.loads(pricing("price", *PUT, "--greeks", "extended", "--json")[1])
    assert body["dividend_sensitivities"] == [0.25, 0.5]
    assert body["rate_buckets"] is None


def test_greeks_that_were_not_asked_for_are_null_and_not_printed(pricing: Any) -> None:
    without = [*PUT, "--greeks", "none"]
    names = [field.name for field in price_fields("none")]
    assert [line.split()[0] for line in pricing("price", *without)[1].splitlines()] == ["result", *names]
    found = json.loads(pricing("price", *without, "--json")[1])
    assert [name for name in NAMES if found[name] is not None] == names


def test_errors_of_greeks_are_printed_beside_them(pricing: Any, engine_with_errors: None) -> None:
    asked = ["price", *PUT, "--cash-dividend", "0.5:1", "--greeks", "extended", "--greek-errors"]
    heading, *lines = pricing(*asked)[1].splitlines()
    assert heading.split() == ["result", "value", "error", "unit"]
    cells = {line.split()[0]: line.split()[1:] for line in lines}
    expected = ERRORS | {"dividend_sensitivities": 2e-5}
    for field in PRICE_FIELDS:
        if field.is_greek and field.name in cells:
            assert cells[field.name][1] == (f"{expected[field.name]:.10g}" if field.name in expected else "-")
    assert cells["theta_per_day"][1:] == ["money/day"]
    assert cells["exercise_boundary"][1] == "-"  # this engine knows no boundary
    assert "error" not in pricing(*asked[:-1])[1].splitlines()[0]
    body = json.loads(pricing(*asked, "--json")[1])
    assert {f.of: body[f.name] for f in GREEK_ERROR_FIELDS if body[f.name] is not None} == expected | {
        "dividend_sensitivities": [2e-5]
    }
    assert list(json.loads(pricing(*asked[:-1], "--json")[1])) == NAMES


def test_a_boundary_may_have_dates(pricing: Any) -> None:
    dates = ["--valuation-date", "2026-01-01", "--expiration-date", "2027-01-01", "--tolerance", "1e-3"]
    dated = pricing("boundary", *UNDATED, *dates, "--time", "0.5", "--json")
    assert dated == pricing("boundary", *PUT, "--time", "0.5", "--json")


def test_an_implied_volatility_is_that_of_the_library(pricing: Any) -> None:
    without = PUT[: PUT.index("--volatility")]
    status, output, _ = pricing("implied-volatility", *without, "--option-price", "6.09", "--json")
    found = implied_volatility(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), 6.09)
    assert status == 0
    assert json.loads(output) == {name: getattr(found, name) for name in IMPLIED}
    quote = ["--bid", "6.08", "--ask", "6.1"]
    lines = pricing("implied-volatility", *without, *quote)[1].splitlines()
    assert [line.split()[0] for line in lines] == ["result", *IMPLIED]
    assert float(lines[1].split()[1]) == pytest.approx(0.2, abs=1e-3)


def test_no_implied_volatility_is_one_line_and_status_2(pricing: Any) -> None:
    status, output, errors = pricing("implied-volatility", *PUT, "--option-price", "101", "--json")
    assert (status, json.loads(output)["volatility"]) == (2, None)
    assert errors == (
        "pricing: there is no implied volatility: above_upper_bound: the price must be below 100, "
        "what the option is worth at the largest volatility; it is 101\n"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--option-price", "200"],
            "above_upper_bound: the price must be below 100, what the option is worth",
        ),
        (
            ["--bid", "150", "--ask", "250"],
            "above_upper_bound: the price must be below 100, what the option is worth",
        ),
        (
            ["--spot", "90", "--option-price", "9"],
            "below_lower_bound: the price must be at least 10, what the option",
        ),
        (
            ["--spot", "50", "--option-price", "50"],
            "not_identifiable: the price must be above 50, what the option",
        ),
        (
            ["--exercise", "european", "--cash-dividend", "0.5:1", "--option-price", "96"],
            "above_upper_bound: the price must be below 95.12294245, what",
        ),
    ],
)
def test_the_bound_that_a_price_lies_beyond_is_told_and_no_table(
    pricing: Any, arguments: list[str], words: str
) -> None:
    quoted = [word for word in PUT if word not in ("--volatility", "0.2")]
    status, output, errors = pricing("implied-volatility", *quoted, *arguments)
    assert (status, output, len(errors.splitlines())) == (2, "", 1)
    assert words in errors


@pytest.mark.parametrize(
    ("command", "required"),
    [
        ("price", {"--option-type", "--strike", "--rate", "--spot", "--volatility"}),
        ("boundary", {"--option-type", "--strike", "--rate", "--volatility"}),
        ("implied-volatility", {"--option-type", "--strike", "--rate", "--spot"}),
    ],
)
def test_help_marks_what_is_required(command: str, required: set[str]) -> None:
    text = CliRunner().invoke(app, [command, "--help"]).stdout
    options = ["--" + part for part in text.split("\n  --")[1:]]
    assert {part.split()[0] for part in options if "[required]" in part} == required
    assert ("--volatility FLOAT" in text) == (command != "implied-volatility")
