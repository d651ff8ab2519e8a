"""What the site needs beyond Sphinx: formulas as MathML, tables made from other texts, examples with output."""

import ast
import os
import re
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive, directives
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.util.typing import OptionSpec
from sphinx.writers.html5 import HTML5Translator

from extension.handbook import Handbook
from extension.vocabulary import TABLES

EXAMPLES = Path(__file__).parents[2] / "examples"
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


class Example(SphinxDirective):
    """`{example} 01_first_put`: a script of `examples/`, what it prints and draws; `make examples` has run it.

    With the option `output`: what it prints alone; with `picture`: what it draws.
    """

    required_arguments = 1
    option_spec: ClassVar[OptionSpec] = {"output": directives.flag, "picture": directives.flag}

    def run(self) -> list[nodes.Node]:
        """Return what the script says that it shows, the script, its output and its picture."""
        name = self.arguments[0]
        script, printed = EXAMPLES / f"{name}.py", EXAMPLES / "out" / f"{name}.txt"
        if not script.is_file() or not printed.is_file():
            raise self.error(f"examples/{name}.py is not there, or has not been run: make examples")
        for path in (script, printed):
            self.env.note_dependency(str(path))
        output = _literal(printed.read_text(encoding="utf-8").strip(), "text")
        if "output" in self.options:
            return [output]
        says = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
        picture = self._picture(name, says.partition("\n")[0])
        if "picture" in self.options:
            return picture
        source = script.read_text(encoding="utf-8")
        paragraphs = [part for part in says.split("\n\n") if not part.startswith("Run it from")]
        code = source[source.index('"""', 3) + 3 :].strip()
        command = nodes.literal("", f".venv/bin/python examples/{name}.py")
        return [
            *self.parse_text_to_nodes("\n\n".join(paragraphs)),
            nodes.paragraph("", "", command, nodes.Text(" prints")),
            output,
            *picture,
            nodes.paragraph("", "The script:"),
            _literal(code, "python"),
        ]

    def _picture(self, name: str, says: str) -> list[nodes.Node]:
        picture = EXAMPLES / "out" / f"{name}.png"
        if not picture.is_file():
            return []
        place = os.path.relpath(picture, Path(self.env.doc2path(self.env.docname)).parent)
        return [nodes.image(uri=place, alt=says.rstrip("."), width="100%")]


def _literal(text: str, language: str) -> nodes.literal_block:
    return nodes.literal_block(text, text, language=language)


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


def _let_paths_break(app: Sphinx, page: nodes.document) -> None:
    """Let the paths in tables break after slashes and underscores."""
    for entry in page.findall(nodes.entry):
        for code in entry.findall(nodes.literal):
            if "/" in (path := code.astext()):
                parts = re.split(r"(?<=[/_])", path)
                code.clear()
                for part in parts:
                    code += [nodes.Text(part), nodes.raw("", "<wbr>", format="html")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx of all this."""
    app.add_directive("vocabulary", Vocabulary)
    app.add_directive("example", Example)
    app.add_directive("handbook", Handbook)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("autodoc-process-docstring", _keep_bars, priority=100)
    app.connect("doctree-read", _let_paths_break)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
