"""Results in print: small tables with units for people, JSON for programs."""

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pricing_core.american import ExerciseBoundary, ImpliedVolatility, Valuation

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
EXTENDED_UNITS = {  # shown where they are there
    "vanna": "1 per 1.00 of volatility",
    "volga": "money per 1.00 of volatility, squared",
    "rate_bucket_rho": "money per 1.00 of each value of the rate",
    "volatility_bucket_vega": "money per 1.00 of each value of the volatility",
    "dividend_sensitivities": "per cash dividend: money per 1.00 of its amount",
}
IMPLIED_UNITS = {
    "volatility": "1/sqrt(year)",
    "status": "",
    "european_price": "money",
    "price": "money",
    "bid_volatility": "1/sqrt(year)",
    "ask_volatility": "1/sqrt(year)",
    "error_estimate": "money",
    "iterations": "",
}

WIDEST = 1_000  # characters: a terminal wraps a long path by itself, nothing is cut


def print_valuation(valuation: Valuation) -> None:
    """Print one result per line with its unit; a missing number as a dash."""
    _print_results(
        valuation,
        UNITS | {n: u for n, u in EXTENDED_UNITS.items() if getattr(valuation, n) is not None},
    )


def valuation_json(valuation: Valuation) -> str:
    """Return one JSON object, null for a missing number."""
    return json.dumps({name: getattr(valuation, name) for name in UNITS | EXTENDED_UNITS}, allow_nan=False)


def print_implied_volatility(found: ImpliedVolatility) -> None:
    """Print one result per line with its unit; a missing number as a dash."""
    _print_results(found, IMPLIED_UNITS)


def implied_volatility_json(found: ImpliedVolatility) -> str:
    """Return one JSON object, null for a missing number."""
    return json.dumps({name: getattr(found, name) for name in IMPLIED_UNITS}, allow_nan=False)


def print_boundary(found: ExerciseBoundary) -> None:
    """Print one time per line."""
    columns = boundary_columns(found)
    names = tuple(f"{name} ({'years' if name.startswith('time') else 'money'})" for name in columns)
    rows = zip(*columns.values(), strict=True)
    print_table(names, (tuple(_shown(value) for value in row) for row in rows))


def boundary_json(found: ExerciseBoundary) -> str:
    """Return one JSON object, null where there is no boundary."""
    return json.dumps({"other_boundary": None} | boundary_columns(found), allow_nan=False)


def print_summary(summary: "BatchSummary", target: Path, rejects: Path) -> None:
    """Print what became of the rows of a batch and where to look."""
    rows = [("read", f"{summary.rows:,}", ""), ("priced", f"{summary.priced:,}", str(target))]
    if summary.below_tolerance:
        rows.append(
            ("  of them, tolerance not met", f"{summary.below_tolerance:,}", "status tolerance_not_met")
        )
    rows.append(("rejected", f"{summary.rejected:,}", str(rejects) if summary.rejected else ""))
    if summary.unread:
        names = ", ".join(name if name.isprintable() else repr(name) for name in summary.unread)
        rows.append(("columns not read", f"{len(summary.unread):,}", names))
    print_table(("batch", "rows", "in"), rows)


def boundary_columns(found: ExerciseBoundary) -> dict[str, list[float | None]]:
    """Return the columns by name, None where there is no boundary, or no estimate of its error."""
    columns = {"time": found.time, "time_to_expiry": found.time_to_expiry, "boundary": found.boundary}
    if found.other_boundary is not None:
        columns["other_boundary"] = found.other_boundary
    columns["error_estimate"] = found.error_estimate
    return {
        name: [None if math.isnan(value) else value for value in values.tolist()]
        for name, values in columns.items()
    }


def _print_results(found: object, units: Mapping[str, str]) -> None:
    rows = ((name, _shown(getattr(found, name)), unit) for name, unit in units.items())
    print_table(("result", "value", "unit"), rows)


def _shown(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, tuple):
        return ", ".join(_shown(number) for number in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def print_table(names: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Print rows of texts under their headings, in columns."""
    table = Table(*names, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))
    console = Console(highlight=False, width=WIDEST)
    with console.capture() as text:
        console.print(table)
    print(text.get(), end="", flush=True)  # rich itself would meet a closed pipe with an exit of its own
