"""Figures of README and documentation: JSON files that benchmarks write, and the places in the texts that show them.

A place is `<!--= NAME -->...<!--/-->` for the table of `docs/figures/NAME.json` with the line that says where it is
from, or `<!--= NAME.KEY -->...<!--/-->` for one of its single figures. What stands between the two is written by
`filled`.
"""

import json
import os
import re
import subprocess
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.measuring.machine import cpu_model, vector_instructions
from benchmarks.reporting.files import plain
from benchmarks.reporting.report import Cell, Table
from pricing_core.replacement import replacement

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "figures"
PLACE = re.compile(r"(<!--= (\S+) -->)(.*?)(<!--/-->)", re.DOTALL)
WIDTH = 119  # of lines of text; those of the README are shorter than 120
SOURCE = ("command", "machine", "date", "commit", "conditions")
UNITS = r"(?:us|ms|s|MB|GB|a second|times)"
NUMBER = r"[\d.,]*\d(?:e-?\d+)?"
# A cell that is a number, or has one with a unit that somebody measured.
FIGURE = re.compile(rf"(?:up to |about )?{NUMBER}(?: to {NUMBER})?(?: {UNITS}| of \d+)?$|.*\d {UNITS}\b")


@dataclass(frozen=True, slots=True)
class Figures:
    """What one measurement gave to the texts.

    Parameters
    ----------
    table : Table, optional
    formats : tuple of str, optional
        How the cells of each column are shown, as `str.format` takes it.
    single : mapping, optional
        Single figures: key to (value or values, format).
    """

    table: Table | None = None
    formats: tuple[str, ...] = ()
    single: Mapping[str, tuple[float | Sequence[float], str]] = field(default_factory=dict)


def source_of(command: str, conditions: str) -> dict[str, str]:
    """Return what was asked, where and when, for a measurement that is made now."""
    described = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
    commit = (
        subprocess.run(described, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
    )
    machine = f"{cpu_model()}, {vector_instructions()}, {os.cpu_count()} cores"
    today = date.today().isoformat()
    return dict(zip(SOURCE, (command, machine, today, commit, conditions), strict=True))


def write(name: str, found: Figures, source: Mapping[str, str], folder: Path = FOLDER) -> None:
    """Write one JSON file."""
    content: dict[str, Any] = dict(source)
    if found.table is not None:
        content |= {"columns": found.table.columns, "formats": found.formats, "rows": found.table.rows}
    content["figures"] = {key: {"value": value, "format": how} for key, (value, how) in found.single.items()}
    with replacement(folder / f"{name}.json") as file:
        file.write((json.dumps(plain(content), indent=1, allow_nan=False) + "\n").encode())


def filled(text: str, folder: Path = FOLDER) -> str:
    """Return the text with what the JSON files say at every place.

    Raises
    ------
    ValueError
        A place names a figure that there is not.
    """
    return PLACE.sub(lambda found: f"{found[1]}{_shown(found[2], folder)}{found[4]}", text)


def _shown(place: str, folder: Path) -> str:
    name, _, key = place.partition(".")
    try:
        content = json.loads((folder / f"{name}.json").read_text())
        if key:
            return shown(content["figures"][key]["value"], content["figures"][key]["format"])
        rows = [map(shown, row, content["formats"]) for row in content["rows"]]
        lines = [content["columns"], ["---"] * len(content["columns"]), *rows]
    except (OSError, KeyError) as fault:
        raise ValueError(f"there is no figure {place} in {folder}") from fault
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    told = f"(`{content['command']}`; {content['machine']}; {content['date']}; {content['conditions']})"
    return f"\n{table}\n\n{textwrap.fill(told, WIDTH, break_long_words=False, break_on_hyphens=False)}\n"


def shown(value: Cell | Sequence[Cell], how: str) -> str:
    """Return a cell, or several values in one, as the texts show it; exponents of one digit are written with one.

    Examples
    --------
    >>> shown(1.2e-5, "{:.1e}"), shown(4.53, "{:.2g} us"), shown([2, 3.5], "{} to {} ms"), shown(None, "{}")
    ('1.2e-5', '4.5 us', '2 to 3.5 ms', '')
    """
    if value is None:
        return ""
    text = how.format(*value) if isinstance(value, list | tuple) else how.format(value)
    return re.sub(r"e([-+])0", r"e\1", text).replace("e+", "e")


def without_source(text: str) -> Iterator[str]:
    """Yield the rows of tables with a figure, in any column but the first, that is in no place."""
    bare, in_code = PLACE.sub(" ", text), False
    for line in bare.splitlines():
        in_code ^= line.startswith("```")
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and not in_code and any(FIGURE.match(cell) for cell in cells[1:]):
            yield line
