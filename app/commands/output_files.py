"""The files that a command writes beside what it prints: a CSV table and a PNG picture."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from pricing_core.csv_text import CsvText, number_text
from pricing_core.errors import InvalidInputError
from pricing_core.replacement import check_replaceable, replacement


def check_output_files(table: Path | None, picture: Path | None, animation: Path | None = None) -> None:
    """Accept the names of the files before there is anything to write.

    Raises
    ------
    InvalidInputError
        The picture does not end in .png, or the animation in .gif, or table and picture are one file.
    OSError
        A file cannot be written there.
    """
    if picture is not None and picture.suffix.lower() != ".png":
        raise InvalidInputError("plot", picture.name, "a .png file")
    if animation is not None and animation.suffix.lower() != ".gif":
        raise InvalidInputError("animate", animation.name, "a .gif file")
    if table is not None and picture is not None and os.path.realpath(table) == os.path.realpath(picture):
        raise InvalidInputError("plot", str(picture), "another file than that of csv")
    for path in (table, picture, animation):
        if path is not None:
            check_replaceable(path)


def write_columns(path: Path, columns: Mapping[str, Sequence[float | None]]) -> None:
    """Write columns of numbers as CSV, an empty cell where there is none."""
    rows = zip(*columns.values(), strict=True)
    with replacement(path) as file, CsvText(file, columns) as table:
        table.write([number_text(None if x is None else float(x)) for x in row] for row in rows)
