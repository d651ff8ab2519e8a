"""A report as one HTML file that needs nothing else: figures are embedded, styles are inside."""

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping
from html import escape

from benchmarks.reporting.report import Report, Section, Table, cell_text, is_numeric

STYLE = """
body { max-width: 75rem; margin: 2rem auto; padding: 0 1rem; color: #1c2733; background: #fff;
       font: 16px/1.5 system-ui, sans-serif; }
h1, h2 { line-height: 1.2; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #d5dbe1; padding-bottom: .3rem; }
p, ul { max-width: 60rem; }
.question { font-size: 1.15rem; color: #46525e; }
.table { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .9rem; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #e3e7eb; text-align: left; vertical-align: top; }
th { border-bottom: 2px solid #9aa5b1; vertical-align: bottom; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; height: auto; }
"""
# The browser itself refuses whatever would have to be fetched.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def html(report: Report, machine: Mapping[str, object], pictures: Mapping[str, bytes]) -> str:
    """Return the page.

    Parameters
    ----------
    pictures : mapping
        The PNG image of every figure, by its name.
    """
    title = escape(report.title)
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
        '<meta name="viewport" content="width=device-width">',
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>",
        f'<h1>{title}</h1>\n<p class="question">{_prose(report.question)}</p>',
    ]
    for section in report.sections:
        parts += _section(section, pictures)
    parts += ["<h2>Machine and versions</h2>\n<ul>"]
    parts += [f"<li>{escape(f'{key}: {value}')}</li>" for key, value in machine.items()]
    return "\n".join([*parts, "</ul>\n</body>\n</html>\n"])


def _section(section: Section, pictures: Mapping[str, bytes]) -> Iterator[str]:
    yield f"<h2>{escape(section.title)}</h2>"
    yield from (f"<p>{_prose(paragraph)}</p>" for paragraph in section.paragraphs)
    for name, _ in section.figures:
        data = b64encode(pictures[name]).decode("ascii")
        alternative = escape(name.replace("-", " "))
        yield f'<figure><img alt="{alternative}" src="data:image/png;base64,{data}"></figure>'
    for table in section.tables:
        yield from _table(table)


def _table(table: Table) -> Iterator[str]:
    kinds = [' class="number"' if is_numeric(table, i) else "" for i in range(len(table.columns))]
    head = (f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, table.columns, strict=True))
    yield f'<div class="table"><table>\n<tr>{"".join(head)}</tr>'
    for row in table.rows:
        cells = (f"<td{kind}>{escape(cell_text(cell))}</td>" for kind, cell in zip(kinds, row, strict=True))
        yield f"<tr>{''.join(cells)}</tr>"
    yield "</table></div>"


def _prose(text: str) -> str:
    """Escape the text; what stands in backticks becomes code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))
