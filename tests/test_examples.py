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
