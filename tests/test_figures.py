"""The figures of README and documentation are those of the JSON files that the benchmarks wrote."""

import json
from pathlib import Path

import pytest

from benchmarks.figures import MEASURED
from benchmarks.reporting.figures import (
    FOLDER,
    PLACE,
    ROOT,
    SOURCE,
    Figures,
    filled,
    source_of,
    without_source,
    write,
)
from benchmarks.reporting.report import Table

TEXTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FILES = sorted(FOLDER.glob("*.json"))


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_text_shows_what_the_files_say(path: Path) -> None:
    text = path.read_text()
    assert filled(text) == text, "run `.venv/bin/python -m benchmarks.figures --fill`"


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_figure_in_a_table_has_a_source(path: Path) -> None:
    assert list(without_source(path.read_text())) == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_says_where_its_figures_are_from(path: Path) -> None:
    content = json.loads(path.read_text())
    assert all(content[name] for name in SOURCE)
    assert {len(row) for row in content.get("rows", [])} <= {len(content.get("columns", []))}


def test_every_file_is_shown_somewhere_and_every_measurement_has_a_file() -> None:
    shown = {place.partition(".")[0] for path in TEXTS for _, place, *_ in PLACE.findall(path.read_text())}
    assert shown == {path.stem for path in FILES}
    assert set(MEASURED) <= shown


def test_every_table_that_was_measured_is_shown() -> None:
    shown = {place for path in TEXTS for _, place, *_ in PLACE.findall(path.read_text())}
    assert {path.stem for path in FILES if "rows" in json.loads(path.read_text())} <= shown


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table = Table("made-up", ("tolerance", "error"), ((1e-4, 1.24e-6), (1e-5, None)))
    found = Figures(table, ("{:.0e}", "{:.1e}"), {"1e-4.time": (1.26, "{:.1f} ms")})
    write("made-up", found, source_of("make it", "quiet"), tmp_path)
    return tmp_path


def test_places_are_filled_with_tables_and_single_figures(folder: Path) -> None:
    text = filled("It takes <!--= made-up.1e-4.time -->2.0 ms<!--/-->.\n<!--= made-up --><!--/-->", folder)
    assert text.startswith("It takes <!--= made-up.1e-4.time -->1.3 ms<!--/-->.\n")
    assert "| tolerance | error |\n| --- | --- |\n| 1e-4 | 1.2e-6 |\n| 1e-5 |  |" in text
    assert "(`make it`; " in text
    assert filled(text, folder) == text


@pytest.mark.parametrize("place", ["unknown", "made-up.unknown"])
def test_a_place_without_a_figure_is_refused(place: str, folder: Path) -> None:
    with pytest.raises(ValueError, match=f"no figure {place}"):
        filled(f"<!--= {place} --><!--/-->", folder)


@pytest.mark.parametrize(
    "cell", ["1.3 ms", "80,000 a second", "2.5", "1e-6", "3 to 4", "up to 5.5", "it takes 2 s"]
)
def test_a_figure_in_a_table_without_a_place_is_found(cell: str) -> None:
    row = f"| what | {cell} |"
    assert list(without_source(row)) == [row]
    assert list(without_source(f"| what | <!--= made-up.figure -->{cell}<!--/--> |")) == []


@pytest.mark.parametrize("cell", ["`10.0`", "of a /v1 route", "up to 60 unknowns", "status 422"])
def test_other_numbers_in_tables_need_no_source(cell: str) -> None:
    assert list(without_source(f"| 400 | {cell} |")) == []
