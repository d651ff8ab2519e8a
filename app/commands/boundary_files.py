"""The files that `pricing boundary` writes: a CSV table and a PNG picture."""

from pathlib import Path

from app.commands.output_files import write_columns
from app.result_values import by_name
from pricing_core.american import ExerciseBoundary, Market, Option
from pricing_core.american.contracts.result_fields import BOUNDARY_FIELDS
from pricing_core.replacement import replacement


def write_boundary_csv(path: Path, found: ExerciseBoundary) -> None:
    """Write one time per line, an empty cell where there is no boundary."""
    empty = [None] * found.time.size
    columns = [field for field in BOUNDARY_FIELDS if field.kind == "list"]
    write_columns(path, {name: column or empty for name, column in by_name(columns, found).items()})


def write_boundary_plot(path: Path, found: ExerciseBoundary, option: Option, market: Market) -> None:
    """Draw the boundary into a PNG file."""
    from app.commands.boundary_plot import draw_boundary  # noqa: PLC0415

    with replacement(path) as file:
        draw_boundary(found, option, market, file)
