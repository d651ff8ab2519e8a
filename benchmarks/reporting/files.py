"""The files that a report is written to: JSON, PNG, Markdown, and one HTML page that needs nothing else."""

import io
import json
import math
import re
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from benchmarks.measuring.machine import machine_and_versions
from benchmarks.reporting.report import Report, cell_text
from pricing_core.replacement import replacement

DOTS_PER_INCH = 110
TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=select_autoescape(["html.j2"]),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
)
TEMPLATES.filters |= {
    "cell": cell_text,
    "prose": lambda text: Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text)))),
    "base64": lambda content: b64encode(content).decode("ascii"),
}


def write_report(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write NAME.json, NAME.md, NAME.html and NAME-FIGURE.png into an existing folder, each complete or not at all.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    pictures = {name: _png(figure) for name, figure in report.figures.items()}
    files = {f"{report.name}.json": _json(report).encode()}
    files |= {
        f"{report.name}.{ending}": rendered(report, ending, pictures).encode() for ending in ("md", "html")
    }
    files |= {f"{report.name}-{name}.png": content for name, content in pictures.items()}
    for name, content in files.items():
        with replacement(folder / name) as file:
            file.write(content)
    return tuple(folder / name for name in files)


def rendered(report: Report, ending: str, pictures: Mapping[str, bytes] | None = None) -> str:
    """Return the report as "md", or as "html" with the PNG image of every figure by its name."""
    template = TEMPLATES.get_template(f"report.{ending}.j2")
    return template.render(report=report, machine=machine_and_versions(), pictures=pictures)


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DOTS_PER_INCH)
    return file.getvalue()


def _json(report: Report) -> str:
    head = {name: getattr(report, name) for name in ("name", "title", "question")}
    content = plain({**head, "machine": machine_and_versions(), "results": report.results})
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def plain(value: object) -> object:
    """Return the value in JSON's own types, with null for NaN and infinities."""
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
