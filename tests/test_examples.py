"""Every example runs, and prints what the README shows of it."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def without_errors(text: str) -> list[str]:
    """Return the lines without the stated errors, which any change of the engine may change."""
    return [re.sub(r"\+- [\d.e+-]+", "+-", line).strip() for line in text.splitlines()]


@pytest.mark.parametrize("name", ["price_one", "dividends_and_curves"])
def test_an_example_prints_what_the_readme_shows(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    printed = without_errors(capsys.readouterr().out)
    shown = without_errors((ROOT / "README.md").read_text(encoding="utf-8"))
    start = shown.index(printed[0])
    assert shown[start : start + len(printed)] == printed


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        # 10 minutes late, 2 minutes of slack an hour; 60 + 56 minutes for two trains.
        ("railway_timetable", ["shortest period 58 minutes, set by west and east", "for 5 hours"]),
        # 5 + 7 + 3 + 3 = 18 minutes for each pallet, 6 at the drill.
        ("production_line", ["      1                 18  saw -> drill", "with three pallets: 10"]),
    ],
)
def test_a_max_plus_example_prints_its_headline_numbers(
    name: str, lines: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    printed = capsys.readouterr().out
    for line in lines:
        assert line in printed
    assert (ROOT / "examples" / "out" / f"{name}.png").stat().st_size > 10_000
