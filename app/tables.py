"""Results in print: small tables with units for people, JSON and CSV for programs."""

import csv
import io
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from pricing_core.american import ExerciseBoundary, Market, Option, Valuation
from pricing_core.errors import InvalidInputError

if TYPE_CHECKING:
    from pricing_core.batch import BatchSummary

UNITS = {
    "price": "money",
    "european_price": "money",
    "early_exercise_premium": "money",
    "intrinsic_value": "money",
    "delta": "",
    "gamma": "1/money",
    "theta": "money/year",
    "theta_per_day": "money/day",
    "vega": "money per 1.00 of volatility",
    "vega_per_point": "money per 0.01 of volatility",
    "rho": "money per 1.00 of rate",
    "rho_per_point": "money per 0.01 of rate",
    "dividend_rho": "money per 1.00 of dividend yield",
    "exercise_now": "",
    "exercise_boundary": "money",
    "error_estimate": "money",
    "status": "",
    "method": "",
    "engine_version": "",
}

WIDEST = 1_000  # characters: a terminal wraps a long path by itself, nothing is cut


def print_valuation(valuation: Valuation) -> None:
    """Print one result per line with its unit; a missing number as a dash."""
    _print(
        ("result", "value", "unit"), ((name, _shown(getattr(valuation, name)), UNITS[name]) for name in UNITS)
    )


def valuation_json(valuation: Valuation) -> str:
    """Return one JSON object, null for a missing number."""
    return json.dumps({name: getattr(valuation, name) for name in UNITS}, allow_nan=False)


def print_boundary(found: ExerciseBoundary) -> None:
    """Print one time per line."""
    columns = _boundary_columns(found)
    names = tuple(f"{name} ({'years' if name.startswith('time') else 'money'})" for name in columns)
    rows = zip(*columns.values(), strict=True)
    _print(names, (tuple(_shown(value) for value in row) for row in rows))


def boundary_json(found: ExerciseBoundary) -> str:
    """Return one JSON object, null where there is no boundary."""
    return json.dumps({"other_boundary": None} | _boundary_columns(found), allow_nan=False)


def write_boundary_csv(path: Path, found: ExerciseBoundary) -> None:
    """Write one time per line, an empty cell where there is no boundary."""
    from pricing_core.batch.replacement import replacement  # noqa: PLC0415

    columns = {"other_boundary": [None] * found.time.size} | _boundary_columns(found)
    names = ("time", "time_to_expiry", "boundary", "other_boundary")
    with replacement(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(names)
        rows.writerows(zip(*(columns[name] for name in names), strict=True))
        text.detach()


def write_boundary_plot(path: Path, found: ExerciseBoundary, option: Option, market: Market) -> None:
    """Draw the boundary into a PNG file.

    Raises
    ------
    InvalidInputError
        The name does not end in .png.
    """
    if path.suffix.lower() != ".png":
        raise InvalidInputError("plot", path.name, "a .png file")
    from app.plots import draw_boundary  # noqa: PLC0415
    from pricing_core.batch.replacement import replacement  # noqa: PLC0415

    with replacement(path) as file:
        draw_boundary(found, option, market, file)


def print_summary(summary: "BatchSummary", target: Path, rejects: Path) -> None:
    """Print what became of the rows of a batch and where to look."""
    rows = [("read", f"{summary.rows:,}", ""), ("priced", f"{summary.priced:,}", str(target))]
    if summary.below_tolerance:
        rows.append(
            ("  of them, tolerance not met", f"{summary.below_tolerance:,}", "status tolerance_not_met")
        )
    rows.append(("rejected", f"{summary.rejected:,}", str(rejects) if summary.rejected else ""))
    _print(("batch", "rows", "in"), rows)


def _boundary_columns(found: ExerciseBoundary) -> dict[str, list[float | None]]:
    columns = {"time": found.time, "time_to_expiry": found.time_to_expiry, "boundary": found.boundary}
    if found.other_boundary is not None:
        columns["other_boundary"] = found.other_boundary
    return {
        name: [None if math.isnan(value) else value for value in values.tolist()]
        for name, values in columns.items()
    }


def _shown(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _print(names: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    table = Table(*names, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*row)
    Console(highlight=False, width=WIDEST).print(table)
