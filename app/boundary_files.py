"""The files that `pricing boundary` writes: a CSV table and a PNG picture."""

from pathlib import Path

from app.output_files import write_columns
from app.tables import boundary_columns
from pricing_core.american import ExerciseBoundary, Market, Option
from pricing_core.batch.replacement import replacement

COLUMNS = ("time", "time_to_expiry", "boundary", "other_boundary", "error_estimate")


def write_boundary_csv(path: Path, found: ExerciseBoundary) -> None:
    """Write one time per line, an empty cell where there is no boundary."""
    columns = {"other_boundary": [None] * found.time.size} | boundary_columns(found)
    write_columns(path, {name: columns[name] for name in COLUMNS})


def write_boundary_plot(path: Path, found: ExerciseBoundary, option: Option, market: Market) -> None:
    """Draw the boundary into a PNG file."""
    from app.plots import draw_boundary  # noqa: PLC0415

    with replacement(path) as file:
        draw_boundary(found, option, market, file)
