import base64
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchmarks.reporting.files import write_report
from benchmarks.reporting.report import Report, Section, Table, table

PNG = b"\x89PNG\r\n\x1a\n"


def picture() -> Figure:
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return figure


def example() -> Report:
    rows = [{"method": "a | b", "error": 1.23456e-7, "time_steps": 12345}]
    rows.append({"method": "<i>", "error": math.nan, "time_steps": None})
    sections = (
        Section(
            "First",
            "Use `price`, 1 < 2.\n\nA second\nparagraph.",
            (table("errors", rows),),
            {"the-curve": picture()},
        ),
        Section("Second", "", (Table("one", ("x",), ((1.0,),)),)),
    )
    results = {"share": np.float64(0.5), "count": np.int64(3), "missing": math.nan, "list": [(1, math.inf)]}
    return Report("made-up", "A & B", "Which is better?", sections, results)


class Resources(HTMLParser):
    """Collects every address in a page, and the open elements left at its end."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [
            value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")
        ]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_all_files_are_written_and_named(tmp_path: Path) -> None:
    files = write_report(example(), tmp_path)
    assert {path.name for path in files} == {
        "made-up.json",
        "made-up.md",
        "made-up.html",
        "made-up-the-curve.png",
    }
    assert set(tmp_path.iterdir()) == set(files)
    assert (tmp_path / "made-up-the-curve.png").read_bytes().startswith(PNG)


def test_the_page_needs_no_other_resource(tmp_path: Path) -> None:
    write_report(example(), tmp_path)
    page = (tmp_path / "made-up.html").read_text()
    resources = Resources()
    resources.feed(page)
    assert resources.open == []
    (address,) = resources.addresses
    kind, data = address.split(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(data) == (tmp_path / "made-up-the-curve.png").read_bytes()
    assert not re.search(r"https?:|@import|<script", page)


def test_text_and_cells_are_escaped(tmp_path: Path) -> None:
    write_report(example(), tmp_path)
    page = (tmp_path / "made-up.html").read_text()
    assert "<h1>A &amp; B</h1>" in page
    assert "<p>Use <code>price</code>, 1 &lt; 2.</p>\n<p>A second paragraph.</p>" in page
    assert "<td>&lt;i&gt;</td>" in page
    assert r"| a \| b | 1.23e-07 | 12,345 |" in (tmp_path / "made-up.md").read_text()


def test_markdown_and_page_hold_the_same_cells_and_machine(tmp_path: Path) -> None:
    write_report(example(), tmp_path)
    page, twin = ((tmp_path / f"made-up.{ending}").read_text() for ending in ("html", "md"))
    for words in ("First", "Second", "A second paragraph.", "1.23e-07", "12,345", "numpy: ", "kernel: "):
        assert words in page
        assert words in twin
    assert "![the curve](made-up-the-curve.png)" in twin


def test_json_holds_results_machine_and_versions_without_nan(tmp_path: Path) -> None:
    write_report(example(), tmp_path)
    content = json.loads((tmp_path / "made-up.json").read_text(), parse_constant=pytest.fail)
    assert content["results"] == {
        "errors": [
            {"method": "a | b", "error": 1.23456e-7, "time steps": 12345},
            {"method": "<i>", "error": None, "time steps": None},
        ],
        "one": [{"x": 1.0}],
        "share": 0.5,
        "count": 3,
        "missing": None,
        "list": [[1, None]],
    }
    assert content["question"] == "Which is better?"
    assert {"cpu", "cores", "python", "numpy", "kernel", "pricing-core", "QuantLib"} <= content[
        "machine"
    ].keys()


def test_two_tables_of_one_name_are_refused() -> None:
    same = Table("same", ("a",), ())
    with pytest.raises(ValueError, match="equal"):
        Report("made-up", "", "", (Section("", "", (same, same)),))
