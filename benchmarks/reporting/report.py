"""The parts of a report, the answer of a benchmark to its question: sections of sentences, tables and figures."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from matplotlib.figure import Figure

Cell: TypeAlias = str | float | int | None


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells under column names; None and NaN are shown as empty."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @property
    def numeric(self) -> tuple[bool, ...]:
        """For every column, whether it holds numbers, and nothing but numbers and empty cells."""
        columns = ([cell for cell in column if cell is not None] for column in zip(*self.rows, strict=True))
        return tuple(bool(cells) and not any(isinstance(cell, str) for cell in cells) for cells in columns)

    def __str__(self) -> str:
        """Return the table in columns, for a terminal."""
        lines = [self.columns, *(tuple(map(cell_text, row)) for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join("  ".join(map(str.rjust, line, widths)) for line in lines)

    @property
    def records(self) -> list[dict[str, Cell]]:
        """The rows as a program would read them, by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


def table(name: str, records: Iterable[Any]) -> Table:
    """Return the table of named tuples or mappings, whose fields are its columns."""
    rows = [dict(one) if isinstance(one, Mapping) else one._asdict() for one in records]
    columns = tuple(name.replace("_", " ") for name in (rows[0] if rows else ()))
    return Table(name, columns, tuple(tuple(row.values()) for row in rows))


@dataclass(frozen=True, slots=True)
class Section:
    """A titled part; blank lines separate the paragraphs of `text`, backticks enclose code; figures by name."""

    title: str
    text: str
    tables: tuple[Table, ...] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)

    @property
    def paragraphs(self) -> list[str]:
        """The paragraphs of `text`, each on one line."""
        return [" ".join(part.split()) for part in re.split(r"\n\s*\n", self.text) if part.strip()]


@dataclass(frozen=True, slots=True)
class Report:
    """The answer to one question; `more` is what a program would read beside the tables, of plain JSON values."""

    name: str
    title: str
    question: str
    sections: tuple[Section, ...]
    more: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = [one.name for one in self.tables]
        if len(set(names)) < len(names):
            raise ValueError(f"two of the names {', '.join(names)} are equal")

    @property
    def tables(self) -> list[Table]:
        """All tables."""
        return [one for section in self.sections for one in section.tables]

    @property
    def figures(self) -> dict[str, Figure]:
        """All figures by name."""
        return {name: figure for section in self.sections for name, figure in section.figures.items()}

    @property
    def results(self) -> dict[str, Any]:
        """The rows of all tables by their names, and what there is beside them."""
        return {**{one.name: one.records for one in self.tables}, **self.more}


def cell_text(cell: Cell) -> str:
    """Return how a cell is shown: numbers to three digits, those from a thousand to a billion without a fraction.

    Examples
    --------
    >>> cell_text(0.000123456), cell_text(9523.4), cell_text(12345), cell_text(None), cell_text("fast")
    ('0.000123', '9,523', '12,345', '', 'fast')
    """
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    if isinstance(cell, str):
        return cell
    return f"{cell:,.0f}" if isinstance(cell, int) or 1e3 <= abs(cell) < 1e9 else f"{cell:.3g}"
