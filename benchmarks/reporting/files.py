"""The files that a report is written to: JSON, PNG, CSV, Markdown, and one self-contained HTML page."""

import csv
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.measuring.machine import machine_and_versions
from benchmarks.reporting.html_page import html
from benchmarks.reporting.markdown import markdown
from benchmarks.reporting.report import Report, Table
from pricing_core.replacement import replacement

DOTS_PER_INCH = 110


def write_report(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write the report into an existing folder and return the files.

    NAME.json (results, machine, versions), NAME.md, NAME.html, NAME-<figure>.png, and NAME-<table>.csv for
    every table with a name. Each file appears complete or not at all.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    machine = machine_and_versions()
    pictures = {name: _png(figure) for section in report.sections for name, figure in section.figures}
    tables = {
        table.name: _csv(table) for section in report.sections for table in section.tables if table.name
    }
    contents = {
        "json": _json(report, machine).encode(),
        "md": markdown(report, machine).encode(),
        "html": html(report, machine, pictures).encode(),
    }
    files = {f"{report.name}.{ending}": content for ending, content in contents.items()}
    files |= {f"{report.name}-{name}.png": content for name, content in pictures.items()}
    files |= {f"{report.name}-{name}.csv": content for name, content in tables.items()}
    for name, content in files.items():
        with replacement(folder / name) as file:
            file.write(content)
    return tuple(folder / name for name in files)


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DOTS_PER_INCH)
    return file.getvalue()


def _csv(table: Table) -> bytes:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(table.columns)
    rows.writerows(["" if _is_missing(cell) else cell for cell in row] for row in table.rows)
    return text.getvalue().encode()


def _json(report: Report, machine: Mapping[str, object]) -> str:
    content = {
        "name": report.name,
        "title": report.title,
        "question": report.question,
        "machine": machine,
        "results": report.results,
    }
    return json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"


def _plain(value: object) -> object:
    """Return the value in JSON's own types, with null for NaN and infinities."""
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if _is_missing(value) else value


def _is_missing(cell: object) -> bool:
    return cell is None or (isinstance(cell, float) and not math.isfinite(cell))
