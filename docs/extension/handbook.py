"""The table of everything that the handbook tells of, made from its pages."""

import re
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ROW = re.compile(r"^\| (\(11\.\d+\)|\w+ 11\.\d) \| (.+?) \| (.*?) \| .*\|$", re.MULTILINE)


class Handbook(SphinxDirective):
    """`{handbook}`: every numbered item of the pages beside this one, with its page and what computes it."""

    def run(self) -> list[nodes.Node]:
        """Return the table, in the order in which the pages are listed."""
        folder = Path(self.env.doc2path(self.env.docname)).parent
        text = (folder / "index.md").read_text(encoding="utf-8")
        lines = ["| item | what it says | computed by |", "|---|---|---|"]
        for name in re.findall(r"^(\w+)$", text.split("{toctree}")[1], re.MULTILINE):
            page = folder / f"{name}.md"
            self.env.note_dependency(str(page))
            for item, says, computed in ROW.findall(page.read_text(encoding="utf-8")):
                lines.append(f"| [{item}]({name}.md) | {says} | {computed} |")
        return self.parse_text_to_nodes("\n".join(lines))
