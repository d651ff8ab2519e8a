"""What the site needs beyond Sphinx: formulas as MathML, tables of the vocabulary, output of examples."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.writers.html5 import HTML5Translator

from extension.vocabulary import TABLES

ROOT = Path(__file__).parents[2]
BARS = re.compile(
    r"(?<!`)\|(?!`)"
)  # a bar outside of code, which is an absolute value or the sign of complementarity


class Vocabulary(Directive):
    """`{vocabulary} inputs`: the names that are stated, or `outputs`, those that are answered."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        head, rows = TABLES[self.arguments[0]]()
        widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
        group = nodes.tgroup(cols=len(head))
        group += [nodes.colspec(colwidth=min(width, 60)) for width in widths]
        group += nodes.thead("", _row(head))
        group += nodes.tbody("", *(_row(row) for row in rows))
        return [nodes.table("", group, classes=["vocabulary"])]


class Output(Directive):
    """`{output} examples/price_one.py`: what the script prints, run when the site is built."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the output as it is."""
        command = [sys.executable, self.arguments[0]]
        ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if ran.returncode != 0:
            raise ExtensionError(f"{self.arguments[0]} ended with status {ran.returncode}: {ran.stderr}")
        text = ran.stdout.strip()
        return [nodes.literal_block(text, text, language="text")]


def _row(cells: tuple[str, ...]) -> nodes.row:
    name, *rest = cells
    first = nodes.literal(name, name) if name.isidentifier() and name.islower() else nodes.Text(name)
    texts = [nodes.paragraph("", "", first), *(nodes.paragraph(cell, cell) for cell in rest)]
    return nodes.row("", *(nodes.entry("", text) for text in texts))


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def _keep_bars(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep bars in docstrings from being read as references to substitutions."""
    lines[:] = [line if line.lstrip().startswith(">>>") else BARS.sub(r"\\|", line) for line in lines]


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx of all this."""
    app.add_directive("vocabulary", Vocabulary)
    app.add_directive("output", Output)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("autodoc-process-docstring", _keep_bars, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
