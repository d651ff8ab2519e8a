"""A report as Markdown; its figures are files beside it."""

from collections.abc import Iterator, Mapping

from benchmarks.reporting.report import Report, Section, Table, cell_text, is_numeric


def markdown(report: Report, machine: Mapping[str, object]) -> str:
    """Return the report; figure NAME is looked for in the file `<report>-NAME.png`."""
    parts = [f"# {report.title}", report.question]
    for section in report.sections:
        parts += _section(report.name, section)
    parts += ["## Machine and versions", "\n".join(f"- {key}: {value}" for key, value in machine.items())]
    return "\n\n".join(parts) + "\n"


def _section(report_name: str, section: Section) -> Iterator[str]:
    yield f"## {section.title}"
    yield from section.paragraphs
    for name, _ in section.figures:
        yield f"![{name.replace('-', ' ')}]({report_name}-{name}.png)"
    for table in section.tables:
        yield _table(table)


def _table(table: Table) -> str:
    alignment = ["--:" if is_numeric(table, i) else ":--" for i in range(len(table.columns))]
    rows = [table.columns, alignment, *([cell_text(cell) for cell in row] for row in table.rows)]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows)
