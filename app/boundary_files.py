"""The files that `pricing boundary` writes: a CSV table and a PNG picture."""

import os
from pathlib import Path

import pyarrow as pa

from app.tables import boundary_columns
from pricing_core.american import ExerciseBoundary, Market, Option
from pricing_core.batch.replacement import check_replaceable, replacement
from pricing_core.batch.writer import CsvWriter
from pricing_core.errors import InvalidInputError

COLUMNS = ("time", "time_to_expiry", "boundary", "other_boundary", "error_estimate")


def check_boundary_files(table: Path | None, picture: Path | None) -> None:
    """Accept the names of the files before there is anything to write.

    Raises
    ------
    InvalidInputError
        The picture does not end in .png, or both are one file.
    OSError
        A file cannot be written there.
    """
    if picture is not None and picture.suffix.lower() != ".png":
        raise InvalidInputError("plot", picture.name, "a .png file")
    if table is not None and picture is not None and os.path.realpath(table) == os.path.realpath(picture):
        raise InvalidInputError("plot", str(picture), "another file than that of csv")
    for path in (table, picture):
        if path is not None:
            check_replaceable(path)


def write_boundary_csv(path: Path, found: ExerciseBoundary) -> None:
    """Write one time per line, an empty cell where there is no boundary."""
    columns = {"other_boundary": [None] * found.time.size} | boundary_columns(found)
    arrays = [pa.array(columns[name], pa.float64()) for name in COLUMNS]
    with replacement(path) as file, CsvWriter(file, list(COLUMNS)) as rows:
        rows.write(pa.RecordBatch.from_arrays(arrays, names=list(COLUMNS)))


def write_boundary_plot(path: Path, found: ExerciseBoundary, option: Option, market: Market) -> None:
    """Draw the boundary into a PNG file."""
    from app.plots import draw_boundary  # noqa: PLC0415

    with replacement(path) as file:
        draw_boundary(found, option, market, file)
