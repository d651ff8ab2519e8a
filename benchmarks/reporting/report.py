"""A report, the answer of a benchmark to its question: sections of text, tables and figures."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from matplotlib.figure import Figure

Cell: TypeAlias = str | float | int | None
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells under column names; None and NaN are shown as empty.

    Parameters
    ----------
    name : str, optional
        With a name, of letters, digits, "-" and "_", the table is also written as a CSV file.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    name: str | None = None

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"every row of table {self.name} must have {len(self.columns)} cells")


@dataclass(frozen=True, slots=True)
class Section:
    """A titled part; blank lines separate the paragraphs of `text`, backticks enclose code.

    `figures` are pairs of a name, as a table's, and a figure.
    """

    title: str
    text: str
    tables: tuple[Table, ...] = ()
    figures: tuple[tuple[str, Figure], ...] = ()

    @property
    def paragraphs(self) -> list[str]:
        """The paragraphs of `text`, each on one line."""
        return [" ".join(part.split()) for part in re.split(r"\n\s*\n", self.text) if part.strip()]


@dataclass(frozen=True, slots=True)
class Report:
    """The answer to one question; `results` is what a program would read, of plain JSON values."""

    name: str
    title: str
    question: str
    sections: tuple[Section, ...]
    results: Mapping[str, object]

    def __post_init__(self) -> None:
        tables = [table.name for section in self.sections for table in section.tables if table.name]
        figures = [name for section in self.sections for name, _ in section.figures]
        for names in (tables, figures):
            if len(set(names)) < len(names):
                raise ValueError(f"two of the names {', '.join(names)} are equal")
        for name in (self.name, *tables, *figures):
            if not FILE_NAME.fullmatch(name):
                raise ValueError(f"{name!r} cannot be part of a file name: use letters, digits, '-' and '_'")


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


def is_numeric(table: Table, column: int) -> bool:
    """Whether a column holds numbers, and nothing but numbers and empty cells."""
    cells = [row[column] for row in table.rows if row[column] is not None]
    return bool(cells) and not any(isinstance(cell, str) for cell in cells)
